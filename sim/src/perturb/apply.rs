//! Effects of the perturbations on a scene distribution. See docs/benchmark.md, "Perturbations".

use core::f64::consts::{FRAC_1_SQRT_2, PI};

use super::language::Language;
use super::{Modality, Perturbation, Strength};
use crate::task::Task;
use crate::task::profile::{Profile, ProfileRules};
use scene::{
    AppearanceSpec, BodySpec, CameraMount, CameraSpec, InstructionSource, Jitter, LightsSpec, Range,
    RegionSpec, Role, ScaledBy, SceneSpec,
};

impl Perturbation {
    /// Applies the perturbation to a scene distribution.
    ///
    /// Perturbations edit disjoint sets of fields, so the order of application does not matter. A
    /// perturbation that is not applicable to the task changes nothing.
    #[must_use]
    pub fn apply(self, mut spec: SceneSpec, task: &Task, profile: Profile, strength: Strength) -> SceneSpec {
        let weight = strength.get();
        let replace_instruction = |source| Some((source, weight));
        match self {
            Self::None => {}
            Self::MoColor => vary_color(appearances_of(&mut spec, Role::ManipulationObject), weight),
            Self::RoColor => vary_color(appearances_of(&mut spec, Role::ReceiverObject), weight),
            Self::MoTexture => {
                vary_texture(appearances_of(&mut spec, Role::ManipulationObject), weight);
            }
            Self::RoTexture => vary_texture(appearances_of(&mut spec, Role::ReceiverObject), weight),
            Self::TableColor => {
                // The benchmark replaces the mesh of the table, which it cannot recolour.
                spec.table.as_block = true;
                vary_color(spec.table.appearances_mut(), weight);
            }
            Self::TableTexture => vary_texture(spec.table.appearances_mut(), weight),
            Self::BackgroundColor => vary_color([&mut spec.background.walls], weight),
            Self::BackgroundTexture => vary_texture([&mut spec.background.walls], weight),
            Self::LightColor => vary_lights(&mut spec.lights, weight),
            Self::DistractorObjects => {
                spec.distractors.presence = weight;
                spec.distractors.placement = profile.distractor_placement();
            }
            Self::CameraPose => jitter_cameras(&mut spec.cameras, profile, weight),
            Self::MoSize => vary_size(&mut spec.bodies, ScaledBy::MoSize, weight),
            Self::RoSize => vary_size(&mut spec.bodies, ScaledBy::RoSize, weight),
            Self::PoseRandomization => {
                spec.regions.iter_mut().for_each(|region| widen(region, weight));
            }
            Self::LanguageParaphrase => {
                let paraphrases = task.paraphrases.lines().map(str::to_owned).collect();
                spec.instruction.replacement =
                    replace_instruction(InstructionSource::Paraphrase(paraphrases));
            }
            Self::LanguageNone => {
                spec.instruction.replacement = replace_instruction(InstructionSource::Empty);
            }
            Self::LanguageRandom => {
                spec.instruction.replacement = replace_instruction(InstructionSource::RandomWords);
            }
            Self::LanguageOtherTask => {
                let others = Language::default().sentences_of_other_tasks(task);
                spec.instruction.replacement = replace_instruction(InstructionSource::OtherTask(others));
            }
            Self::All => {
                let included = Self::ALL.iter().filter(|part| part.is_included_in_all());
                spec = included.fold(spec, |spec, part| part.apply(spec, task, profile, strength));
            }
        }
        spec
    }

    /// Returns `true` if All includes the perturbation. Of the four language perturbations it includes only
    /// Language-Paraphrase.
    pub(crate) fn is_included_in_all(self) -> bool {
        match self.modality() {
            Some(Modality::Vision | Modality::Action) => true,
            Some(Modality::Language) => self == Self::LanguageParaphrase,
            Some(Modality::Mixed) | None => false,
        }
    }
}

fn appearances_of(spec: &mut SceneSpec, role: Role) -> impl Iterator<Item = &mut AppearanceSpec> {
    spec.bodies.iter_mut().filter(move |body| body.role == role).flat_map(BodySpec::appearances_mut)
}

fn vary_color<'a>(appearances: impl IntoIterator<Item = &'a mut AppearanceSpec>, strength: f64) {
    appearances.into_iter().for_each(|appearance| appearance.variation.color = strength);
}

fn vary_texture<'a>(appearances: impl IntoIterator<Item = &'a mut AppearanceSpec>, strength: f64) {
    appearances.into_iter().for_each(|appearance| appearance.variation.texture = strength);
}

/// Varies the lights. At full strength, each ambient channel is scaled by 0.5 to 1.5, and a single
/// directional light with channels in [0.5, 1] shines from any azimuth at 45° elevation and casts shadows.
/// The second directional light fades out with increasing strength.
fn vary_lights(lights: &mut LightsSpec, strength: f64) {
    for channel in &mut lights.ambient {
        *channel = Range::new(0.5 * channel.lo, 1.5 * channel.hi).blended_from(*channel, strength);
    }
    if let [first, others @ ..] = lights.directional.as_mut_slice() {
        first.color = first.color.map(|channel| Range::new(0.5, 1.0).blended_from(channel, strength));
        let oblique = [FRAC_1_SQRT_2, FRAC_1_SQRT_2, -1.0];
        for (component, oblique) in first.direction.iter_mut().zip(oblique) {
            *component = Range::fixed(oblique).shrunk_to(*component, strength).lo;
        }
        first.yaw = Range::symmetric(PI * strength);
        for light in others {
            light.color = light.color.map(|channel| Range::fixed(0.0).blended_from(channel, strength));
        }
    }
    lights.directional.retain(|light| light.color.iter().any(|channel| channel.hi > 0.0));
    lights.shadows = true;
}

/// Sets the pose errors of the external cameras. Hand cameras are not affected.
fn jitter_cameras(cameras: &mut [CameraSpec], profile: Profile, strength: f64) {
    let is_external = |camera: &&mut CameraSpec| matches!(camera.mount, CameraMount::World { .. });
    let translation = [Range::symmetric(0.03), Range::symmetric(0.03), profile.camera_jitter_z()];
    for camera in cameras.iter_mut().filter(is_external) {
        camera.jitter = Jitter {
            translation: translation.map(|range| range.shrunk_to(0.0, strength)),
            rotation: [Range::symmetric(0.035).shrunk_to(0.0, strength); 3],
        };
    }
}

/// Scales bodies by 0.8 to 1.2, those made from mesh files independently along each axis
/// ([`ScaleAxes`](scene::ScaleAxes)).
fn vary_size(bodies: &mut [BodySpec], by: ScaledBy, strength: f64) {
    for body in bodies.iter_mut().filter(|body| body.scaled_by == by) {
        body.scale = Range::new(0.8, 1.2).shrunk_to(1.0, strength);
    }
}

fn widen(region: &mut RegionSpec, strength: f64) {
    if let Some(widened) = region.widened {
        region.x = widened.x.blended_from(region.x, strength);
        region.y = widened.y.blended_from(region.y, strength);
        region.shared_offset =
            [0, 1].map(|axis| widened.shared_offset[axis].blended_from(region.shared_offset[axis], strength));
    }
}
