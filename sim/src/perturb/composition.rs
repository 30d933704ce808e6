//! Combinations of perturbations that are applied together.

use core::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{Modality, NotApplicable, Perturbation, Strength};
use crate::task::Task;
use crate::task::profile::Profile;
use scene::SceneSpec;

/// Separator between the names of combined perturbations.
const SEPARATOR: &str = "+";

/// A non-empty set of perturbations that are applied together, such as `MO-Color+Camera-Pose`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "Vec<Perturbation>", into = "Vec<Perturbation>")]
pub struct Composition {
    /// Bit set in which bit i represents the i-th element of [`Perturbation::ALL`].
    bits: u32,
}

/// Errors that can occur while combining perturbations.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the variants")]
pub enum CompositionError {
    #[error("a combination of perturbations names none; the unperturbed condition is `None`")]
    Empty,
    #[error("a combination of perturbations names {name} more than once")]
    Repeated { name: &'static str },
    #[error("{name} cannot be combined with other perturbations")]
    NotComposable { name: &'static str },
    #[error("{first} and {second} cannot be combined: an episode has a single instruction")]
    TwoInstructions { first: &'static str, second: &'static str },
}

impl Composition {
    /// Combines perturbations; their order does not matter.
    ///
    /// # Errors
    /// If there is none, one occurs twice, or two of them cannot be combined.
    pub fn new(perturbations: &[Perturbation]) -> Result<Self, CompositionError> {
        let bits = perturbations.iter().fold(0, |bits, perturbation| bits | bit(*perturbation));
        if bits == 0 {
            return Err(CompositionError::Empty);
        }
        let all = Self { bits };
        let repeated = perturbations.iter().enumerate().find(|(i, it)| perturbations[..*i].contains(it));
        if let Some((_, repeated)) = repeated {
            return Err(CompositionError::Repeated { name: repeated.name() });
        }
        let must_be_single = |p: &Perturbation| matches!(p.modality(), None | Some(Modality::Mixed));
        if let Some(not_composable) = all.iter().find(must_be_single).filter(|_| all.iter().count() > 1) {
            return Err(CompositionError::NotComposable { name: not_composable.name() });
        }
        let mut languages = all.iter().filter(|p| p.modality() == Some(Modality::Language));
        if let (Some(first), Some(second)) = (languages.next(), languages.next()) {
            return Err(CompositionError::TwoInstructions { first: first.name(), second: second.name() });
        }
        Ok(all)
    }

    /// Creates the composition of a single perturbation.
    #[must_use]
    pub const fn single(perturbation: Perturbation) -> Self {
        Self { bits: bit(perturbation) }
    }

    /// Iterates over the perturbations in the order of [`Perturbation::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Perturbation> {
        Perturbation::ALL.iter().copied().filter(move |perturbation| self.bits & bit(*perturbation) != 0)
    }

    /// Returns the name used on the command line and in results.
    #[must_use]
    pub fn name(self) -> String {
        let names: Vec<&str> = self.iter().map(Perturbation::name).collect();
        names.join(SEPARATOR)
    }

    /// Splits a composition's name into the names of its perturbations. The parts are trimmed but not
    /// validated.
    pub fn split(name: &str) -> impl Iterator<Item = &str> {
        name.split(SEPARATOR).map(str::trim)
    }

    /// Checks that every perturbation has an effect on the task with this nominal distribution.
    ///
    /// # Errors
    /// The first perturbation that has none, with the reason.
    pub fn applies_to(self, nominal: &SceneSpec) -> Result<(), (Perturbation, NotApplicable)> {
        self.iter().try_for_each(|perturbation| {
            perturbation.applies_to(nominal).map_err(|error| (perturbation, error))
        })
    }

    /// Returns `true` if any of the perturbations moves, adds or resizes bodies.
    #[must_use]
    pub fn changes_bodies(self) -> bool {
        self.iter().any(Perturbation::changes_bodies)
    }

    /// Returns the task's scene distribution under the composition.
    #[must_use]
    pub fn spec(self, task: &Task, profile: Profile, strength: Strength) -> SceneSpec {
        let nominal = (task.nominal)(profile);
        self.iter().fold(nominal, |spec, perturbation| perturbation.apply(spec, task, profile, strength))
    }
}

const fn bit(perturbation: Perturbation) -> u32 {
    1 << perturbation as u32
}

impl From<Perturbation> for Composition {
    fn from(perturbation: Perturbation) -> Self {
        Self::single(perturbation)
    }
}

impl TryFrom<Vec<Perturbation>> for Composition {
    type Error = CompositionError;

    fn try_from(perturbations: Vec<Perturbation>) -> Result<Self, CompositionError> {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Found by fuzzing: a list without perturbations was accepted in JSON.
    #[test]
    fn composition_is_never_empty() {
        assert_eq!(Composition::new(&[]), Err(CompositionError::Empty));
        let error = serde_json::from_str::<Composition>("[]").unwrap_err().to_string();
        assert!(error.contains("names none"), "{error}");
    }
}
