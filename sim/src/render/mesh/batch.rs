//! A mesh once more, as vector code reads it: sixteen triangles side by side, and the bounds of sixteen such clusters.

use super::clusters::{self, CLUSTER_SIZE};
use super::{Facing, Mesh};
use crate::render::line::{Line, N_LANES, WholeLine};

const _: () = assert!(CLUSTER_SIZE == N_LANES, "a cluster's triangles are one vector");

/// A vector of points or directions, one line per axis.
pub(in crate::render) type Lines3 = [Line; 3];

/// Sixteen triangles: a cluster. Lanes without a triangle hold one that is a single point.
pub(in crate::render) struct Batch {
    /// Positions of the three corners.
    pub(in crate::render) positions: [Lines3; 3],
    /// Normals there.
    pub(in crate::render) normals: [Lines3; 3],
    /// [`Facing`] as a number.
    pub(in crate::render) facing: WholeLine,
    /// Bit i: the normals of triangle i are one.
    pub(in crate::render) flat: u16,
    /// Bit i: there is a triangle i.
    pub(in crate::render) present: u16,
}

/// Bounds of sixteen clusters; see [`clusters::Cluster`].
pub(in crate::render) struct Bounds {
    pub(in crate::render) centre: Lines3,
    pub(in crate::render) radius: Line,
    pub(in crate::render) axis: Lines3,
    pub(in crate::render) cutoff: Line,
    /// Bit i: there is a cluster i.
    pub(in crate::render) present: u16,
}

/// A mesh's clusters.
#[derive(Default)]
pub(in crate::render) struct Batches {
    /// In the order of the mesh's triangles.
    pub(in crate::render) batches: Vec<Batch>,
    /// One per sixteen batches.
    pub(in crate::render) bounds: Vec<Bounds>,
}

impl Batches {
    /// Of a mesh whose triangles are in their final order.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let runs = (0..mesh.triangles.len()).step_by(CLUSTER_SIZE);
        let clusters = clusters::of(mesh);
        Self {
            batches: runs.map(|first| batch(mesh, first)).collect(),
            bounds: clusters.chunks(N_LANES).map(bounds).collect(),
        }
    }
}

fn batch(mesh: &Mesh, first: usize) -> Batch {
    let n = CLUSTER_SIZE.min(mesh.triangles.len() - first);
    let mut batch = Batch {
        positions: [[Line::ZERO; 3]; 3],
        normals: [[Line::ZERO; 3]; 3],
        facing: WholeLine::ZERO,
        flat: 0,
        present: ((1_u32 << n) - 1) as u16,
    };
    for lane in 0..CLUSTER_SIZE {
        let triangle = first + lane.min(n - 1);
        let corners = mesh.triangles[triangle];
        for (k, corner) in corners.into_iter().enumerate() {
            let corner = if lane < n { corner } else { corners[0] };
            let (position, normal) = (mesh.position(corner), mesh.normals[corner as usize]);
            for axis in 0..3 {
                batch.positions[k][axis].0[lane] = position[axis];
                batch.normals[k][axis].0[lane] = normal[axis];
            }
        }
        let [l, m, n] = corners.map(|corner| mesh.normals[corner as usize]);
        batch.flat |= u16::from(l == m && m == n) << lane;
        batch.facing.0[lane] = match mesh.facing[triangle] {
            Facing::X => 0,
            Facing::Y => 1,
            Facing::Z => 2,
        };
    }
    batch
}

fn bounds(clusters: &[clusters::Cluster]) -> Bounds {
    let line = |f: &dyn Fn(&clusters::Cluster) -> f32| {
        Line(core::array::from_fn(|i| clusters.get(i).map_or(0.0, f)))
    };
    Bounds {
        centre: core::array::from_fn(|axis| line(&|cluster| cluster.centre[axis])),
        radius: line(&|cluster| cluster.radius),
        axis: core::array::from_fn(|axis| line(&|cluster| cluster.axis[axis])),
        cutoff: line(&|cluster| cluster.cutoff),
        present: ((1_u32 << clusters.len()) - 1) as u16,
    }
}
