//! Primitive shapes that parts of bodies are made of. Lengths in metres, centred on their own origin.

use nalgebra::{Isometry3, Vector3};

/// A convex solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// Box with half extents along x, y, z.
    Box {
        /// Half extents in m.
        half: [f64; 3],
    },
    /// Cylinder about z.
    Cylinder {
        /// Radius in m.
        radius: f64,
        /// Half of its length in m.
        half_height: f64,
    },
    /// Ball.
    Ball {
        /// Radius in m.
        radius: f64,
    },
    /// Capsule about z.
    Capsule {
        /// Radius in m.
        radius: f64,
        /// Half the distance between the centres of its caps in m.
        half_height: f64,
    },
}

/// Half extents of an axis-aligned box and its centre, in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Least corner.
    pub min: Vector3<f64>,
    /// Greatest corner.
    pub max: Vector3<f64>,
}

impl Extent {
    /// The extent that holds both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }
}

impl Primitive {
    /// The same solid, every length times `scale`.
    #[must_use]
    pub fn scaled(self, scale: f64) -> Self {
        match self {
            Self::Box { half } => Self::Box { half: half.map(|h| h * scale) },
            Self::Cylinder { radius, half_height } => {
                Self::Cylinder { radius: radius * scale, half_height: half_height * scale }
            }
            Self::Ball { radius } => Self::Ball { radius: radius * scale },
            Self::Capsule { radius, half_height } => {
                Self::Capsule { radius: radius * scale, half_height: half_height * scale }
            }
        }
    }

    /// Axis-aligned extent when placed at `pose`.
    #[must_use]
    pub fn extent(self, pose: &Isometry3<f64>) -> Extent {
        let rotation = pose.rotation.to_rotation_matrix();
        let reach = Vector3::from_fn(|axis, _| {
            let row = rotation.matrix().row(axis);
            match self {
                Self::Box { half } => (0..3).map(|i| row[i].abs() * half[i]).sum(),
                Self::Cylinder { radius, half_height } => {
                    row[2].abs() * half_height + radius * (1.0 - row[2] * row[2]).max(0.0).sqrt()
                }
                Self::Ball { radius } => radius,
                Self::Capsule { radius, half_height } => row[2].abs() * half_height + radius,
            }
        });
        let centre = pose.translation.vector;
        Extent { min: centre - reach, max: centre + reach }
    }
}
