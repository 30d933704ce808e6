//! A mesh once more, as vector code reads it: sixteen triangles side by side, and the bounds of sixteen such clusters.

use super::clusters::{self, CLUSTER_SIZE};
use super::{Facing, Mesh};
use crate::render::affine::Vec3;
use crate::render::line::{Line, N_LANES, ShortLine, WholeLine};

const _: () = assert!(CLUSTER_SIZE == N_LANES, "a cluster's triangles are one vector");

/// A vector of points or directions, one line per axis.
pub(in crate::render) type Lines3 = [Line; 3];

/// Positions of the three corners of a cluster's sixteen triangles, by corner and axis, in steps of
/// [`Batches::steps`]: half the memory that every picture reads. Lanes without a triangle hold one that is a single point.
pub(in crate::render) type Corners = [[ShortLine; 3]; 3];

/// What else there is to know of sixteen triangles.
pub(in crate::render) struct Batch {
    /// Normals at the three corners.
    pub(in crate::render) normals: [Lines3; 3],
    /// [`Facing`] as a number.
    pub(in crate::render) facing: WholeLine,
    /// Bit i: the normals of triangle i are one.
    pub(in crate::render) flat: u16,
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
    pub(in crate::render) corners: Vec<Corners>,
    /// Powers of 2 in the mesh's unit of length, one per axis.
    pub(in crate::render) steps: Vec3,
    /// One per sixteen triangles.
    pub(in crate::render) batches: Vec<Batch>,
    /// One per sixteen batches.
    pub(in crate::render) bounds: Vec<Bounds>,
}

impl Batches {
    /// Of a mesh whose triangles are in their final order and whose coordinates are multiples of [`steps`].
    pub(super) fn new(mesh: &Mesh) -> Self {
        let steps = steps(mesh);
        let runs = (0..mesh.triangles.len()).step_by(CLUSTER_SIZE);
        let clusters = clusters::of(mesh);
        Self {
            corners: runs.clone().map(|first| corners(mesh, first, steps)).collect(),
            steps,
            batches: runs.map(|first| batch(mesh, first)).collect(),
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

fn corners(mesh: &Mesh, first: usize, steps: Vec3) -> Corners {
    let n = CLUSTER_SIZE.min(mesh.triangles.len() - first);
    let mut all = [[ShortLine::ZERO; 3]; 3];
    for lane in 0..CLUSTER_SIZE {
        let corners = mesh.triangles[first + lane.min(n - 1)];
        for (k, corner) in corners.into_iter().enumerate() {
            let position = mesh.position(if lane < n { corner } else { corners[0] });
            for axis in 0..3 {
                all[k][axis].0[lane] = (position[axis] / steps[axis]) as i16;
            }
        }
    }
    all
}

fn batch(mesh: &Mesh, first: usize) -> Batch {
    let n = CLUSTER_SIZE.min(mesh.triangles.len() - first);
    let mut batch = Batch { normals: [[Line::ZERO; 3]; 3], facing: WholeLine::ZERO, flat: 0 };
    for lane in 0..CLUSTER_SIZE {
        let triangle = first + lane.min(n - 1);
        let corners = mesh.triangles[triangle];
        for (k, corner) in corners.into_iter().enumerate() {
            let corner = if lane < n { corner } else { corners[0] };
            let normal = mesh.normals[corner as usize];
            for (line, x) in batch.normals[k].iter_mut().zip(normal) {
                line.0[lane] = x;
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
