//! Perturbations that act together.

use core::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Modality, NotApplicable, Perturbation, Strength};
use crate::profile::Profile;
use crate::scene::SceneSpec;
use crate::task::Task;

/// Between the names of perturbations that act together.
const PLUS: &str = "+";

/// One or several perturbations that act together, such as `MO-Color+Camera-Pose`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "Vec<Perturbation>", into = "Vec<Perturbation>")]
pub struct Composition {
    /// Bit i stands for the i-th of [`Perturbation::ALL`].
    bits: u32,
}

/// Perturbations that make no composition.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages say what they are")]
pub enum Incompatible {
    #[error("{name} stands alone: it cannot be composed with others")]
    Alone { name: &'static str },
    #[error("{first} and {second} cannot act together: an episode has one instruction")]
    Languages { first: &'static str, second: &'static str },
}

impl Composition {
    /// What is composed of these; of one, that one itself.
    ///
    /// # Errors
    /// If two of them cannot act together.
    pub fn new(perturbations: &[Perturbation]) -> Result<Self, Incompatible> {
        let bits = perturbations.iter().fold(0, |bits, perturbation| bits | bit(*perturbation));
        let all = Self { bits };
        let alone = |p: &Perturbation| matches!(p.modality(), None | Some(Modality::Mixed));
        if let Some(lonely) = all.iter().find(alone).filter(|_| all.iter().count() > 1) {
            return Err(Incompatible::Alone { name: lonely.name() });
        }
        let mut languages = all.iter().filter(|p| p.modality() == Some(Modality::Language));
        if let (Some(first), Some(second)) = (languages.next(), languages.next()) {
            return Err(Incompatible::Languages { first: first.name(), second: second.name() });
        }
        Ok(all)
    }

    /// That one alone.
    #[must_use]
    pub const fn alone(perturbation: Perturbation) -> Self {
        Self { bits: bit(perturbation) }
    }

    /// Its perturbations, in the order of [`Perturbation::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Perturbation> {
        Perturbation::ALL.iter().copied().filter(move |perturbation| self.bits & bit(*perturbation) != 0)
    }

    /// Name on the command line and in results.
    #[must_use]
    pub fn name(self) -> String {
        let names: Vec<&str> = self.iter().map(Perturbation::name).collect();
        names.join(PLUS)
    }

    /// Parts of a typed name, which need not be those of perturbations.
    pub fn split(typed: &str) -> impl Iterator<Item = &str> {
        typed.split(PLUS).map(str::trim)
    }

    /// Whether each of its perturbations changes this task's distribution.
    ///
    /// # Errors
    /// The first that does not, with the reason.
    pub fn applies_to(self, nominal: &SceneSpec) -> Result<(), (Perturbation, NotApplicable)> {
        self.iter().try_for_each(|perturbation| {
            perturbation.applies_to(nominal).map_err(|error| (perturbation, error))
        })
    }

    /// Whether any of them moves, adds or resizes bodies.
    #[must_use]
    pub fn changes_bodies(self) -> bool {
        self.iter().any(Perturbation::changes_bodies)
    }

    /// The task's distribution so perturbed.
    #[must_use]
    pub fn spec(self, task: &Task, profile: Profile, strength: Strength) -> SceneSpec {
        let nominal = (task.nominal)();
        self.iter().fold(nominal, |spec, perturbation| perturbation.apply(spec, task, profile, strength))
    }
}

const fn bit(perturbation: Perturbation) -> u32 {
    1 << perturbation as u32
}

impl From<Perturbation> for Composition {
    fn from(perturbation: Perturbation) -> Self {
        Self::alone(perturbation)
    }
}

impl TryFrom<Vec<Perturbation>> for Composition {
    type Error = Incompatible;

    fn try_from(perturbations: Vec<Perturbation>) -> Result<Self, Incompatible> {
        Self::new(&perturbations)
    }
}

impl From<Composition> for Vec<Perturbation> {
    fn from(composition: Composition) -> Self {
        composition.iter().collect()
    }
}

impl fmt::Debug for Composition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name())
    }
}
