//! PlaceCubeInDrawer: open a drawer and put a cube into it. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::furniture::cabinet::drawer_grasp;
use super::common::furniture::chest::{TRAVEL, chest_of_drawers};
use super::common::{self, ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, region, single_arm};
use crate::expert::{Move, TcpGoal, first_feasible, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{BodySpec, Range, RegionSpec, Role, ScaledBy, Scene, SceneSpec, WidenedRanges};

pub(crate) const TASK: Task = Task {
    env_id: "PlaceCubeInDrawer-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Single,
    max_steps: 387,
    demo_steps: 333.5,
    instruction: "place the cube inside the open drawer",
    lerobot_instruction: "Place the cube in the drawer",
    paraphrases: include_str!("paraphrases/place_cube_in_drawer.txt"),
    nominal,
    success,
    expert,
};

/// Half-extent of the cube, in m.
const HALF: f64 = 0.035;
/// Initial joint positions in rad: the hand in front of the lowest drawer, the fingers above and below its
/// handle.
const QPOS: [f64; 7] = [1.1328, 1.1025, -1.1891, -1.8933, -0.6512, 2.0777, -1.7973];

fn nominal(profile: Profile) -> SceneSpec {
    // A fixture rather than a manipulation object: the benchmark refuses to recolour this task's cube, and
    // scaling it has no effect there.
    let cube = BodySpec {
        role: Role::Fixture,
        scaled_by: ScaledBy::Nothing("the released code does not scale this cube"),
        friction: 2.0,
        ..common::cube("cube", HALF, [1.0, 0.0, 0.0], 1, SINGLE_TABLE_Z)
    };
    let bodies = chest_of_drawers().into_iter().chain([cube]).collect();
    let target = [-0.1, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[0.3, 0.1, 0.6], target], external2: [[-0.2, 0.0, 0.8], target] };
    let cabinet = region("cabinet", Range::symmetric(0.1), Range::new(-0.6, -0.4));
    // Further towards the arm, the gripper starts inside the drawer's front.
    let clear = |all| WidenedRanges { y: Range::new(-0.65, -0.4), ..all };
    let widened = cabinet.widened.map(|all| if profile.separates_starts() { clear(all) } else { all });
    let regions =
        vec![RegionSpec { widened, ..cabinet }, region("cube", Range::symmetric(0.1), Range::new(0.4, 0.6))];
    let mut scene = single_arm(QPOS, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction);
    // The cube is the reference, although it is no manipulation object.
    scene.distractors.drop_m.1 = Some(scene.body_idx("cube"));
    scene
}

/// Requires the drawer to be open by three tenths of its travel and the cube to be near its middle, at rest
/// and released.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [drawer, cube] = ["drawer", "cube"].map(|name| scene.body_idx(name));
    let region = Region::Cylinder {
        origin: [-BEHIND_HANDLE, 0.0, 0.0],
        axis: [0.0, 0.0, 1.0],
        radius: 0.1,
        along: [-0.08, 0.08],
    };
    vec![
        Predicate::Opened { body: drawer, min_position: 0.3 * TRAVEL },
        Predicate::Inside { body: cube, point: [0.0; 3], of: Some(drawer), region },
        Predicate::AtRest { body: cube, max_linear: 0.1, max_angular: 0.5 },
        Predicate::Released { body: cube },
    ]
}

/// Distance behind the handle at which the cube counts as placed, in m.
const BEHIND_HANDLE: f64 = 0.12;
/// Distance behind the handle at which the cube is released, with the hand behind the drawer's front, in m.
const RELEASE_BEHIND: f64 = 0.14;
/// Number of moves that pull the drawer, and the distance of each in m: until seven tenths of its travel.
const N_PULLS: u32 = 7;
const PULL_STEP: f64 = 0.04;
/// Distance by which the drawer is pulled, in m.
const PULL_DISTANCE: f64 = PULL_STEP * N_PULLS as f64;
/// Displacement by which the grasped cube is raised, in m.
const RAISE: Vector3<f64> = Vector3::new(0.0, -0.1, 0.4);
/// Heights of the cube above the handle in m: while it is carried, and at release, with the hand still above
/// the drawer's walls.
const OVER_HANDLE: [f64; 2] = [0.25, 0.075];
/// Candidate displacements of the grasp from the benchmark's, towards the robot and up, in m. The later ones
/// are for cubes that are out of reach.
const GRASP_OFFSETS: [[f64; 2]; 3] = [[0.0, 0.0], [0.025, 0.015], [0.03, 0.025]];
/// Candidate lean angles of the hand at the cube, in rad: half of the cubes are out of reach from straight
/// above.
const LEANS: [f64; 6] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.2];
/// Candidate rotations of the hand at the handle towards the robot, in rad. The later ones are for handles
/// that are out of reach.
const HANDLE_LEANS: [f64; 4] = [0.0, 0.3, 0.6, 0.9];

fn expert(scene: &Scene) -> Vec<Move> {
    let (cube, drawer) = (scene.body("cube"), scene.body("drawer").pose);
    let out = drawer.rotation * Vector3::x();
    let into =
        drawer.translation.vector + out * (PULL_DISTANCE - RELEASE_BEHIND) - cube.pose.translation.vector;
    let waypoints = |tcp: &Isometry3<f64>| {
        let [carried, release] = OVER_HANDLE.map(|z| grasp::translated(tcp, &(into + Vector3::z() * z)));
        // Farther away than in the benchmark: the joint-space path there sags and must pass over the cube.
        [grasp::retreated(tcp, 0.2), *tcp, grasp::translated(tcp, &RAISE), carried, release]
    };
    // Close along the drawer's direction, so that the hand leans back towards the robot rather than towards
    // the cabinet.
    let centred = grasp::top_down(cube, &out, &out);
    let candidates: Vec<Isometry3<f64>> = GRASP_OFFSETS
        .map(|[back, up]| grasp::translated(&centred, &Vector3::new(-back, 0.0, up)))
        .iter()
        .flat_map(|tcp| LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, tcp, lean)))
        .collect();
    let first = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let handles = HANDLE_LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, &drawer_grasp(scene), lean));
    // Waypoints that are reachable one by one need not be reachable along the path, and vice versa.
    let others = handles.iter().flat_map(|handle| candidates.iter().map(|cube| (*handle, *cube)));
    let grasps = core::iter::once((handles[0], first)).chain(others);
    let joint = |tcp| Move::Joint(vec![TcpGoal { arm: 0, tcp }]);
    let plans = grasps.map(|(handle, cube)| {
        let [above, at, raised, carried, release] = waypoints(&cube);
        let pulled = |by: f64| Move::straight(0, grasp::translated(&handle, &(out * by)));
        let mut moves = vec![
            Move::Limit { per_joint: 1.5 },
            Move::open(&[0], 6),
            pulled(0.05),
            pulled(0.0),
            Move::close(&[0], 6),
        ];
        moves.extend((1..=N_PULLS).map(|i| pulled(PULL_STEP * f64::from(i))));
        moves.extend([
            Move::open(&[0], 6),
            pulled(PULL_DISTANCE + 0.1),
            joint(above),
            Move::line(0, at),
            Move::close(&[0], 6),
            Move::straight(0, raised),
            joint(carried),
            Move::line(0, release),
            Move::open(&[0], 6),
            Move::straight(0, grasp::retreated(&release, 0.24)),
            Move::Hold { steps: 5 },
        ]);
        moves
    });
    first_feasible(scene, TASK.max_steps, plans)
}
