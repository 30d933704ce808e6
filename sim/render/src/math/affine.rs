//! Affine transforms in single precision, such as mesh to world and world to camera.

use nalgebra::Isometry3;

/// A point, a direction or a linear RGB colour.
pub(crate) type Vec3 = [f32; 3];

/// A 3×4 matrix in row-major order: `p ↦ linear · p + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Affine3 {
    /// Rows of the linear part.
    pub(crate) linear: [Vec3; 3],
    /// Translation: the image of the origin.
    pub(crate) offset: Vec3,
}

impl Affine3 {
    /// The identity transform.
    pub(crate) const IDENTITY: Self =
        Self { linear: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], offset: [0.0; 3] };

    /// Returns the transform that scales along the axes and then applies `pose`.
    #[inline(always)]
    pub(crate) fn from_pose_and_scale(pose: &Isometry3<f32>, scale: Vec3) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        let mut linear = [[0.0; 3]; 3];
        for (row, entries) in linear.iter_mut().enumerate() {
            for (col, entry) in entries.iter_mut().enumerate() {
                *entry = rotation[(row, col)] * scale[col];
            }
        }
        Self { linear, offset: pose.translation.vector.into() }
    }

    /// Returns `pose` as an affine transform.
    #[inline(always)]
    pub(crate) fn from_pose(pose: &Isometry3<f32>) -> Self {
        Self::from_pose_and_scale(pose, [1.0; 3])
    }

    /// Returns `self ∘ inner`, which applies `inner` first.
    #[inline(always)]
    pub(crate) fn compose(&self, inner: &Self) -> Self {
        let [a, b, c] = inner.linear;
        let mut linear = self.linear;
        for row in &mut linear {
            let [x, y, z] = *row;
            for (col, entry) in row.iter_mut().enumerate() {
                *entry = x * a[col] + y * b[col] + z * c[col];
            }
        }
        Self { linear, offset: self.transform_point(inner.offset) }
    }

    /// Scales the columns of the linear part, so that the result accepts coordinates in units of `factors`.
    #[inline(always)]
    pub(crate) fn scale_columns(&self, factors: Vec3) -> Self {
        let mut scaled = *self;
        for row in &mut scaled.linear {
            for (entry, factor) in row.iter_mut().zip(factors) {
                *entry *= factor;
            }
        }
        scaled
    }

    /// Transforms a point. Each coordinate is one chain of fused multiply-adds, in the order of the CPU
    /// renderer's SIMD code, so that both give the same bits.
    #[inline(always)]
    pub(crate) fn transform_point(&self, [x, y, z]: Vec3) -> Vec3 {
        let mut image = self.offset;
        for (coordinate, [a, b, c]) in image.iter_mut().zip(self.linear) {
            *coordinate = x.mul_add(a, y.mul_add(b, z.mul_add(c, *coordinate)));
        }
        image
    }

    /// Transforms a direction: the translation does not apply.
    pub(crate) fn transform_vector(&self, v: Vec3) -> Vec3 {
        self.linear.map(|row| dot(row, v))
    }

    /// Returns the inverse, provided that the transform is rigid.
    pub(crate) fn rigid_inverse(&self) -> Self {
        let transposed: [Vec3; 3] =
            core::array::from_fn(|row| core::array::from_fn(|col| self.linear[col][row]));
        Self { linear: transposed, offset: transposed.map(|row| -dot(row, self.offset)) }
    }

    /// Returns the cofactor matrix of the linear part, which transforms normals up to a positive factor
    /// unless the transform mirrors.
    #[inline(always)]
    pub(crate) fn cofactors(&self) -> [Vec3; 3] {
        let [a, b, c] = self.linear;
        [cross(b, c), cross(c, a), cross(a, b)]
    }

    /// Returns the point that a transform of full rank maps to the origin.
    #[inline(always)]
    pub(crate) fn preimage_of_origin(&self) -> Vec3 {
        let cofactors = self.cofactors();
        let determinant = dot(self.linear[0], cofactors[0]);
        core::array::from_fn(|i| {
            -(0..3).map(|row| cofactors[row][i] * self.offset[row]).sum::<f32>() / determinant
        })
    }

    /// Returns the largest of the scale factors along the three input axes.
    #[inline(always)]
    pub(crate) fn max_scale(&self) -> f32 {
        let column = |i: usize| self.linear.iter().map(|row| row[i] * row[i]).sum::<f32>();
        column(0).max(column(1)).max(column(2)).sqrt()
    }
}

/// Returns the dot product, summed from x to z.
pub(crate) fn dot(a: Vec3, b: Vec3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the right-handed cross product `a × b`.
pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + b`.
pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `v · s`.
pub(crate) fn scaled(v: Vec3, s: f32) -> Vec3 {
    v.map(|x| x * s)
}

/// Returns `v` scaled to unit length.
pub(crate) fn normalised(v: Vec3) -> Vec3 {
    scaled(v, 1.0 / dot(v, v).sqrt())
}
