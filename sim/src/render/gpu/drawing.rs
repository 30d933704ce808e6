//! What is to be drawn: per view the instances by mesh for the rasteriser, blocks of triangles for the compute kernels.

use core::ops::Range;

use super::assets::MeshPlace;

/// Triangles of a block: one thread each.
const TRIANGLES_PER_BLOCK: usize = 64;

/// Instances of one mesh in one view.
pub(super) struct Draw {
    pub(super) place: MeshPlace,
    /// Of [`Drawing::drawn`].
    pub(super) instances: Range<u32>,
}

/// The instances of some views.
#[derive(Default)]
pub(super) struct Drawing {
    /// Of the view at hand, per mesh: where it lies and which instances show it, in their order.
    by_mesh: Vec<(Option<MeshPlace>, Vec<u32>)>,
    /// Instances: view after view, those of one mesh together.
    pub(super) drawn: Vec<u32>,
    /// View after view.
    draws: Vec<Draw>,
    /// Per view where its draws end.
    ends: Vec<usize>,
    /// An instance and the first of up to 64 of its triangles.
    pub(super) blocks: Vec<[u32; 2]>,
}

impl Drawing {
    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.drawn.clear();
        self.draws.clear();
        self.ends.clear();
        self.blocks.clear();
    }

    /// Adds an instance of a mesh to the view at hand.
    pub(super) fn add(&mut self, place: MeshPlace, instance: u32) {
        if self.by_mesh.len() <= place.mesh_idx {
            self.by_mesh.resize_with(place.mesh_idx + 1, Default::default);
        }
        let (known, instances) = &mut self.by_mesh[place.mesh_idx];
        *known = Some(place);
        instances.push(instance);
        let firsts = (0..place.n_triangles).step_by(TRIANGLES_PER_BLOCK);
        self.blocks.extend(firsts.map(|first| [instance, first]));
    }

    /// Ends the view at hand. The order of its draws does not depend on what was drawn before.
    pub(super) fn end_view(&mut self) {
        let first = self.draws.len();
        for (place, instances) in &mut self.by_mesh {
            if let Some(place) = *place
                && !instances.is_empty()
            {
                let from = self.drawn.len() as u32;
                self.drawn.append(instances);
                self.draws.push(Draw { place, instances: from..self.drawn.len() as u32 });
            }
        }
        self.draws[first..].sort_unstable_by_key(|draw| draw.place.key);
        self.ends.push(self.draws.len());
    }

    /// Per view what it draws.
    pub(super) fn views(&self) -> impl Iterator<Item = &[Draw]> {
        let starts = core::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, end)| &self.draws[start..*end])
    }
}
