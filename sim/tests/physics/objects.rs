//! Mass, size and resting height of the manipulated objects against the original's, as measured on its
//! running simulator (docs/benchmark.md, "Objects").

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use sim::physics::World;
use sim::scene::stream::episode_seed;
use sim::{Profile, TaskId};

/// Greatest relative error of a mass.
const MASS_TOLERANCE: f64 = 0.05;
/// Greatest relative error of an extent, and the absolute error that is allowed besides, in m.
const EXTENT_TOLERANCE: (f64, f64) = (0.02, 0.002);
/// Greatest error of the resting height of an origin, in m.
const HEIGHT_TOLERANCE_M: f64 = 0.002;

/// An object of the original.
struct Object {
    task: TaskId,
    body: &'static str,
    /// Mass in kg.
    mass_kg: f64,
    /// Extents of the bounding box of its collision hulls in its own frame, the largest first, in m.
    extents_m: [f64; 3],
    /// World z of its origin once it rests, in m.
    rest_z_m: f64,
}

const fn object(
    task: TaskId,
    body: &'static str,
    mass_kg: f64,
    extents_m: [f64; 3],
    rest_z_m: f64,
) -> Object {
    Object { task, body, mass_kg, extents_m, rest_z_m }
}

#[rustfmt::skip]
const OBJECTS: &[Object] = &[
    object(TaskId::RaiseCube, "cube", 0.064, [0.04, 0.04, 0.04], 0.02),
    object(TaskId::PickSodaFromCabinet, "can", 0.541, [0.1282, 0.077, 0.077], 0.3901),
    object(TaskId::PickDishFromRack, "plate", 0.1365, [0.183, 0.183, 0.048], 0.1214),
    object(TaskId::StackCube, "red cube", 0.064, [0.04, 0.04, 0.04], 0.02),
    object(TaskId::PlaceBookInShelf, "book", 0.563, [0.1113, 0.0991, 0.0535], 0.0737),
    object(TaskId::PlaceDishInRack, "plate", 0.1365, [0.183, 0.183, 0.048], 0.0227),
    object(TaskId::LiftPegUpright, "peg", 0.6, [0.24, 0.05, 0.05], 0.025),
    object(TaskId::RotateArrow, "arrow", 0.194, [0.2474, 0.063, 0.0239], 0.0116),
    object(TaskId::PlugCharger, "charger", 0.0291, [0.056, 0.03, 0.024], 0.012),
    object(TaskId::ScoopBanana, "dustpan", 0.386, [0.202, 0.1762, 0.0613], 0.0311),
    object(TaskId::PlaceCubeInDrawer, "cube", 0.343, [0.07, 0.07, 0.07], 0.035),
    object(TaskId::PlaceCubeInDrawer, "drawer", 5.91, [0.483, 0.4443, 0.256], 0.2536),
    object(TaskId::CookItemInPan, "pan", 0.0534, [0.3458, 0.2158, 0.0307], -0.0018),
    object(TaskId::DualArmCubeHandover, "cube", 0.064, [0.04, 0.04, 0.04], 0.845),
    object(TaskId::DualArmBottleHandover, "bottle", 0.774, [0.2525, 0.0704, 0.0704], 0.865),
    object(TaskId::DualArmLiftPot, "pot", 3.449, [0.3668, 0.3076, 0.1816], 0.8283),
    object(TaskId::DualArmLiftTray, "tray", 1.802, [0.395, 0.2708, 0.0461], 0.8276),
    object(TaskId::DualArmPushBox, "box", 3.072, [0.24, 0.16, 0.08], 0.865),
    object(TaskId::DualArmPourPot, "tomato", 0.202, [0.0771, 0.076, 0.0614], 0.841),
    object(TaskId::DualArmThreading, "needle", 1.19, [0.125, 0.04, 0.04], 0.845),
    object(TaskId::DualArmThreading, "tripod", 0.2504, [0.3301, 0.1656, 0.157], 0.8851),
    object(TaskId::DualArmPenCap, "pen", 0.33, [0.3952, 0.0383, 0.0382], 0.8443),
    object(TaskId::DualArmPenCap, "cap", 0.2955, [0.1869, 0.0689, 0.0556], 0.8522),
    object(TaskId::DualArmStackCube, "red cube", 0.064, [0.04, 0.04, 0.04], 0.845),
];

#[test]
fn objects_equal_the_originals() {
    let mut errors = Vec::new();
    for object in OBJECTS {
        let task = object.task.task();
        let scene = (task.nominal)(Profile::Strict).draw(episode_seed(0, object.task.name(), 0));
        let idx = scene.body_idx(object.body);
        let mut world = World::build(&scene, ControlMode::JointPos);
        let mut row = vec![0.0; ControlMode::JointPos.action_dim(task.morphology)];
        for _ in 0..30 {
            for (arm, row) in row.chunks_exact_mut(8).enumerate() {
                row[..7].copy_from_slice(&world.qpos(arm)[..7]);
                row[7] = 1.0;
            }
            world.step(&row);
        }
        let aabb = scene.bodies[idx].aabb(&Isometry3::identity());
        let mut extents: Vec<f64> = Vector3::iter(&(aabb.max - aabb.min)).copied().collect();
        extents.sort_by(|a, b| b.total_cmp(a));
        let name = format!("{} {}", object.task.name(), object.body);
        let mass = f64::from(world.body_mass(idx));
        if (mass / object.mass_kg - 1.0).abs() > MASS_TOLERANCE {
            errors.push(format!("{name}: mass {mass:.4} kg, the original's is {}", object.mass_kg));
        }
        let (relative, absolute) = EXTENT_TOLERANCE;
        for (ours, original) in extents.iter().zip(object.extents_m) {
            if (ours - original).abs() > relative * original + absolute {
                errors.push(format!("{name}: extent {ours:.4} m, the original's is {original}"));
            }
        }
        let z = f64::from(world.body_pose(idx).translation.z);
        if (z - object.rest_z_m).abs() > HEIGHT_TOLERANCE_M {
            errors.push(format!("{name}: rests at z {z:.4}, the original at {}", object.rest_z_m));
        }
    }
    assert!(errors.is_empty(), "\n{}", errors.join("\n"));
}

#[test]
fn chest_handle_is_where_the_originals_is() {
    let task = TaskId::PlaceCubeInDrawer;
    let scene = (task.task().nominal)(Profile::Strict).draw(episode_seed(0, task.name(), 0));
    let [chest, drawer] = ["cabinet", "drawer"].map(|name| scene.body(name).pose);
    let expected = chest.translation.vector + Vector3::new(-0.006, 0.2962, 0.2536);
    let handle = drawer.translation.vector;
    assert!((handle - expected).norm() < 1e-3, "at {handle}, the original's is at {expected}");
    assert!((drawer.rotation * Vector3::x() - Vector3::y()).norm() < 1e-6, "the front faces +y");
}
