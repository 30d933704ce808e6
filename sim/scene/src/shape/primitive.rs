//! Convex primitive shapes of bodies. Lengths are in m; every primitive but a hull is centred on its own
//! origin.

use core::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};

/// A convex solid.
#[derive(Clone, Debug, PartialEq)]
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
    /// Convex hull of points. It collides but cannot be rendered: a body that has one needs visuals.
    Hull {
        /// Points in m, at least four of them not in one plane.
        points: Arc<[[f64; 3]]>,
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
    pub fn scaled(&self, scale: f64) -> Self {
        match *self {
            Self::Box { half } => Self::Box { half: half.map(|h| h * scale) },
            Self::Cylinder { radius, half_height } => {
                Self::Cylinder { radius: radius * scale, half_height: half_height * scale }
            }
            Self::Ball { radius } => Self::Ball { radius: radius * scale },
            Self::Capsule { radius, half_height } => {
                Self::Capsule { radius: radius * scale, half_height: half_height * scale }
            }
            Self::Hull { ref points } => {
                Self::Hull { points: points.iter().map(|point| point.map(|x| x * scale)).collect() }
            }
        }
    }

    /// Creates the solid of revolution about z between two circles, each given as (radius, z), in m.
    #[must_use]
    pub fn frustum(circles: [[f64; 2]; 2]) -> Self {
        Self::revolution(&circles)
    }

    /// Creates the convex solid of revolution about z through circles, each given as (radius, z), in m.
    #[must_use]
    pub fn revolution(circles: &[[f64; 2]]) -> Self {
        Self::Hull { points: circles.iter().flat_map(|&[radius, z]| circle(radius, z)).collect() }
    }

    /// Stretches the primitive, which stands at `pose` in a body, by a factor along each axis of the body.
    /// Returns the new shape and its pose in the body.
    #[must_use]
    pub fn stretched(&self, pose: &Isometry3<f64>, factors: &Vector3<f64>) -> (Self, Isometry3<f64>) {
        let translation = pose.translation.vector.component_mul(factors);
        let at = |rotation| Isometry3::from_parts(translation.into(), rotation);
        if factors.x == factors.y && factors.x == factors.z {
            return (self.scaled(factors.x), at(pose.rotation));
        }
        if let (Self::Box { half }, Some(along)) = (self, factors_along(&pose.rotation, factors)) {
            let half = core::array::from_fn(|axis| half[axis] * along[axis]);
            return (Self::Box { half }, at(pose.rotation));
        }
        let stretch = |point: [f64; 3]| (pose.rotation * Vector3::from(point)).component_mul(factors).into();
        let points = self.corners().into_iter().map(stretch).collect();
        (Self::Hull { points }, at(UnitQuaternion::identity()))
    }

    /// Returns points on the surface whose hull is the primitive, up to the facets of round surfaces.
    fn corners(&self) -> Vec<[f64; 3]> {
        /// Latitudes of a sphere as fractions of its radius: the height and the radius of a parallel.
        const PARALLELS: [[f64; 2]; 5] =
            [[0.0, 1.0], [0.5, 0.866], [-0.5, 0.866], [0.866, 0.5], [-0.866, 0.5]];
        let cap = |centre: f64, radius: f64, sign: f64| {
            let parallels = PARALLELS.into_iter().filter(move |[z, _]| z * sign >= 0.0);
            let rings = parallels.flat_map(move |[z, r]| circle(r * radius, centre + z * radius));
            rings.chain([[0.0, 0.0, centre + sign * radius]])
        };
        match *self {
            Self::Box { half: [x, y, z] } => {
                let sign = |bit: usize, half: f64| if bit == 0 { -half } else { half };
                (0..8).map(|i| [sign(i & 1, x), sign(i & 2, y), sign(i & 4, z)]).collect()
            }
            Self::Cylinder { radius, half_height } => {
                [-half_height, half_height].into_iter().flat_map(|z| circle(radius, z)).collect()
            }
            Self::Ball { radius } => cap(0.0, radius, 1.0).chain(cap(0.0, radius, -1.0)).collect(),
            Self::Capsule { radius, half_height } => {
                cap(half_height, radius, 1.0).chain(cap(-half_height, radius, -1.0)).collect()
            }
            Self::Hull { ref points } => points.to_vec(),
        }
    }

    /// Returns the axis-aligned bounding box of the primitive at `pose`.
    #[must_use]
    pub fn aabb(&self, pose: &Isometry3<f64>) -> Aabb {
        if let Self::Hull { points } = self {
            let corner = |point: &[f64; 3]| {
                let at = (pose * Point3::from(*point)).coords;
                Aabb { min: at, max: at }
            };
            return points.iter().map(corner).reduce(Aabb::union).expect("a hull has points");
        }
        let rotation = pose.rotation.to_rotation_matrix();
        let half = Vector3::from_fn(|axis, _| {
            let row = rotation.matrix().row(axis);
            match *self {
                Self::Box { half } => (0..3).map(|i| row[i].abs() * half[i]).sum(),
                Self::Cylinder { radius, half_height } => {
                    row[2].abs() * half_height + radius * (1.0 - row[2] * row[2]).max(0.0).sqrt()
                }
                Self::Ball { radius } => radius,
                Self::Capsule { radius, half_height } => row[2].abs() * half_height + radius,
                Self::Hull { .. } => unreachable!("handled above"),
            }
        });
        let centre = pose.translation.vector;
        Aabb { min: centre - half, max: centre + half }
    }
}

/// Number of points that stand for a circle.
const N_CIRCLE: u32 = 24;

/// Returns points on a circle about the z axis.
fn circle(radius: f64, z: f64) -> impl Iterator<Item = [f64; 3]> {
    (0..N_CIRCLE).map(move |i| {
        let (sin, cos) = libm::sincos(f64::from(i) * TAU / f64::from(N_CIRCLE));
        [radius * cos, radius * sin, z]
    })
}

/// Returns the factors along the axes of a rotated frame, or `None` if the frame's axes are not parallel to
/// those along which the factors are given.
pub(crate) fn factors_along(rotation: &UnitQuaternion<f64>, factors: &Vector3<f64>) -> Option<Vector3<f64>> {
    /// Greatest sine of the angle between axes that count as parallel.
    const PARALLEL: f64 = 1e-6;
    let matrix: Matrix3<f64> = rotation.to_rotation_matrix().into_inner().abs();
    let is_permutation = matrix.iter().all(|x| *x < PARALLEL || *x > 1.0 - PARALLEL);
    is_permutation.then(|| matrix.map(f64::round).transpose() * factors)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn stretched_shapes_fill_the_stretched_bounds() {
        let factors = Vector3::new(0.8, 1.1, 1.2);
        let shapes = [
            Primitive::Box { half: [0.1, 0.2, 0.3] },
            Primitive::Cylinder { radius: 0.1, half_height: 0.2 },
            Primitive::Ball { radius: 0.1 },
            Primitive::Capsule { radius: 0.1, half_height: 0.2 },
            Primitive::frustum([[0.1, -0.1], [0.2, 0.1]]),
        ];
        let rotations = [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(FRAC_PI_2, 0.0, 0.0)];
        for (shape, rotation) in shapes.iter().flat_map(|shape| rotations.map(|rotation| (shape, rotation))) {
            let pose = Isometry3::from_parts(Vector3::new(0.1, -0.2, 0.3).into(), rotation);
            let before = shape.aabb(&pose);
            let (stretched, at) = shape.stretched(&pose, &factors);
            let after = stretched.aabb(&at);
            assert!((after.min - before.min.component_mul(&factors)).amax() < 1e-3, "{shape:?}");
            assert!((after.max - before.max.component_mul(&factors)).amax() < 1e-3, "{shape:?}");
        }
    }
}
