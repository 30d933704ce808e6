//! PickSodaFromCabinet: take a can out of a cabinet and put it down before it (spec/tasks.md §2, task 2).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{ExternalCameras, SINGLE_TABLE_Z, box_part, fixed, movable, props, region, rgb, single_arm};
use crate::expert::{Move, TcpGoal, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::profile::ProfileRules;
use crate::robot::control;
use crate::scene::{
    BodySpec, AppearanceSpec, PartSpec, PlacementSpec, Primitive, Range, Role, ScaledBy, Scene, SceneSpec, Texture,
};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "PickSodaFromCabinet-v1",
    category: Category::Pick,
    morphology: Morphology::Single,
    max_steps: 203,
    demo_steps: 193.6,
    instruction: "pick up the soda can from the cabinet",
    paraphrases: include_str!("paraphrases/pick_soda_from_cabinet.txt"),
    nominal,
    success,
    expert,
};

/// Before the middle compartment, the hand level.
const QPOS: [f64; 7] = [-0.387, -0.770, 0.395, -3.009, 2.978, 2.396, -1.963];
/// World x and y of the cabinet's middle, in m.
const CABINET: [f64; 2] = [0.3, -0.12];
/// Half extents of a shelf, and the world z of the three shelves' middles, in m.
const SHELF_HALF: [f64; 3] = [0.2, 0.3, 0.015];
const SHELVES_Z: [f64; 3] = [0.021, 0.311, 0.601];
/// Radius and half height of the can, in m.
const CAN: [f64; 2] = [0.0375, 0.063];

fn nominal() -> SceneSpec {
    let [radius, half_height] = CAN;
    let solid =
        PartSpec::at(Primitive::Cylinder { radius, half_height }, [0.0; 3], AppearanceSpec::plain([1.0; 3]));
    let can = BodySpec {
        visuals: props::can(radius, 2.0 * half_height, [0.0, 0.0, -half_height]),
        scaled_by: ScaledBy::Nothing("the benchmark keeps its size"),
        ..movable("can", vec![solid], 1, SHELVES_Z[1] + SHELF_HALF[2])
    };
    let regions = vec![
        region("cabinet", Range::fixed(CABINET[0]), Range::fixed(CABINET[1])).not_widened(),
        region("can", Range::new(0.13, 0.162), Range::new(-0.3, -0.1)).not_widened(),
    ];
    let eye = |y| [[-0.3, y, 0.6], [0.0, 0.0, 0.25]];
    let cameras = ExternalCameras { external1: eye(0.2), external2: eye(-0.4) };
    single_arm(QPOS, 0.0, &cameras, regions, vec![shelves(), panels(), can], TASK.instruction)
}

/// Three shelves on a plinth; their frame is on the table.
fn shelves() -> BodySpec {
    let wood = AppearanceSpec::textured(Texture::Wood, [0.72, 0.58, 0.42]);
    let [hx, hy, hz] = SHELF_HALF;
    let plinth = (SHELVES_Z[0] - hz) / 2.0;
    let mut parts = vec![box_part([hx - 0.02, hy - 0.02, plinth], [0.0, 0.0, plinth], wood)];
    parts.extend(SHELVES_Z.map(|z| box_part(SHELF_HALF, [0.0, 0.0, z], wood)));
    BodySpec { role: Role::Fixture, ..fixed("shelves", parts, 0, SINGLE_TABLE_Z, "it is furniture") }
}

/// The left, right and back panel around the shelves, in their frame.
fn panels() -> BodySpec {
    let panel = |half, [x, y, z]: [f64; 3]| {
        box_part(half, [x - CABINET[0], y - CABINET[1], z], AppearanceSpec::plain(rgb([141, 117, 105])))
    };
    let parts = vec![
        panel([0.19, 0.01, 0.272], [0.304, 0.1773, 0.3096]),
        panel([0.19, 0.01, 0.272], [0.304, -0.4222, 0.3096]),
        panel([0.01, 0.29, 0.272], [0.49, -0.12, 0.3096]),
    ];
    let placement = PlacementSpec::RelativeTo { body: 0, pose: Isometry3::identity() };
    BodySpec { placement, ..fixed("panels", parts, 0, SINGLE_TABLE_Z, "the benchmark keeps its size") }
}

/// The can low down before the cabinet.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let (far, front) = (f64::INFINITY, CABINET[0] - SHELF_HALF[0]);
    let [low_z, far_x] = if profile.counts_anywhere_low() { [-far, far] } else { [SINGLE_TABLE_Z, front] };
    vec![Predicate::inside_box(scene.body_idx("can"), [-0.3, -0.3, low_z], [far_x, 0.0, 0.1])]
}

/// How far before the can the hand waits, and how far it carries it out, in m.
const OUT: f64 = 0.3;
/// Height of the can's middle over the table where it is let go, in m.
const PUT_DOWN_Z: f64 = CAN[1] + 0.004;

fn expert(scene: &Scene) -> Vec<Move> {
    let closing = grasp::closest_closing(Vector3::y(), &grasp::start_closing(scene, 0));
    let middle = scene.body("can").pose.translation.vector;
    let at = grasp::pose(&middle, &Vector3::x(), &closing);
    let before = grasp::retreated(&at, OUT);
    let down = grasp::translated(&before, &(Vector3::z() * (PUT_DOWN_Z - middle.z)));
    vec![
        Move::Joint(vec![TcpGoal { arm: 0, tcp: before }]),
        Move::straight(0, at),
        Move::Grip { arms: vec![0], command: control::gripper_entry(0.0) as f32, steps: 6 },
        Move::straight(0, before),
        Move::straight(0, down),
        Move::open(&[0], 6),
    ]
}
