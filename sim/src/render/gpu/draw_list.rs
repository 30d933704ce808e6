//! Draw lists: instances grouped by mesh for the rasteriser, and blocks of triangles for the compute kernels.

use core::ops::Range;

use super::assets::MeshRange;

/// Triangles per block, one per thread.
const TRIANGLES_PER_BLOCK: usize = 64;

/// An instanced draw call: all instances of one mesh in one view.
pub(super) struct DrawCall {
    pub(super) mesh: MeshRange,
    /// Range in [`DrawList::instance_indices`].
    pub(super) instances: Range<u32>,
}

/// The visible instances of a list of views.
#[derive(Default)]
pub(super) struct DrawList {
    /// Instances of the current view, by mesh index, in the order in which they were added.
    by_mesh: Vec<(Option<MeshRange>, Vec<u32>)>,
    /// Instance indices, ordered by view and mesh.
    pub(super) instance_indices: Vec<u32>,
    /// Draw calls, ordered by view.
    calls: Vec<DrawCall>,
    /// End of each view's range in `calls`.
    ends: Vec<usize>,
    /// Instance index and first triangle of each block.
    pub(super) blocks: Vec<[u32; 2]>,
}

impl DrawList {
    /// Removes all views.
    pub(super) fn clear(&mut self) {
        self.instance_indices.clear();
        self.calls.clear();
        self.ends.clear();
        self.blocks.clear();
    }

    /// Adds an instance of a mesh to the current view.
    pub(super) fn add(&mut self, mesh: MeshRange, instance: u32) {
        if self.by_mesh.len() <= mesh.mesh_idx {
            self.by_mesh.resize_with(mesh.mesh_idx + 1, Default::default);
        }
        let (added, instances) = &mut self.by_mesh[mesh.mesh_idx];
        *added = Some(mesh);
        instances.push(instance);
        let firsts = (0..mesh.n_triangles).step_by(TRIANGLES_PER_BLOCK);
        self.blocks.extend(firsts.map(|first| [instance, first]));
    }

    /// Completes the current view. The order of its draw calls does not depend on earlier batches.
    pub(super) fn end_view(&mut self) {
        let first = self.calls.len();
        for (mesh, instances) in &mut self.by_mesh {
            if let Some(mesh) = *mesh
                && !instances.is_empty()
            {
                let from = self.instance_indices.len() as u32;
                self.instance_indices.append(instances);
                self.calls.push(DrawCall { mesh, instances: from..self.instance_indices.len() as u32 });
            }
        }
        self.calls[first..].sort_unstable_by_key(|call| call.mesh.key);
        self.ends.push(self.calls.len());
    }

    /// Iterates over the draw calls of each view.
    pub(super) fn views(&self) -> impl Iterator<Item = &[DrawCall]> {
        let starts = core::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, end)| &self.calls[start..*end])
    }
}
