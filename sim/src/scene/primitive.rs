//! Convex primitive shapes of bodies. Lengths are in m; every primitive is centred on its own origin.

use nalgebra::{Isometry3, Vector3};

/// A convex solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// Box whose edges are parallel to the axes.
    Box {
        /// Half-extents along x, y and z, in m.
        half: [f64; 3],
    },
    /// Cylinder about the z axis.
    Cylinder {
        /// Radius in m.
        radius: f64,
        /// Half of the height, in m.
        half_height: f64,
    },
    /// Sphere about the origin.
    Ball {
        /// Radius in m.
        radius: f64,
    },
    /// Capsule about the z axis.
    Capsule {
        /// Radius in m.
        radius: f64,
        /// Half of the distance between the centres of its caps, in m.
        half_height: f64,
    },
}

/// An axis-aligned bounding box, in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Corner with the smallest coordinates.
    pub min: Vector3<f64>,
    /// Corner with the largest coordinates.
    pub max: Vector3<f64>,
}

impl Aabb {
    /// Returns the smallest box that contains both boxes.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }
}

impl Primitive {
    /// Returns the primitive with every length multiplied by `scale`.
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

    /// Returns the axis-aligned bounding box of the primitive at `pose`.
    #[must_use]
    pub fn aabb(self, pose: &Isometry3<f64>) -> Aabb {
        let rotation = pose.rotation.to_rotation_matrix();
        let half = Vector3::from_fn(|axis, _| {
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
        Aabb { min: centre - half, max: centre + half }
    }
}
