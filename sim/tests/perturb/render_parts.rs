//! MO- and RO-perturbations change as many parts independently as the benchmark's code does
//! (docs/perturbations.md).

use sim::scene::{Appearance, Body, Role, Scene};
use sim::{Perturbation, TaskId};

use crate::common::{applies, perturbed, seeds};

/// Numbers of independent parts of all manipulated and of all receiver objects; 0 where the task refuses to
/// recolour them.
const N_PARTS: [(TaskId, [usize; 2]); TaskId::ALL.len()] = [
    (TaskId::RaiseCube, [1, 0]),
    // The three panels of the cabinet.
    (TaskId::PickSodaFromCabinet, [1, 3]),
    (TaskId::PickDishFromRack, [1, 1]),
    (TaskId::StackCube, [1, 0]),
    // The cover of the book and its pages.
    (TaskId::PlaceBookInShelf, [2, 1]),
    (TaskId::PlaceDishInRack, [1, 1]),
    (TaskId::LiftPegUpright, [2, 0]),
    (TaskId::RotateArrow, [1, 0]),
    (TaskId::PegInsertionSide, [2, 1]),
    // The charger's base and prongs; the receptacle and its inlays.
    (TaskId::PlugCharger, [2, 2]),
    (TaskId::HammerNail, [1, 1]),
    (TaskId::ScoopBanana, [1, 1]),
    (TaskId::OpenDrawer, [0, 0]),
    (TaskId::OpenCabinet, [0, 0]),
    (TaskId::PlaceCubeInDrawer, [0, 0]),
    // The pan and the apple; the stove's two materials.
    (TaskId::CookItemInPan, [2, 2]),
    (TaskId::DualArmCubeHandover, [1, 0]),
    (TaskId::DualArmBottleHandover, [1, 0]),
    (TaskId::DualArmLiftPot, [1, 0]),
    (TaskId::DualArmLiftTray, [1, 0]),
    (TaskId::DualArmPushBox, [1, 1]),
    (TaskId::DualArmPourPot, [1, 1]),
    (TaskId::DualArmThreading, [1, 1]),
    (TaskId::DualArmPenCap, [1, 1]),
    (TaskId::DualArmDrawerPlace, [1, 0]),
    (TaskId::DualArmDrawerOpen, [0, 0]),
    // The cubes; the rings of the goal.
    (TaskId::DualArmStackCube, [2, 5]),
    (TaskId::DualArmStackTwoCubes, [3, 5]),
];

/// Returns the appearances of all rendered shapes of the bodies with a role.
fn rendered(scene: &Scene, role: Role) -> Vec<Appearance> {
    let shapes = |body: &Body| -> Vec<_> {
        if body.visuals.is_empty() {
            body.parts.iter().map(|part| part.appearance).collect()
        } else {
            body.visuals.iter().map(|visual| visual.appearance).collect()
        }
    };
    scene.bodies.iter().filter(|body| body.role == role).flat_map(shapes).collect()
}

#[test]
fn recoloured_parts_are_those_of_the_benchmark() {
    let roles = [
        (Role::ManipulationObject, Perturbation::MoColor, Perturbation::MoTexture),
        (Role::ReceiverObject, Perturbation::RoColor, Perturbation::RoTexture),
    ];
    assert!(N_PARTS.iter().map(|(task, _)| task).eq(TaskId::ALL), "the table is in the order of the tasks");
    for (task, n_parts) in N_PARTS {
        for ((role, color, texture), expected) in roles.into_iter().zip(n_parts) {
            let name = format!("{} {}", task.name(), color.name());
            assert_eq!([color, texture].map(|p| applies(p, task)), [expected > 0; 2], "{name}");
            for seed in seeds(task, if expected > 0 { 3 } else { 0 }) {
                let [colored, textured] =
                    [color, texture].map(|p| rendered(&perturbed(task, p).draw(seed), role));
                // The index of the first shape with the same colour identifies the part.
                let part_of =
                    |shape: &Appearance| colored.iter().position(|other| other.color == shape.color);
                let parts: Vec<_> = colored.iter().map(part_of).collect();
                let mut distinct = parts.clone();
                distinct.sort_unstable();
                distinct.dedup();
                assert_eq!(distinct.len(), expected, "{name}: number of parts");
                for (shape, first) in textured.iter().zip(parts) {
                    let first = &textured[first.expect("every shape is in a part")];
                    assert_eq!(shape.texture, first.texture, "{name}: a part has one texture");
                }
            }
        }
    }
}
