//! A mesh once more, as vector code reads it: sixteen triangles side by side, and the bounds of sixteen such clusters.

use super::clusters::{self, CLUSTER_SIZE};
use super::{Mesh, ProjectionAxis};
use crate::render::math::affine::Vec3;
use crate::render::math::lanes::{F32x16, I16x16, N_LANES};

const _: () = assert!(CLUSTER_SIZE == N_LANES, "a cluster's triangles are one vector");

/// A vector of points or directions, one line per axis.
pub(in crate::render) type Vec3x16 = [F32x16; 3];

/// Positions of the three corners of a cluster's sixteen triangles, by corner and axis, in steps of
/// [`PackedMesh::steps`]: half the memory that every picture reads. Lanes without a triangle hold one that is a single point.
pub(in crate::render) type ClusterCorners = [[I16x16; 3]; 3];

/// Everything that shading needs to know of one triangle, by index into a line.
pub(in crate::render) struct TriangleRecord;

impl TriangleRecord {
    /// Where the normals at the corners begin: three numbers each.
    pub(in crate::render) const NORMALS: usize = 0;
    /// Where the corners begin, three short integers each, the steps that [`ClusterCorners`] has too: two to a number's bits, the
    /// first of them in the lower half. The last half is [`Self::AXIS_MASK`] and [`Self::FLAT_BIT`].
    pub(in crate::render) const CORNERS: usize = 9;
    /// Lowest bits of the last half: [`ProjectionAxis`] as a number.
    pub(in crate::render) const AXIS_MASK: i32 = 3;
    /// A bit of the last half: the normals are one.
    pub(in crate::render) const FLAT_BIT: i32 = 4;
}

/// ClusterBounds of sixteen clusters; see [`clusters::Cluster`].
pub(in crate::render) struct ClusterBounds {
    pub(in crate::render) centre: Vec3x16,
    pub(in crate::render) radius: F32x16,
    pub(in crate::render) axis: Vec3x16,
    pub(in crate::render) cutoff: F32x16,
    /// Bit i: there is a cluster i.
    pub(in crate::render) present: u16,
}

/// A mesh's clusters.
#[derive(Default)]
pub(in crate::render) struct PackedMesh {
    /// In the order of the mesh's triangles.
    pub(in crate::render) corners: Vec<ClusterCorners>,
    /// Powers of 2 in the mesh's unit of length, one per axis.
    pub(in crate::render) steps: Vec3,
    /// One per triangle, laid out as [`TriangleRecord`].
    pub(in crate::render) triangles: Vec<F32x16>,
    /// One per sixteen batches.
    pub(in crate::render) bounds: Vec<ClusterBounds>,
}

impl PackedMesh {
    /// Of a mesh whose triangles are in their final order and whose coordinates are multiples of [`steps`].
    pub(super) fn new(mesh: &Mesh) -> Self {
        let steps = steps(mesh);
        let n_triangles = mesh.triangles.len();
        let clusters = clusters::of(mesh);
        Self {
            corners: (0..n_triangles)
                .step_by(CLUSTER_SIZE)
                .map(|first| corners(mesh, first, steps))
                .collect(),
            steps,
            triangles: (0..n_triangles).map(|index| triangle(mesh, index, steps)).collect(),
            bounds: clusters.chunks(N_LANES).map(bounds).collect(),
        }
    }
}

/// Per axis the least power of 2 of which no coordinate is more than an [`i16`] times.
pub(super) fn steps(mesh: &Mesh) -> Vec3 {
    core::array::from_fn(|axis| {
        let reach = mesh.positions[axis].iter().fold(0.0, |reach: f32, x| reach.max(x.abs()));
        let mut step = 1.0 / 16_777_216.0;
        while reach > step * f32::from(i16::MAX) {
            step *= 2.0;
        }
        step
    })
}

fn corners(mesh: &Mesh, first: usize, steps: Vec3) -> ClusterCorners {
    let n = CLUSTER_SIZE.min(mesh.triangles.len() - first);
    let mut all = [[I16x16::ZERO; 3]; 3];
    for lane in 0..CLUSTER_SIZE {
        let corners = mesh.triangles[first + lane.min(n - 1)];
        for (k, corner) in corners.into_iter().enumerate() {
            let corner = if lane < n { corner } else { corners[0] };
            for (axis, step) in in_steps(mesh, corner, steps).into_iter().enumerate() {
                all[k][axis].0[lane] = step;
            }
        }
    }
    all
}

fn in_steps(mesh: &Mesh, corner: u32, steps: Vec3) -> [i16; 3] {
    let position = mesh.position(corner);
    core::array::from_fn(|axis| (position[axis] / steps[axis]) as i16)
}

fn triangle(mesh: &Mesh, index: usize, steps: Vec3) -> F32x16 {
    let corners = mesh.triangles[index];
    let normals = corners.map(|corner| mesh.normals[corner as usize]);
    let flat = if normals == [normals[0]; 3] { TriangleRecord::FLAT_BIT } else { 0 };
    let facing = match mesh.projection_axes[index] {
        ProjectionAxis::X => 0,
        ProjectionAxis::Y => 1,
        ProjectionAxis::Z => 2,
    };
    let mut halves = [(flat | facing) as i16; 10];
    halves[..9].copy_from_slice(corners.map(|corner| in_steps(mesh, corner, steps)).as_flattened());
    let mut line = F32x16::ZERO;
    line.0[TriangleRecord::NORMALS..][..9].copy_from_slice(normals.as_flattened());
    for (number, [low, high]) in line.0[TriangleRecord::CORNERS..].iter_mut().zip(halves.as_chunks().0) {
        *number = f32::from_bits(u32::from(low.cast_unsigned()) | u32::from(high.cast_unsigned()) << 16);
    }
    line
}

fn bounds(clusters: &[clusters::Cluster]) -> ClusterBounds {
    let line = |f: &dyn Fn(&clusters::Cluster) -> f32| {
        F32x16(core::array::from_fn(|i| clusters.get(i).map_or(0.0, f)))
    };
    ClusterBounds {
        centre: core::array::from_fn(|axis| line(&|cluster| cluster.centre[axis])),
        radius: line(&|cluster| cluster.radius),
        axis: core::array::from_fn(|axis| line(&|cluster| cluster.axis[axis])),
        cutoff: line(&|cluster| cluster.cutoff),
        present: ((1_u32 << clusters.len()) - 1) as u16,
    }
}
