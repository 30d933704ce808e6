//! The perturbations: each edits the distribution of scenes, and only the fields it owns. No randomness here.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::profile::Profile;
use crate::scene::{BodySpec, CameraMount, ColorSpec, Jitter, Range, Role, ScaledBy, SceneSpec, TextureSpec};

/// A perturbation of the benchmark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[expect(missing_docs, reason = "`name` and `apply` say what they are")]
pub enum Perturbation {
    None,
    MoColor,
    MoSize,
    CameraPose,
}

/// A perturbation that would change nothing in a task.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{reason}")]
pub struct NotApplicable {
    /// Why.
    pub reason: String,
}

impl Perturbation {
    /// All, the unperturbed condition first.
    pub const ALL: &[Self] = &[Self::None, Self::MoColor, Self::MoSize, Self::CameraPose];

    /// Name in the paper, on the command line and in results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "None",
            Self::MoColor => "MO-Color",
            Self::MoSize => "MO-Size",
            Self::CameraPose => "Camera-Pose",
        }
    }

    /// The perturbed distribution (spec/perturbations.md §3).
    #[must_use]
    pub fn apply(self, mut spec: SceneSpec, profile: Profile) -> SceneSpec {
        match self {
            Self::None => {}
            Self::MoColor => {
                for paint in with_role(&mut spec, Role::ManipulationObject).flat_map(BodySpec::paints_mut) {
                    paint.color = ColorSpec::Any;
                    paint.texture = TextureSpec::None;
                }
            }
            Self::MoSize => {
                for body in spec.bodies.iter_mut().filter(|body| body.scaled_by == ScaledBy::MoSize) {
                    body.scale = Range::new(0.8, 1.2);
                }
            }
            Self::CameraPose => {
                let external = |mount: &CameraMount| matches!(mount, CameraMount::World { .. });
                for camera in spec.cameras.iter_mut().filter(|camera| external(&camera.mount)) {
                    camera.jitter = Jitter {
                        translation: [
                            Range::symmetric(0.03),
                            Range::symmetric(0.03),
                            profile.camera_jitter_z(),
                        ],
                        rotation: [Range::symmetric(0.035); 3],
                    };
                }
            }
        }
        spec
    }

    /// Whether the perturbation changes this task's distribution; derived from roles, never listed.
    ///
    /// # Errors
    /// The reason why it does not.
    pub fn applies_to(self, nominal: &SceneSpec) -> Result<(), NotApplicable> {
        let has_mo = || nominal.bodies.iter().any(|body| body.role == Role::ManipulationObject);
        let reason = match self {
            Self::None | Self::CameraPose => return Ok(()),
            Self::MoColor if has_mo() => return Ok(()),
            Self::MoColor => "the task has no manipulation object".to_owned(),
            Self::MoSize if nominal.bodies.iter().any(|body| body.scaled_by == ScaledBy::MoSize) => {
                return Ok(());
            }
            Self::MoSize => pinned_reason(nominal, Role::ManipulationObject),
        };
        Err(NotApplicable { reason })
    }
}

fn with_role(spec: &mut SceneSpec, role: Role) -> impl Iterator<Item = &mut BodySpec> {
    spec.bodies.iter_mut().filter(move |body| body.role == role)
}

fn pinned_reason(nominal: &SceneSpec, role: Role) -> String {
    let mut bodies = nominal.bodies.iter().filter(|body| body.role == role);
    match bodies.find_map(|body| {
        if let ScaledBy::Nothing(reason) = body.scaled_by { Some((body.name, reason)) } else { None }
    }) {
        Some((name, reason)) => format!("the size of {name} is pinned: {reason}"),
        None => "no body of the task is scaled by it".to_owned(),
    }
}
