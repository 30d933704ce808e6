//! PlaceCubeInDrawer: open a drawer and put a cube into it (spec/tasks.md §2, task 15).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::cabinet::{CHEST_TRAVEL, chest_of_drawers, drawer_grip, pull_open};
use super::common::{self, ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, region, single_arm};
use crate::expert::{Move, TcpGoal, first_feasible, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::scene::{BodySpec, Range, Role, ScaledBy, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "PlaceCubeInDrawer-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Single,
    max_steps: 387,
    demo_steps: 333.5,
    instruction: "place the cube inside the open drawer",
    paraphrases: include_str!("paraphrases/place_cube_in_drawer.txt"),
    nominal,
    success,
    expert,
};

/// Half the cube's edge, in m.
const HALF: f64 = 0.035;
/// The hand before the chest's middle drawer, closing upwards and downwards.
const QPOS: [f64; 7] = [1.1328, 1.1025, -1.1891, -1.8933, -0.6512, 2.0777, -1.7973];

fn nominal() -> SceneSpec {
    // Not a manipulation object: the benchmark refuses to recolour the cube of this task, and scaling it has no effect.
    let cube = BodySpec {
        role: Role::Fixture,
        scaled_by: ScaledBy::Nothing("the released code does not scale this cube"),
        friction: 2.0,
        ..common::cube("cube", HALF, [1.0, 0.0, 0.0], 1, SINGLE_TABLE_Z)
    };
    let bodies = chest_of_drawers().into_iter().chain([cube]).collect();
    let target = [-0.1, 0.0, 0.1];
    let cameras = ExternalCameras { external1: [[0.3, 0.1, 0.6], target], external2: [[-0.2, 0.0, 0.8], target] };
    let regions = vec![
        region("cabinet", Range::symmetric(0.1), Range::new(-0.6, -0.4)),
        region("cube", Range::symmetric(0.1), Range::new(0.4, 0.6)),
    ];
    single_arm(QPOS, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction)
}

/// The drawer three tenths open, the cube around the middle of it, at rest, let go.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [drawer, cube] = ["drawer", "cube"].map(|name| scene.body_idx(name));
    let middle = Region::Cylinder {
        origin: [-BEHIND_HANDLE, 0.0, 0.0],
        axis: [0.0, 0.0, 1.0],
        radius: 0.1,
        along: [-0.08, 0.08],
    };
    vec![
        Predicate::Opened { body: drawer, min_position: 0.3 * CHEST_TRAVEL },
        Predicate::Inside { body: cube, point: [0.0; 3], of: Some(drawer), region: middle },
        Predicate::AtRest { body: cube, max_linear: 0.1, max_angular: 0.5 },
        Predicate::Released { body: cube },
    ]
}

/// How far behind the handle the cube is put, in m.
const BEHIND_HANDLE: f64 = 0.12;
/// How far the drawer is pulled, in m.
const PULL: f64 = 0.7 * CHEST_TRAVEL;
/// How the gripped cube is raised, in m.
const RAISE: Vector3<f64> = Vector3::new(0.0, -0.1, 0.4);
/// Heights of the cube over the handle, in m: on its way, and where it is let go, the hand still over the drawer's front.
const OVER_HANDLE: [f64; 2] = [0.25, 0.045];
/// How far off the benchmark's grip the cube is taken, towards the robot and up, in m: the others if that is out of reach.
const ASIDE: [[f64; 2]; 3] = [[0.0, 0.0], [0.025, 0.015], [0.03, 0.025]];
/// Leans of the hand that are tried, in rad: half of the cubes are out of reach from straight above.
const LEANS: [f64; 6] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.2];
/// How far the hand at the handle is turned towards the robot, in rad: the later ones where the handle is out of reach.
const TURNS: [f64; 4] = [0.0, 0.3, 0.6, 0.9];

fn expert(scene: &Scene) -> Vec<Move> {
    let (cube, drawer) = (scene.body("cube"), scene.body("drawer").pose);
    let out = drawer.rotation * Vector3::x();
    let into = drawer.translation.vector + out * (PULL - BEHIND_HANDLE) - cube.pose.translation.vector;
    let stations = |tcp: &Isometry3<f64>| {
        let [carried, put] = OVER_HANDLE.map(|z| grasp::translated(tcp, &(into + Vector3::z() * z)));
        // Farther off than in the benchmark: the way there sags, and must pass over the cube.
        [grasp::retreated(tcp, 0.2), *tcp, grasp::translated(tcp, &RAISE), carried, put]
    };
    // Closing along the drawer, so that the hand leans back towards the robot and not towards the cabinet.
    let centred = grasp::top_down(cube, &out, &out);
    let candidates: Vec<Isometry3<f64>> = ASIDE
        .map(|[back, up]| grasp::translated(&centred, &Vector3::new(-back, 0.0, up)))
        .iter()
        .flat_map(|tcp| LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, tcp, lean)))
        .collect();
    let first = grasp::first_reachable(scene, 0, &candidates, stations);
    let handles = TURNS.map(|turn| grasp::tilted_toward_base(scene, 0, &drawer_grip(scene), turn));
    // What is within reach station by station need not be along the way, and the other way round.
    let others = handles.iter().flat_map(|handle| candidates.iter().map(|cube| (*handle, *cube)));
    let grips = core::iter::once((handles[0], first)).chain(others);
    let joint = |tcp| Move::Joint(vec![TcpGoal { arm: 0, tcp }]);
    let plans = grips.map(|(handle, cube)| {
        let [above, at, raised, carried, put] = stations(&cube);
        let mut moves = pull_open(scene, handle, PULL);
        moves.extend([
            Move::straight(0, grasp::translated(&grasp::retreated(&handle, 0.05), &(out * PULL))),
            joint(above),
            Move::straight(0, at),
            Move::close(&[0], 6),
            Move::straight(0, raised),
            joint(carried),
            Move::straight(0, put),
            Move::open(&[0], 6),
            Move::straight(0, carried),
        ]);
        moves
    });
    first_feasible(scene, TASK.max_steps, plans)
}
