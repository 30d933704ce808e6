//! The conversion of a mesh to its SIMD layout.

use super::clusters::{self, CLUSTER_SIZE};
use super::packed::{ClusterBounds, ClusterCorners, PackedMesh, TriangleRecord};
use super::triangle_mesh::{Mesh, ProjectionAxis};
use crate::math::affine::Vec3;
use crate::math::lanes::{F32x16, I16x16, N_LANES};

const _: () = assert!(CLUSTER_SIZE == N_LANES, "the triangles of a cluster fill one vector");

/// Packs a mesh whose triangles are in their final order and whose coordinates are multiples of
/// [`grid_step`].
pub(crate) fn pack(mesh: &Mesh) -> PackedMesh {
    let grid_step = grid_step(mesh);
    let n_triangles = mesh.triangles.len();
    let clusters = clusters::compute(mesh);
    PackedMesh {
        corners: (0..n_triangles)
            .step_by(CLUSTER_SIZE)
            .map(|first| cluster_corners(mesh, first, grid_step))
            .collect(),
        grid_step,
        triangles: (0..n_triangles).map(|index| triangle_record(mesh, index, grid_step)).collect(),
        bounds: clusters.chunks(N_LANES).map(cluster_bounds).collect(),
    }
}

/// Returns, per axis, the smallest power of 2 (at least 2⁻²⁴) in whose units every coordinate fits an
/// [`i16`].
pub(crate) fn grid_step(mesh: &Mesh) -> Vec3 {
    core::array::from_fn(|axis| {
        let max_abs = mesh.positions[axis].iter().fold(0.0, |max: f32, x| max.max(x.abs()));
        let mut step = 1.0 / 16_777_216.0;
        while max_abs > step * f32::from(i16::MAX) {
            step *= 2.0;
        }
        step
    })
}

fn cluster_corners(mesh: &Mesh, first: usize, grid_step: Vec3) -> ClusterCorners {
    let n = CLUSTER_SIZE.min(mesh.triangles.len() - first);
    let mut all = [[I16x16::ZERO; 3]; 3];
    for lane in 0..CLUSTER_SIZE {
        let corners = mesh.triangles[first + lane.min(n - 1)];
        for (k, corner) in corners.into_iter().enumerate() {
            let corner = if lane < n { corner } else { corners[0] };
            for (axis, coordinate) in grid_position(mesh, corner, grid_step).into_iter().enumerate() {
                all[k][axis].0[lane] = coordinate;
            }
        }
    }
    all
}

/// Returns the position of a vertex in units of the grid step.
fn grid_position(mesh: &Mesh, vertex: u32, grid_step: Vec3) -> [i16; 3] {
    let position = mesh.position(vertex);
    core::array::from_fn(|axis| (position[axis] / grid_step[axis]) as i16)
}

fn triangle_record(mesh: &Mesh, index: usize, grid_step: Vec3) -> F32x16 {
    let corners = mesh.triangles[index];
    let normals = corners.map(|corner| mesh.normals[corner as usize]);
    let flat = if normals == [normals[0]; 3] { TriangleRecord::FLAT_BIT } else { 0 };
    let axis = match mesh.projection_axes[index] {
        ProjectionAxis::X => 0,
        ProjectionAxis::Y => 1,
        ProjectionAxis::Z => 2,
    };
    let mut halves = [(flat | axis) as i16; 10];
    halves[..9].copy_from_slice(corners.map(|corner| grid_position(mesh, corner, grid_step)).as_flattened());
    let mut record = F32x16::ZERO;
    record.0[TriangleRecord::NORMALS..][..9].copy_from_slice(normals.as_flattened());
    for (element, [low, high]) in record.0[TriangleRecord::CORNERS..].iter_mut().zip(halves.as_chunks().0) {
        *element = f32::from_bits(u32::from(low.cast_unsigned()) | u32::from(high.cast_unsigned()) << 16);
    }
    record
}

fn cluster_bounds(clusters: &[clusters::Cluster]) -> ClusterBounds {
    let gather = |f: &dyn Fn(&clusters::Cluster) -> f32| {
        F32x16(core::array::from_fn(|i| clusters.get(i).map_or(0.0, f)))
    };
    ClusterBounds {
        centre: core::array::from_fn(|axis| gather(&|cluster| cluster.centre[axis])),
        radius: gather(&|cluster| cluster.radius),
        axis: core::array::from_fn(|axis| gather(&|cluster| cluster.axis[axis])),
        cutoff: gather(&|cluster| cluster.cutoff),
        present: ((1_u32 << clusters.len()) - 1) as u16,
    }
}
