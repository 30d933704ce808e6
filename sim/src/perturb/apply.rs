//! What each perturbation does to a distribution (spec/perturbations.md §3).

use core::f64::consts::{FRAC_1_SQRT_2, PI};

use super::{Modality, Perturbation, Strength};
use crate::profile::Profile;
use crate::scene::{
    BodySpec, CameraMount, CameraSpec, Jitter, LightsSpec, PaintSpec, Range, RegionSpec, Role, ScaledBy,
    SceneSpec, Wording,
};
use crate::task::Task;
use crate::tasks::TaskId;

impl Perturbation {
    /// The perturbed distribution. Each edits fields of its own, so that the order does not matter; where it does not apply
    /// it changes nothing.
    #[must_use]
    pub fn apply(self, mut spec: SceneSpec, task: &Task, profile: Profile, strength: Strength) -> SceneSpec {
        let share = strength.get();
        match self {
            Self::None => {}
            Self::MoColor => recolor(paints_of(&mut spec, Role::ManipulationObject), share),
            Self::RoColor => recolor(paints_of(&mut spec, Role::ReceiverObject), share),
            Self::MoTexture => retexture(paints_of(&mut spec, Role::ManipulationObject), share),
            Self::RoTexture => retexture(paints_of(&mut spec, Role::ReceiverObject), share),
            Self::TableColor => recolor(spec.table.paints_mut(), share),
            Self::TableTexture => retexture(spec.table.paints_mut(), share),
            Self::BackgroundColor => recolor([&mut spec.background.walls], share),
            Self::BackgroundTexture => retexture([&mut spec.background.walls], share),
            Self::LightColor => relight(&mut spec.lights, share),
            Self::DistractorObjects => spec.distractors.presence = share,
            Self::CameraPose => shake(&mut spec.cameras, profile, share),
            Self::MoSize => resize(&mut spec.bodies, ScaledBy::MoSize, share),
            Self::RoSize => resize(&mut spec.bodies, ScaledBy::RoSize, share),
            Self::PoseRandomization => spec.regions.iter_mut().for_each(|region| widen(region, share)),
            Self::LanguageParaphrase => {
                spec.instruction.other = Some((Wording::OneOf(task.paraphrases.lines().collect()), share));
            }
            Self::LanguageNone => spec.instruction.other = Some((Wording::OneOf(vec![""]), share)),
            Self::LanguageRandom => spec.instruction.other = Some((Wording::RandomWords, share)),
            Self::LanguageOtherTask => {
                spec.instruction.other = Some((Wording::OneOf(instructions_beside(task)), share));
            }
            Self::All => {
                let parts = Self::ALL.iter().filter(|part| part.is_part_of_all());
                spec = parts.fold(spec, |spec, part| part.apply(spec, task, profile, strength));
            }
        }
        spec
    }

    /// Whether All includes it: of the four ways to say something else it has only paraphrases.
    pub(super) fn is_part_of_all(self) -> bool {
        match self.modality() {
            Some(Modality::Vision | Modality::Action) => true,
            Some(Modality::Language) => self == Self::LanguageParaphrase,
            Some(Modality::Mixed) | None => false,
        }
    }
}

fn paints_of(spec: &mut SceneSpec, role: Role) -> impl Iterator<Item = &mut PaintSpec> {
    spec.bodies.iter_mut().filter(move |body| body.role == role).flat_map(BodySpec::paints_mut)
}

fn recolor<'a>(paints: impl IntoIterator<Item = &'a mut PaintSpec>, share: f64) {
    paints.into_iter().for_each(|paint| paint.variation.color = share);
}

fn retexture<'a>(paints: impl IntoIterator<Item = &'a mut PaintSpec>, share: f64) {
    paints.into_iter().for_each(|paint| paint.variation.texture = share);
}

/// Ambient light of half to one and a half times its strength; one directional light, of any hue down to half its strength,
/// 45° high, from any side and with shadows. The second light fades out.
fn relight(lights: &mut LightsSpec, share: f64) {
    for channel in &mut lights.ambient {
        *channel = Range::new(0.5 * channel.lo, 1.5 * channel.hi).towards(*channel, share);
    }
    if let [first, others @ ..] = lights.directional.as_mut_slice() {
        first.color = first.color.map(|channel| Range::new(0.5, 1.0).towards(channel, share));
        for (at, aslant) in first.direction.iter_mut().zip([FRAC_1_SQRT_2, FRAC_1_SQRT_2, -1.0]) {
            *at = Range::fixed(aslant).about(*at, share).lo;
        }
        first.turn = Range::symmetric(PI * share);
        for light in others {
            light.color = light.color.map(|channel| Range::fixed(0.0).towards(channel, share));
        }
    }
    lights.directional.retain(|light| light.color.iter().any(|channel| channel.hi > 0.0));
    lights.shadows = true;
}

/// Errors of the external cameras' poses.
fn shake(cameras: &mut [CameraSpec], profile: Profile, share: f64) {
    let external = |camera: &&mut CameraSpec| matches!(camera.mount, CameraMount::World { .. });
    let translation = [Range::symmetric(0.03), Range::symmetric(0.03), profile.camera_jitter_z()];
    for camera in cameras.iter_mut().filter(external) {
        camera.jitter = Jitter {
            translation: translation.map(|range| range.about(0.0, share)),
            rotation: [Range::symmetric(0.035).about(0.0, share); 3],
        };
    }
}

/// Bodies of 0.8 to 1.2 times their size. The benchmark stretches those that it has as meshes along each axis by itself; here
/// all keep their shape.
fn resize(bodies: &mut [BodySpec], by: ScaledBy, share: f64) {
    for body in bodies.iter_mut().filter(|body| body.scaled_by == by) {
        body.scale = Range::new(0.8, 1.2).about(1.0, share);
    }
}

fn widen(region: &mut RegionSpec, share: f64) {
    if let Some(widened) = region.widened {
        region.x = widened.x.towards(region.x, share);
        region.y = widened.y.towards(region.y, share);
        region.common = [0, 1].map(|axis| widened.common[axis].towards(region.common[axis], share));
    }
}

/// What the other tasks of the same morphology are told, each sentence once.
fn instructions_beside(task: &Task) -> Vec<&'static str> {
    let mut sentences = Vec::new();
    for other in TaskId::ALL.iter().map(|id| id.task()) {
        let says_else = other.instruction != task.instruction && !sentences.contains(&other.instruction);
        if other.morphology == task.morphology && says_else {
            sentences.push(other.instruction);
        }
    }
    sentences
}
