//! ScoopBanana: scoop a banana up with a dustpan, against a wall (spec/tasks.md §2, task 12).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::common::{ExternalCameras, QPOS_NOISE_RAD, QPOS_D, SINGLE_TABLE_Z, box_part, fixed, region, rgb, single_arm, tools};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{BodySpec, AppearanceSpec, PlacementSpec, Range, RegionSpec, Role, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "ScoopBanana-v1",
    category: Category::ToolUse,
    morphology: Morphology::Single,
    max_steps: 322,
    demo_steps: 242.9,
    instruction: "scoop the banana and move it to the target location",
    paraphrases: include_str!("paraphrases/scoop_banana.txt"),
    nominal,
    success,
    expert,
};

/// Half extents of the wall as it is seen, and how far beyond the banana it stands, in m.
const WALL: [f64; 3] = [0.02, 0.2, 0.1];
const BEYOND: f64 = 0.15;
/// How deep the wall goes into the table, in m: with a banana of another size it is set up higher or lower.
const FOUNDATION: f64 = 0.04;

fn nominal() -> SceneSpec {
    let banana = BodySpec { role: Role::ReceiverObject, ..tools::banana(1) };
    let [half_x, half_y, half_z] = WALL;
    let slab = box_part(
        [half_x, half_y, half_z + FOUNDATION / 2.0],
        [0.0, 0.0, -FOUNDATION / 2.0],
        AppearanceSpec::plain(rgb([201, 204, 182])),
    );
    let wall = BodySpec {
        role: Role::Fixture,
        placement: PlacementSpec::RelativeTo {
            body: 1,
            pose: Isometry3::translation(BEYOND, 0.0, half_z - tools::BANANA_RADIUS),
        },
        ..fixed("wall", vec![slab], 1, SINGLE_TABLE_Z, "the released code scales only dustpan and banana")
    };
    let around_banana = region("banana", Range::new(-0.05, 0.15), Range::new(-0.25, 0.05)).not_widened();
    let regions = vec![
        region("dustpan", Range::new(-0.3, -0.1), Range::new(-0.3, -0.1)),
        // The ranges overlap: the banana is drawn again until it lies beside the dustpan, not in it.
        RegionSpec { min_gap_m: Some(0.0), ..around_banana },
    ];
    let target = [0.0, 0.0, 0.1];
    let cameras = ExternalCameras { external1: [[-0.25, 0.25, 0.4], target], external2: [[-0.2, -0.4, 0.4], target] };
    let bodies = vec![tools::dustpan(0), banana, wall];
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction)
}

/// The banana within 0.17 m of the dustpan's middle and up to 55 mm above it: on the table it lies lower.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [top, base] = ["banana", "dustpan"].map(|name| scene.body_idx(name));
    vec![Predicate::On { top, base, xy_m: 0.1697, rise_m: 0.0275, rise_tolerance_m: 0.0275 }]
}

/// How high the dustpan is carried to the banana, in m.
const CARRY: f64 = 0.06;
/// How far from the banana's middle the mouth is set down, and from the wall it stops, in m.
const BEFORE: f64 = 0.07;
const LEFT: f64 = 0.012;
/// Tilts by which the mouth is turned up, in rad: the later ones where the arm has no room for more.
const TILTS: [f64; 3] = [0.7, 0.55, 0.4];
/// How far the dustpan is raised while it is tilted and after that, in m.
const LIFTS: [f64; 2] = [0.03, 0.18];

fn expert(scene: &Scene) -> Vec<Move> {
    let ways = TILTS.iter().flat_map(|tilt| [(*tilt, Vector3::y()), (*tilt, -Vector3::y())]);
    first_feasible(scene, TASK.max_steps, ways.map(|(tilt, closing)| scooped(scene, &closing, tilt)))
}

/// Takes the dustpan, pushes it under the banana until that leans on the wall, tilts it back and lifts it.
fn scooped(scene: &Scene, closing: &Vector3<f64>, tilt: f64) -> Vec<Move> {
    let (dustpan, banana) = (scene.body("dustpan"), scene.body("banana").pose.translation);
    let grip = dustpan.pose * Point3::from(tools::DUSTPAN_GRIP.map(|x| x * dustpan.scale));
    let tcp = grasp::pose(&grip.coords, &-Vector3::z(), closing);
    // In line with the banana, the mouth at this x and so far above the table.
    let mouth_at = |x: f64, above_m: f64| {
        let ahead = (tools::DUSTPAN_MOUTH - tools::DUSTPAN_GRIP[0]) * dustpan.scale;
        Isometry3::from_parts(Translation3::new(x - ahead, banana.y, grip.z + above_m), tcp.rotation)
    };
    let raised = |tcp: &Isometry3<f64>, by_m: f64| grasp::translated(tcp, &(Vector3::z() * by_m));
    let before = banana.x - BEFORE;
    let under = mouth_at(scene.body("wall").pose.translation.x - WALL[0] - LEFT, 0.0);
    let back = UnitQuaternion::from_axis_angle(&-Vector3::y_axis(), tilt);
    let tilted = raised(&Isometry3::from_parts(under.translation, back * under.rotation), LIFTS[0]);
    let close = || Move::close(&[0], 6);
    let to = |tcp| Move::straight(0, tcp);
    vec![
        to(grasp::retreated(&tcp, 0.08)),
        to(tcp),
        close(),
        to(raised(&tcp, CARRY)),
        to(mouth_at(before, CARRY)),
        to(mouth_at(before, 0.0)),
        to(under),
        close(),
        to(tilted),
        to(raised(&tilted, LIFTS[1])),
    ]
}
