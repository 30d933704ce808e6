//! The perturbations: each edits the distribution of scenes, and only the fields it owns. No randomness here.

mod apply;
mod composition;
mod strength;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::scene::{Role, ScaledBy, SceneSpec};

pub use composition::{Composition, Incompatible};
pub use strength::{Strength, StrengthError};

/// Declares the enum and, in the same order, all its variants and their names.
macro_rules! perturbations {
    ($($variant:ident => $name:literal,)+) => {
        /// A perturbation of the benchmark (spec/perturbations.md §1).
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[expect(missing_docs, reason = "`name` and `apply` say what they are")]
        pub enum Perturbation { $($variant,)+ }

        impl Perturbation {
            /// All, the unperturbed condition first.
            pub const ALL: &[Self] = &[$(Self::$variant,)+];

            /// Name in the paper, on the command line and in results.
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

/// What a perturbation acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modality {
    /// What is seen.
    Vision,
    /// What is said.
    Language,
    /// What is to be done: sizes and places.
    Action,
    /// All of these.
    Mixed,
}

/// A perturbation that would change nothing in a task.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{reason}")]
pub struct NotApplicable {
    /// Why.
    pub reason: String,
}

impl Perturbation {
    /// What it acts on; `None` for the unperturbed condition.
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

    /// Whether it moves, adds or resizes bodies; all others leave every trajectory as it is that does not look or listen.
    #[must_use]
    pub const fn changes_bodies(self) -> bool {
        matches!(self, Self::DistractorObjects)
            || matches!(self.modality(), Some(Modality::Action | Modality::Mixed))
    }

    /// Whether the perturbation changes this task's distribution; derived from roles and regions, never listed.
    ///
    /// # Errors
    /// The reason why it does not.
    pub fn applies_to(self, nominal: &SceneSpec) -> Result<(), NotApplicable> {
        let applies = match self {
            Self::MoColor | Self::MoTexture => has_role(nominal, Role::ManipulationObject),
            Self::RoColor | Self::RoTexture => has_role(nominal, Role::ReceiverObject),
            Self::MoSize => is_scaled(nominal, ScaledBy::MoSize, Role::ManipulationObject),
            Self::RoSize => is_scaled(nominal, ScaledBy::RoSize, Role::ReceiverObject),
            Self::PoseRandomization => has_places(nominal),
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

fn has_places(nominal: &SceneSpec) -> Result<(), String> {
    if nominal.regions.iter().any(|region| region.widened.is_some()) {
        Ok(())
    } else {
        Err("its places are those of furniture, which stays".to_owned())
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
