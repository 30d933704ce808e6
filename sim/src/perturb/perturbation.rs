//! The perturbations of the benchmark, what each affects, and the tasks to which it applies.

use scene::{Role, ScaledBy, SceneSpec};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Declares the enum, the slice of all its variants in the same order, and their names.
macro_rules! perturbations {
    ($($variant:ident => $name:literal,)+) => {
        /// A perturbation of the benchmark. See docs/benchmark.md, "Perturbations".
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[expect(missing_docs, reason = "`name` and `apply` describe the variants")]
        pub enum Perturbation { $($variant,)+ }

        impl Perturbation {
            /// All perturbations, starting with the unperturbed condition.
            pub const ALL: &[Self] = &[$(Self::$variant,)+];

            /// Returns the name used in the paper, on the command line and in results.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)+ }
            }
        }
    };
}

perturbations! {
    None => "None",
    MoColor => "MO-Color",
    RoColor => "RO-Color",
    MoTexture => "MO-Texture",
    RoTexture => "RO-Texture",
    TableColor => "Table-Color",
    TableTexture => "Table-Texture",
    LightColor => "Light-Color",
    DistractorObjects => "Distractor-Objects",
    BackgroundColor => "Background-Color",
    BackgroundTexture => "Background-Texture",
    CameraPose => "Camera-Pose",
    LanguageParaphrase => "Language-Paraphrase",
    LanguageNone => "Language-None",
    LanguageRandom => "Language-Random",
    LanguageOtherTask => "Language-Other-Task",
    MoSize => "MO-Size",
    RoSize => "RO-Size",
    PoseRandomization => "Pose-Randomization",
    All => "All",
}

/// The modality that a perturbation affects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Modality {
    /// Observation images only.
    Vision,
    /// The language instruction only.
    Language,
    /// The required motion: sizes and initial poses of bodies.
    Action,
    /// Images, instruction and required motion together.
    Mixed,
}

/// The error returned for a perturbation that has no effect on a task.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{reason}")]
pub struct NotApplicable {
    /// Reason, as a clause without a final period.
    pub reason: String,
}

impl Perturbation {
    /// Returns the affected modality; `None` for the unperturbed condition.
    #[must_use]
    pub const fn modality(self) -> Option<Modality> {
        match self {
            Self::None => None,
            Self::MoColor
            | Self::RoColor
            | Self::MoTexture
            | Self::RoTexture
            | Self::TableColor
            | Self::TableTexture
            | Self::LightColor
            | Self::DistractorObjects
            | Self::BackgroundColor
            | Self::BackgroundTexture
            | Self::CameraPose => Some(Modality::Vision),
            Self::LanguageParaphrase
            | Self::LanguageNone
            | Self::LanguageRandom
            | Self::LanguageOtherTask => Some(Modality::Language),
            Self::MoSize | Self::RoSize | Self::PoseRandomization => Some(Modality::Action),
            Self::All => Some(Modality::Mixed),
        }
    }

    /// Returns `true` if the perturbation moves, adds or resizes bodies. The others do not change the
    /// trajectory of a policy that ignores images and instruction.
    #[must_use]
    pub const fn changes_bodies(self) -> bool {
        matches!(self, Self::DistractorObjects)
            || matches!(self.modality(), Some(Modality::Action | Modality::Mixed))
    }

    /// Checks that the perturbation has an effect on the task with this nominal distribution. The result
    /// follows from the bodies' roles and the placement regions.
    ///
    /// # Errors
    /// If it has no effect, with the reason.
    pub fn applies_to(self, nominal: &SceneSpec) -> Result<(), NotApplicable> {
        let applies = match self {
            Self::MoColor | Self::MoTexture => has_role(nominal, Role::ManipulationObject),
            Self::RoColor | Self::RoTexture => has_role(nominal, Role::ReceiverObject),
            Self::MoSize => is_scaled(nominal, ScaledBy::MoSize, Role::ManipulationObject),
            Self::RoSize => is_scaled(nominal, ScaledBy::RoSize, Role::ReceiverObject),
            Self::PoseRandomization => has_widened_region(nominal),
            Self::None
            | Self::TableColor
            | Self::TableTexture
            | Self::LightColor
            | Self::DistractorObjects
            | Self::BackgroundColor
            | Self::BackgroundTexture
            | Self::CameraPose
            | Self::LanguageParaphrase
            | Self::LanguageNone
            | Self::LanguageRandom
            | Self::LanguageOtherTask
            | Self::All => Ok(()),
        };
        applies.map_err(|reason| NotApplicable { reason })
    }
}

fn has_role(nominal: &SceneSpec, role: Role) -> Result<(), String> {
    if nominal.bodies.iter().any(|body| body.role == role) {
        Ok(())
    } else {
        Err(format!("the task has no {}", role.name()))
    }
}

fn has_widened_region(nominal: &SceneSpec) -> Result<(), String> {
    if nominal.regions.iter().any(|region| region.widened.is_some()) {
        Ok(())
    } else {
        Err("the benchmark does not widen its placement regions".to_owned())
    }
}

fn is_scaled(nominal: &SceneSpec, by: ScaledBy, role: Role) -> Result<(), String> {
    if nominal.bodies.iter().any(|body| body.scaled_by == by) {
        return Ok(());
    }
    has_role(nominal, role)?;
    let pinned = nominal.bodies.iter().filter(|body| body.role == role).find_map(|body| {
        if let ScaledBy::Nothing(reason) = body.scaled_by { Some((body.name, reason)) } else { None }
    });
    Err(match pinned {
        Some((name, reason)) => format!("the size of {name} is pinned: {reason}"),
        None => format!("the {}s of the task are scaled by another perturbation", role.name()),
    })
}
