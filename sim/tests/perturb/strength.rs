//! Perturbations at less than full strength.

use sim::perturb::{Composition, Strength};
use sim::scene::{Jitter, SceneSpec};
use sim::{Perturbation, Profile, TaskId};

use crate::common::{nominal, seeds, singles};

fn at(strength: f64, task: TaskId, perturbation: Perturbation) -> SceneSpec {
    let strength = Strength::try_from(strength).unwrap();
    Composition::from(perturbation).spec(task.task(), Profile::Strict, strength)
}

#[test]
fn ranges_shrink_towards_nominal_values() {
    let task = TaskId::RaiseCube;
    let spec = at(0.5, task, Perturbation::All);
    let cube = &spec.bodies[0];
    assert_eq!([cube.scale.lo, cube.scale.hi], [0.9, 1.1]);
    let region = &spec.regions[0];
    assert_eq!([region.x.lo, region.x.hi].map(|x| (x * 1e9).round()), [-0.125e9, 0.125e9]);
    let Jitter { translation, rotation } = spec.cameras[0].jitter;
    assert_eq!(translation.map(|range| [range.lo, range.hi]), [[-0.015, 0.015]; 3]);
    assert_eq!(rotation.map(|range| [range.lo, range.hi]), [[-0.0175, 0.0175]; 3]);
    let lights = &spec.lights;
    assert_eq!(lights.directional.len(), 2, "the second light fades to half");
    assert_eq!(lights.directional[1].color.map(|range| [range.lo, range.hi]), [[0.5, 0.5]; 3]);
    assert_eq!(lights.directional[0].color.map(|range| [range.lo, range.hi]), [[0.75, 1.0]; 3]);
}

#[test]
fn colours_deviate_by_at_most_half() {
    let task = TaskId::RaiseCube;
    let spec = at(0.5, task, Perturbation::MoColor);
    let nominal_color = nominal(task).bodies[0].parts[0].appearance.color;
    let mut max_deviation = [0.0_f64; 3];
    for seed in seeds(task, 1000) {
        let color = spec.draw(seed).bodies[0].parts[0].appearance.color;
        for (channel, (c, from)) in color.into_iter().zip(nominal_color).enumerate() {
            assert!((0.5 * from..=0.5 * from + 0.5).contains(&c));
            max_deviation[channel] = max_deviation[channel].max((c - from).abs());
        }
    }
    assert!(max_deviation.iter().all(|deviation| *deviation > 0.25), "{max_deviation:?}");
}

#[test]
fn discrete_replacements_happen_with_the_strength_as_probability() {
    let task = TaskId::RaiseCube;
    let n = 2000;
    let fraction = |perturbation, differs: fn(&scene::Scene) -> usize| {
        let spec = at(0.5, task, perturbation);
        seeds(task, n).map(|seed| differs(&spec.draw(seed))).sum::<usize>() as f64 / f64::from(n)
    };
    let is_replaced =
        |scene: &scene::Scene| usize::from(scene.instruction != TaskId::RaiseCube.task().instruction);
    let half = [
        fraction(Perturbation::LanguageParaphrase, is_replaced),
        fraction(Perturbation::LanguageNone, is_replaced),
        fraction(Perturbation::MoTexture, |scene| {
            usize::from(scene.bodies[0].parts[0].appearance.texture.is_some())
        }),
        fraction(Perturbation::DistractorObjects, |scene| scene.bodies.len() - 1) / 2.0,
    ];
    assert!(half.iter().all(|fraction| (0.46..0.54).contains(fraction)), "{half:?}");
}

#[test]
fn least_strength_changes_almost_nothing() {
    for &task in TaskId::ALL {
        for perturbation in singles() {
            let (weak, nominal) = (at(0.001, task, perturbation), nominal(task));
            let seed = seeds(task, 1).next().unwrap();
            let (weak, twin) = (weak.draw(seed), nominal.draw(seed));
            assert_eq!(weak.instruction, twin.instruction);
            assert_eq!(weak.bodies.len(), twin.bodies.len());
            for (body, twin) in weak.bodies.iter().zip(&twin.bodies) {
                let apart = (body.pose.translation.vector - twin.pose.translation.vector).norm();
                assert!(apart < 1e-3, "{} {} {}: {apart} m", task.name(), perturbation.name(), body.name);
            }
        }
    }
}

#[test]
fn strength_is_restricted_to_zero_to_one() {
    for invalid in [0.0, -0.1, 1.001, f64::NAN, f64::INFINITY] {
        assert!(Strength::try_from(invalid).is_err(), "{invalid}");
    }
    let message = Strength::try_from(2.0).unwrap_err().to_string();
    assert_eq!(message, "strength is 2, expected a number from 0.001 to 1 (the benchmark's strength)");
    assert_eq!(Strength::try_from(1.0).unwrap(), Strength::FULL);
}
