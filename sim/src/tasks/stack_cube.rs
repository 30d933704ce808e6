//! StackCube: put the red cube on the green one (spec/tasks.md §2, task 4).

use core::f64::consts::TAU;

use ipc_types::Morphology;

use super::common::{DENSITY, Eyes, FRICTION, NOISE_RAD, QPOS_D, SINGLE_TABLE_Z, single_arm};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{
    BodySpec, Motion, PaintSpec, PartSpec, PlacementSpec, Primitive, Range, RegionSpec, Role, ScaledBy, Scene, SceneSpec,
};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "StackCubeColosseumV2-v1",
    category: Category::PickAndPlace,
    morphology: Morphology::Single,
    max_steps: 142,
    instruction: "stack red cube on top of green cube",
    nominal,
    success,
    expert,
};

const HALF: f64 = 0.02;
/// Half the diagonal of a cube's face, in m, as the released code rounds it.
const HALF_DIAGONAL: f64 = 0.0283;

fn nominal() -> SceneSpec {
    // The released code scales both cubes under MO-Size and none under RO-Size; we follow it, so RO-Size does not apply.
    let cube = |name, role, color| BodySpec {
        name,
        role,
        motion: Motion::Dynamic,
        parts: vec![PartSpec::at(Primitive::Box { half: [HALF; 3] }, [0.0; 3], PaintSpec::plain(color))],
        scaled_by: ScaledBy::MoSize,
        scale: Range::fixed(1.0),
        placement: PlacementSpec {
            region: 0,
            surface_z_m: SINGLE_TABLE_Z,
            upright: nalgebra::UnitQuaternion::identity(),
            yaw: Range::new(0.0, TAU),
        },
        density: DENSITY,
        friction: FRICTION,
    };
    let cubes = vec![
        cube("red cube", Role::ManipulationObject, [1.0, 0.0, 0.0]),
        cube("green cube", Role::ReceiverObject, [0.0, 1.0, 0.0]),
    ];
    let region = RegionSpec {
        name: "cubes",
        x: Range::symmetric(0.1),
        y: Range::symmetric(0.2),
        common: [Range::symmetric(0.1); 2],
        gap_m: Some(0.002),
    };
    let target = [-0.1, 0.0, 0.1];
    let eyes = Eyes { external1: [[0.3, 0.0, 0.4], target], external2: [[0.0, -0.3, 0.4], target] };
    single_arm(QPOS_D, NOISE_RAD, &eyes, vec![region], cubes, TASK.instruction)
}

/// Red on green within half a face diagonal and 5 mm, at rest, let go.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let (red, green) = (scene.body_idx("red cube"), scene.body_idx("green cube"));
    let scale = |body: usize| if profile.scales_thresholds() { scene.bodies[body].scale } else { 1.0 };
    vec![
        Predicate::On {
            top: red,
            base: green,
            xy_m: HALF_DIAGONAL * scale(green) + 0.005,
            rise_m: HALF * (scale(red) + scale(green)),
            rise_tolerance_m: 0.005,
        },
        Predicate::Still { body: red, max_linear: 0.01, max_angular: 0.5 },
        Predicate::Released { body: red },
    ]
}
