//! Where everything that moves is at one moment: all that a renderer needs of a world.

use nalgebra::Isometry3;

/// Links of a Panda that are drawn or mounted on: link 0 to 7, hand, two fingers.
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

/// World poses of one arm's links, indexed by [`Link`]: the URDF's link frames.
pub type ArmLinks = [Isometry3<f32>; N_LINKS];

/// World poses of bodies and links.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// One per body of the scene, in its order.
    pub bodies: Vec<Isometry3<f32>>,
    /// One per arm.
    pub arms: Vec<ArmLinks>,
}

impl Snapshot {
    /// All poses identity, for a scene with this many bodies and arms.
    #[must_use]
    pub fn identity(n_bodies: usize, n_arms: usize) -> Self {
        Self {
            bodies: vec![Isometry3::identity(); n_bodies],
            arms: vec![[Isometry3::identity(); N_LINKS]; n_arms],
        }
    }
}
