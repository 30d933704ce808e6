//! PickSodaFromCabinet: take a can out of a cabinet and put it down in front of it. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::kitchen::can;
use super::common::{ExternalCameras, SINGLE_TABLE_Z, box_part, fixed, movable, region, rgb, single_arm, srgb};
use crate::expert::{Move, TcpGoal, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{
    AppearanceSpec, BodySpec, PlacementSpec, Range, RenderParts, Role, ScaledBy, Scene, SceneSpec, Texture,
};

pub(crate) const TASK: Task = Task {
    env_id: "PickSodaFromCabinet-v1",
    category: Category::Pick,
    morphology: Morphology::Single,
    max_steps: 203,
    demo_steps: 193.6,
    instruction: "pick up the soda can from the cabinet",
    lerobot_instruction: "Pick up the soda can from the cabinet",
    paraphrases: include_str!("paraphrases/pick_soda_from_cabinet.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the hand level, in front of the middle compartment.
const QPOS: [f64; 7] = [-0.387, -0.770, 0.395, -3.009, 2.978, 2.396, -1.963];
/// World (x, y) of the cabinet's centre, in m.
const CABINET: [f64; 2] = [0.3, -0.12];
/// World z of the cabinet's origin, in m.
const CABINET_Z: f64 = 0.456;
/// Half-extents of a shelf, in m.
const SHELF_HALF: [f64; 3] = [0.2, 0.3, 0.015];
/// World z of the three shelves' centres, in m. There are 6 mm of air under the lowest.
const SHELVES_Z: [f64; 3] = [0.021, 0.311, 0.601];
/// World z of the can's centre at the start, in m: it drops 15 mm onto the middle shelf.
const CAN_Z: f64 = 0.405;

fn nominal(_profile: Profile) -> SceneSpec {
    let can = BodySpec {
        visuals: can::visuals(),
        render_parts: RenderParts::Single,
        mass: can::MASS,
        scaled_by: ScaledBy::Nothing("the benchmark keeps its size"),
        ..movable("can", can::parts(), 1, SHELVES_Z[1] + SHELF_HALF[2])
    };
    let can = can.with_origin_z(CAN_Z);
    let regions = vec![
        region("cabinet", Range::fixed(CABINET[0]), Range::fixed(CABINET[1])).not_widened(),
        region("can", Range::new(0.13, 0.162), Range::new(-0.3, -0.1)).not_widened(),
    ];
    let eye = |y| [[-0.3, y, 0.6], [0.0, 0.0, 0.25]];
    let cameras = ExternalCameras { external1: eye(0.2), external2: eye(-0.4) };
    single_arm(QPOS, 0.0, &cameras, regions, vec![shelves(), panels(), can], TASK.instruction)
}

/// Creates the three shelves.
fn shelves() -> BodySpec {
    let wood = AppearanceSpec::textured(Texture::Wood, srgb([184, 148, 107]));
    let parts = SHELVES_Z.map(|z| box_part(SHELF_HALF, [0.0, 0.0, z - CABINET_Z], wood)).to_vec();
    let shelves =
        BodySpec { role: Role::Fixture, ..fixed("shelves", parts, 0, SINGLE_TABLE_Z, "it is furniture") };
    shelves.with_origin_z(CABINET_Z)
}

/// Creates the left, right and back panels around the shelves, in the shelves' frame.
fn panels() -> BodySpec {
    let panel = |half, [x, y, z]: [f64; 3]| {
        let position = [x - CABINET[0], y - CABINET[1], z - CABINET_Z];
        box_part(half, position, AppearanceSpec::plain(rgb([141, 117, 105])))
    };
    let parts = vec![
        panel([0.19, 0.01, 0.272], [0.304, 0.1773, 0.3096]),
        panel([0.19, 0.01, 0.272], [0.304, -0.4222, 0.3096]),
        panel([0.01, 0.29, 0.272], [0.49, -0.12, 0.3096]),
    ];
    let placement = PlacementSpec::RelativeTo { body: 0, pose: Isometry3::identity() };
    let render_parts = RenderParts::PerShape;
    BodySpec {
        placement,
        render_parts,
        ..fixed("panels", parts, 0, SINGLE_TABLE_Z, "the benchmark keeps its size")
    }
}

/// Requires the can to be low and in front of the cabinet.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let (far, front) = (f64::INFINITY, CABINET[0] - SHELF_HALF[0]);
    let [low_z, far_x] = if profile.counts_anywhere_low() { [-far, far] } else { [SINGLE_TABLE_Z, front] };
    vec![Predicate::inside_box(scene.body_idx("can"), [-0.3, -0.3, low_z], [far_x, 0.0, 0.1])]
}

/// Distance of the pre-grasp pose in front of the can, which is also how far the can is pulled out, in m.
const PULL_OUT: f64 = 0.3;
/// Height of the hand above the table at which the can is released, in m.
const RELEASE_Z: f64 = 0.1;

fn expert(scene: &Scene) -> Vec<Move> {
    let closing = grasp::closest_closing(Vector3::y(), &grasp::start_closing(scene, 0));
    let centre = scene.body("can").resting_pose().translation.vector;
    let at = grasp::pose(&centre, &Vector3::x(), &closing);
    let pre_grasp = grasp::retreated(&at, PULL_OUT);
    let down = grasp::translated(&pre_grasp, &(Vector3::z() * (RELEASE_Z - centre.z)));
    let joint = |tcp| Move::Joint(vec![TcpGoal { arm: 0, tcp }]);
    vec![
        Move::Limit { per_joint: 0.75 },
        joint(pre_grasp),
        joint(at),
        Move::close_gently(6),
        joint(pre_grasp),
        Move::straight(0, down),
        Move::open(&[0], 6),
        Move::straight(0, down),
    ]
}
