//! Affine3 maps of space in single precision: what takes a mesh to the world and the world to a camera.

use nalgebra::Isometry3;

/// A point or direction.
pub(in crate::render) type Vec3 = [f32; 3];

/// Three rows of a 3×4 matrix: `p ↦ linear · p + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::render) struct Affine3 {
    /// Rows of the linear part.
    pub(in crate::render) linear: [Vec3; 3],
    /// Image of the origin.
    pub(in crate::render) offset: Vec3,
}

impl Affine3 {
    /// Changes nothing.
    pub(in crate::render) const IDENTITY: Self =
        Self { linear: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], offset: [0.0; 3] };

    /// Scales along the axes, then moves by `pose`.
    #[inline(always)]
    pub(in crate::render) fn from_pose_and_scale(pose: &Isometry3<f32>, scale: Vec3) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        let mut linear = [[0.0; 3]; 3];
        for (row, entries) in linear.iter_mut().enumerate() {
            for (col, entry) in entries.iter_mut().enumerate() {
                *entry = rotation[(row, col)] * scale[col];
            }
        }
        Self { linear, offset: pose.translation.vector.into() }
    }

    /// The rigid motion `pose`.
    #[inline(always)]
    pub(in crate::render) fn from_pose(pose: &Isometry3<f32>) -> Self {
        Self::from_pose_and_scale(pose, [1.0; 3])
    }

    /// `inner` first, then `self`.
    #[inline(always)]
    pub(in crate::render) fn compose(&self, inner: &Self) -> Self {
        let [a, b, c] = inner.linear;
        let mut linear = self.linear;
        for row in &mut linear {
            let [x, y, z] = *row;
            for (col, entry) in row.iter_mut().enumerate() {
                *entry = x * a[col] + y * b[col] + z * c[col];
            }
        }
        Self { linear, offset: self.point(inner.offset) }
    }

    /// The map of points whose coordinates are given in steps of these lengths.
    #[inline(always)]
    pub(in crate::render) fn scale_columns(&self, steps: Vec3) -> Self {
        let mut scaled = *self;
        for row in &mut scaled.linear {
            for (entry, step) in row.iter_mut().zip(steps) {
                *entry *= step;
            }
        }
        scaled
    }

    /// Image of a point, each coordinate a chain of fused products and sums: the steps of the CPU's vector code.
    #[inline(always)]
    pub(in crate::render) fn point(&self, [x, y, z]: Vec3) -> Vec3 {
        let mut image = self.offset;
        for (coordinate, [a, b, c]) in image.iter_mut().zip(self.linear) {
            *coordinate = x.mul_add(a, y.mul_add(b, z.mul_add(c, *coordinate)));
        }
        image
    }

    /// Image of a difference of points.
    pub(in crate::render) fn vector(&self, v: Vec3) -> Vec3 {
        self.linear.map(|row| dot(row, v))
    }

    /// Inverse of a rigid motion.
    pub(in crate::render) fn rigid_inverse(&self) -> Self {
        let transposed: [Vec3; 3] =
            core::array::from_fn(|row| core::array::from_fn(|col| self.linear[col][row]));
        Self { linear: transposed, offset: transposed.map(|row| -dot(row, self.offset)) }
    }

    /// Map of surface normals up to a positive factor, for a map that does not mirror: the cofactors of the linear part.
    #[inline(always)]
    pub(in crate::render) fn normals(&self) -> [Vec3; 3] {
        let [a, b, c] = self.linear;
        [cross(b, c), cross(c, a), cross(a, b)]
    }

    /// Where a map of full rank takes the origin from.
    #[inline(always)]
    pub(in crate::render) fn preimage_of_origin(&self) -> Vec3 {
        let cofactors = self.normals();
        let determinant = dot(self.linear[0], cofactors[0]);
        core::array::from_fn(|i| {
            -(0..3).map(|row| cofactors[row][i] * self.offset[row]).sum::<f32>() / determinant
        })
    }

    /// Greatest factor by which a length along a mesh axis grows.
    #[inline(always)]
    pub(in crate::render) fn max_scale(&self) -> f32 {
        let column = |i: usize| self.linear.iter().map(|row| row[i] * row[i]).sum::<f32>();
        column(0).max(column(1)).max(column(2)).sqrt()
    }
}

/// Dot product, summed in order.
pub(in crate::render) fn dot(a: Vec3, b: Vec3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
pub(in crate::render) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + b`.
pub(in crate::render) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
pub(in crate::render) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `v · s`.
pub(in crate::render) fn scaled(v: Vec3, s: f32) -> Vec3 {
    v.map(|x| x * s)
}

/// `v` at length 1.
pub(in crate::render) fn normalised(v: Vec3) -> Vec3 {
    scaled(v, 1.0 / dot(v, v).sqrt())
}
