//! The SIMD layout of a mesh: clusters of 16 triangles, and bounds for 16 clusters at a time.

use crate::math::affine::Vec3;
use crate::math::lanes::{F32x16, I16x16};

/// Sixteen points or directions, one vector per axis.
pub(crate) type Vec3x16 = [F32x16; 3];

/// Corner positions of the 16 triangles of a cluster, indexed by corner and axis, in units of
/// [`PackedMesh::grid_step`]. Sixteen bits halve the memory that every image reads. Unused lanes hold a
/// degenerate triangle.
pub(crate) type ClusterCorners = [[I16x16; 3]; 3];

/// Layout of the shading data of one triangle in an [`F32x16`]: indices of its elements and bits of the last
/// one.
pub(crate) struct TriangleRecord;

impl TriangleRecord {
    /// First element of the vertex normals, three `f32` per corner.
    pub(crate) const NORMALS: usize = 0;
    /// First element of the corners: three `i16` per corner, the same grid coordinates as in
    /// [`ClusterCorners`]. Each element packs two of them, the first in the lower half. The upper half of the
    /// last element holds [`Self::AXIS_MASK`] and [`Self::FLAT_BIT`].
    pub(crate) const CORNERS: usize = 9;
    /// Mask of the [`super::ProjectionAxis`]: 0, 1 or 2 for x, y or z.
    pub(crate) const AXIS_MASK: i32 = 3;
    /// Bit that is set if the three vertex normals are equal.
    pub(crate) const FLAT_BIT: i32 = 4;
}

/// Bounds of 16 clusters, see [`super::clusters::Cluster`].
pub(crate) struct ClusterBounds {
    /// Centres of the bounding spheres.
    pub(crate) centre: Vec3x16,
    /// Radii of the bounding spheres.
    pub(crate) radius: F32x16,
    /// Unit axes of the normal cones.
    pub(crate) axis: Vec3x16,
    /// Cutoffs of the normal cones.
    pub(crate) cutoff: F32x16,
    /// Bit i is set if cluster i exists.
    pub(crate) present: u16,
}

/// The clusters of a mesh.
#[derive(Default)]
pub(crate) struct PackedMesh {
    /// One element per cluster, in the order of the mesh's triangles.
    pub(crate) corners: Vec<ClusterCorners>,
    /// Grid step of the coordinates per axis: a power of 2 in the mesh's unit of length.
    pub(crate) grid_step: Vec3,
    /// One [`TriangleRecord`] per triangle.
    pub(crate) triangles: Vec<F32x16>,
    /// One element per 16 clusters.
    pub(crate) bounds: Vec<ClusterBounds>,
}
