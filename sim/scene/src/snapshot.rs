//! Poses of all moving objects at one instant: the only state a renderer reads from a running world.

use nalgebra::Isometry3;

/// Number of Panda links that are rendered or carry a camera: links 0 to 7, hand and two fingers.
pub const N_LINKS: usize = 11;

/// Index of a link in [`ArmLinks`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "links are numbered from the base up; finger 1 opens towards +y of the hand")]
pub enum Link {
    Link0,
    Link1,
    Link2,
    Link3,
    Link4,
    Link5,
    Link6,
    Link7,
    Hand,
    Finger1,
    Finger2,
}

/// World poses of one arm's link frames, as the URDF defines them, indexed by [`Link`].
pub type ArmLinks = [Isometry3<f32>; N_LINKS];

/// World poses of all bodies and arm links.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// One pose per body, in the order of the scene's bodies.
    pub bodies: Vec<Isometry3<f32>>,
    /// One set of link poses per arm.
    pub arms: Vec<ArmLinks>,
}

impl Snapshot {
    /// Creates a snapshot of the given size whose poses are all the identity.
    #[must_use]
    pub fn identity(n_bodies: usize, n_arms: usize) -> Self {
        Self {
            bodies: vec![Isometry3::identity(); n_bodies],
            arms: vec![[Isometry3::identity(); N_LINKS]; n_arms],
        }
    }

    /// Returns the number of poses.
    #[must_use]
    pub fn n_poses(&self) -> usize {
        self.bodies.len() + self.arms.len() * N_LINKS
    }
}
