//! What is to be drawn in one pass: instances by mesh for the rasteriser, blocks of triangles for the compute kernels.

use super::assets::MeshPlace;

/// Triangles of a block: one thread each.
pub(super) const TRIANGLES_PER_BLOCK: u32 = 64;

/// Instances of one mesh.
pub(super) struct Draw {
    pub(super) place: MeshPlace,
    /// Range of [`Drawing::drawn`].
    pub(super) first: u32,
    pub(super) n: u32,
}

/// The instances of a pass.
#[derive(Default)]
pub(super) struct Drawing {
    /// Per mesh: where it lies and which instances show it, in their order.
    by_mesh: Vec<(Option<MeshPlace>, Vec<u32>)>,
    /// Instances, those of one mesh together.
    pub(super) drawn: Vec<u32>,
    /// One per mesh.
    pub(super) draws: Vec<Draw>,
    /// An instance and the first of up to [`TRIANGLES_PER_BLOCK`] of its triangles.
    pub(super) blocks: Vec<[u32; 2]>,
}

impl Drawing {
    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.drawn.clear();
        self.draws.clear();
        self.blocks.clear();
        for (_, instances) in &mut self.by_mesh {
            instances.clear();
        }
    }

    /// Adds an instance of a mesh.
    pub(super) fn add(&mut self, place: MeshPlace, instance: u32) {
        if self.by_mesh.len() <= place.mesh_idx {
            self.by_mesh.resize_with(place.mesh_idx + 1, Default::default);
        }
        let (known, instances) = &mut self.by_mesh[place.mesh_idx];
        *known = Some(place);
        instances.push(instance);
        let firsts = (0..place.n_triangles).step_by(TRIANGLES_PER_BLOCK as usize);
        self.blocks.extend(firsts.map(|first| [instance, first]));
    }

    /// Puts the instances of each mesh together, in an order that does not depend on what was drawn before.
    pub(super) fn finish(&mut self) {
        for (place, instances) in &self.by_mesh {
            if let Some(place) = *place
                && !instances.is_empty()
            {
                let (first, n) = (self.drawn.len() as u32, instances.len() as u32);
                self.drawn.extend_from_slice(instances);
                self.draws.push(Draw { place, first, n });
            }
        }
        self.draws.sort_unstable_by_key(|draw| draw.place.id);
    }
}
