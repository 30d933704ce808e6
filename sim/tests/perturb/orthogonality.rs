//! Perturbations are orthogonal: each edits only its own fields and changes no other sampled value.

use sim::perturb::{Composition, Modality, Strength};
use sim::scene::{Appearance, AppearanceVariation, BodySpec, CameraMount, Jitter, Role, Scene, SceneSpec};
use sim::{Perturbation, Profile, TaskId};

use crate::common::{applies, nominal, perturbed, seeds, singles};

#[test]
fn any_two_perturbations_commute() {
    for &task in TaskId::ALL {
        let apply = |spec, p: Perturbation| p.apply(spec, task.task(), Profile::Strict, Strength::FULL);
        for a in singles() {
            for b in singles().filter(|b| *b != a) {
                if [a, b].iter().all(|p| p.modality() == Some(Modality::Language)) {
                    assert!(Composition::new(&[a, b]).is_err(), "two language perturbations");
                    continue;
                }
                let orders = [[a, b], [b, a]].map(|order| order.into_iter().fold(nominal(task), apply));
                assert_eq!(orders[0], orders[1], "{} {} {}", task.name(), a.name(), b.name());
                let composed = Composition::new(&[b, a]).unwrap();
                assert_eq!(composed.spec(task.task(), Profile::Strict, Strength::FULL), orders[0]);
            }
        }
    }
}

/// Resets the fields of a spec that a perturbation may edit to those of `from`.
fn restore(perturbation: Perturbation, spec: &mut SceneSpec, from: &SceneSpec) {
    fn appearances<'a>(spec: &'a mut SceneSpec, role: Role, restore: impl Fn(&mut AppearanceVariation) + 'a) {
        let bodies = spec.bodies.iter_mut().filter(move |body| body.role == role);
        bodies.flat_map(BodySpec::appearances_mut).for_each(|appearance| restore(&mut appearance.variation));
    }
    let color = |variation: &mut AppearanceVariation| variation.color = 0.0;
    let texture = |variation: &mut AppearanceVariation| variation.texture = 0.0;
    match perturbation {
        Perturbation::None | Perturbation::All => unreachable!("composite conditions own no fields"),
        Perturbation::MoColor => appearances(spec, Role::ManipulationObject, color),
        Perturbation::RoColor => appearances(spec, Role::ReceiverObject, color),
        Perturbation::MoTexture => appearances(spec, Role::ManipulationObject, texture),
        Perturbation::RoTexture => appearances(spec, Role::ReceiverObject, texture),
        Perturbation::TableColor => {
            spec.table.as_block = false;
            spec.table.appearances_mut().for_each(|appearance| color(&mut appearance.variation));
        }
        Perturbation::TableTexture => {
            spec.table.appearances_mut().for_each(|appearance| texture(&mut appearance.variation));
        }
        Perturbation::BackgroundColor => color(&mut spec.background.walls.variation),
        Perturbation::BackgroundTexture => texture(&mut spec.background.walls.variation),
        Perturbation::LightColor => spec.lights = from.lights.clone(),
        Perturbation::DistractorObjects => spec.distractors.presence = 0.0,
        Perturbation::CameraPose => spec.cameras.iter_mut().for_each(|camera| camera.jitter = Jitter::NONE),
        Perturbation::LanguageParaphrase
        | Perturbation::LanguageNone
        | Perturbation::LanguageRandom
        | Perturbation::LanguageOtherTask => spec.instruction.replacement = None,
        Perturbation::MoSize | Perturbation::RoSize => {
            for (body, nominal) in spec.bodies.iter_mut().zip(&from.bodies) {
                body.scale = nominal.scale;
            }
        }
        Perturbation::PoseRandomization => spec.regions.clone_from(&from.regions),
    }
}

#[test]
fn perturbations_edit_only_their_own_fields() {
    for &task in TaskId::ALL {
        let nominal = nominal(task);
        for perturbation in singles() {
            let cell = format!("{} {}", task.name(), perturbation.name());
            let mut spec = perturbed(task, perturbation);
            assert_eq!(spec != nominal, applies(perturbation, task), "{cell}");
            restore(perturbation, &mut spec, &nominal);
            assert_eq!(spec, nominal, "{cell}");
        }
    }
}

/// Resets the fields of a scene that a perturbation may change to those of the unperturbed `twin`.
fn undo(perturbation: Perturbation, scene: &mut Scene, twin: &Scene) {
    let restore_appearances = |scene: &mut Scene, role: Role| {
        for (body, twin) in scene.bodies.iter_mut().zip(&twin.bodies).filter(|(body, _)| body.role == role) {
            for (part, twin) in body.parts.iter_mut().zip(&twin.parts) {
                part.appearance = twin.appearance;
            }
            for (visual, twin) in body.visuals.iter_mut().zip(&twin.visuals) {
                visual.appearance = twin.appearance;
            }
        }
    };
    match perturbation {
        Perturbation::None | Perturbation::All => unreachable!("composite conditions own no draws"),
        Perturbation::MoColor | Perturbation::MoTexture => {
            restore_appearances(scene, Role::ManipulationObject);
        }
        Perturbation::RoColor | Perturbation::RoTexture => restore_appearances(scene, Role::ReceiverObject),
        Perturbation::TableColor | Perturbation::TableTexture => scene.table = twin.table.clone(),
        Perturbation::BackgroundColor | Perturbation::BackgroundTexture => scene.background.walls = None,
        Perturbation::LightColor => scene.lights = twin.lights.clone(),
        Perturbation::DistractorObjects => scene.bodies.truncate(twin.bodies.len()),
        Perturbation::CameraPose => {
            for (camera, twin) in scene.cameras.iter_mut().zip(&twin.cameras) {
                if matches!(camera.mount, CameraMount::World { .. }) {
                    camera.pose_error = twin.pose_error;
                }
            }
        }
        Perturbation::LanguageParaphrase
        | Perturbation::LanguageNone
        | Perturbation::LanguageRandom
        | Perturbation::LanguageOtherTask => scene.instruction.clone_from(&twin.instruction),
        Perturbation::MoSize | Perturbation::RoSize => {
            for (body, twin) in scene.bodies.iter_mut().zip(&twin.bodies) {
                let appearances = |body: &scene::Body| -> Vec<Appearance> {
                    let visuals = body.visuals.iter().map(|visual| visual.appearance);
                    body.parts.iter().map(|part| part.appearance).chain(visuals).collect()
                };
                assert_eq!(appearances(body), appearances(twin), "scaling must not change appearances");
                assert_eq!((body.mass, body.friction), (twin.mass.stretched(&body.scale), twin.friction));
                *body = twin.clone();
            }
        }
        Perturbation::PoseRandomization => {
            for (body, twin) in scene.bodies.iter_mut().zip(&twin.bodies) {
                body.pose = twin.pose;
            }
        }
    }
}

#[test]
fn unrelated_draws_equal_those_of_the_twin() {
    for &task in TaskId::ALL {
        for perturbation in singles() {
            let spec = perturbed(task, perturbation);
            for seed in seeds(task, 4) {
                let (mut scene, twin) = (spec.draw(seed), nominal(task).draw(seed));
                undo(perturbation, &mut scene, &twin);
                assert_eq!(scene, twin, "{} {}", task.name(), perturbation.name());
            }
        }
    }
}

#[test]
fn scaled_body_keeps_position_and_rests_on_surface() {
    let task = TaskId::RaiseCube;
    let spec = perturbed(task, Perturbation::MoSize);
    for seed in seeds(task, 20) {
        let (scaled, twin) = (spec.draw(seed), nominal(task).draw(seed));
        let [at, twin_at] = [&scaled, &twin].map(|scene| scene.bodies[0].pose);
        assert_eq!((at.translation.x, at.translation.y), (twin_at.translation.x, twin_at.translation.y));
        assert_eq!(at.rotation, twin_at.rotation);
        assert!((at.translation.z - twin_at.translation.z * scaled.bodies[0].scale.x).abs() < 1e-12);
    }
}

#[test]
fn all_equals_composition_of_included_perturbations() {
    let is_included =
        |p: &Perturbation| p.modality() != Some(Modality::Language) || *p == Perturbation::LanguageParaphrase;
    let included: Vec<Perturbation> = singles().filter(is_included).collect();
    let composed = Composition::new(&included).unwrap();
    for &task in TaskId::ALL {
        let all = perturbed(task, Perturbation::All);
        assert_eq!(all, composed.spec(task.task(), Profile::Strict, Strength::FULL), "{}", task.name());
    }
}
