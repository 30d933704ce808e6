//! From a moment to the images of its cameras, and what their colours mean.

use super::depth::DepthRange;
use super::film::Moment;
use super::segments::{Entry, color_of, legend};
use crate::render::{CpuRenderer, Inspection, RenderScene};
use crate::scene::{Scene, Snapshot};

/// What of the cameras' views is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// What a policy sees.
    Rgb,
    /// How far away everything is.
    Depth,
    /// Which thing every pixel belongs to.
    Seg,
}

/// What the colours mean.
#[derive(Clone, Debug, PartialEq)]
pub enum Key {
    /// What they are.
    Rgb,
    /// Depths in this range, near bright; black where nothing is.
    Depth(DepthRange),
    /// These things.
    Seg(Vec<Entry>),
}

/// Paints moments.
pub(super) struct Painter {
    renderer: CpuRenderer,
    key: Key,
}

impl What {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Rgb, Self::Depth, Self::Seg];

    /// Name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Depth => "depth",
            Self::Seg => "seg",
        }
    }
}

impl Painter {
    /// One key for all of these moments; `drawn` are the scenes as they were drawn.
    pub(super) fn new(what: What, drawn: &[Scene], scenes: &[RenderScene], moments: &[Moment]) -> Self {
        let mut renderer = CpuRenderer::new(rayon::current_num_threads());
        let key = match what {
            What::Rgb => Key::Rgb,
            What::Depth => Key::Depth(depth_range(&mut renderer, scenes, moments)),
            What::Seg => Key::Seg(legend(drawn)),
        };
        Self { renderer, key }
    }

    pub(super) fn key(&self) -> &Key {
        &self.key
    }

    /// Every camera's side and its image, `[side, side, 3] u8` sRGB.
    pub(super) fn paint(&mut self, scene: &RenderScene, snapshot: &Snapshot) -> Vec<(usize, Vec<u8>)> {
        let Self { renderer, key } = self;
        let mut each = |image: &dyn Fn(Inspection) -> Vec<u8>| {
            let camera = |idx| (scene.side(idx), image(renderer.inspect(scene, snapshot, idx)));
            (0..scene.n_cameras()).map(camera).collect()
        };
        match key {
            Key::Rgb => renderer.photograph(scene, snapshot),
            Key::Depth(range) => each(&|seen| seen.depth_m.iter().flat_map(|x| range.color_of(*x)).collect()),
            Key::Seg(_) => each(&|seen| seen.segments.iter().flat_map(|x| color_of(*x)).collect()),
        }
    }
}

fn depth_range(renderer: &mut CpuRenderer, scenes: &[RenderScene], moments: &[Moment]) -> DepthRange {
    let mut range = DepthRange::EMPTY;
    for Moment { scene_idx, snapshot } in moments {
        let scene = &scenes[*scene_idx];
        for camera_idx in 0..scene.n_cameras() {
            range.widen(&renderer.inspect(scene, snapshot, camera_idx).depth_m);
        }
    }
    range
}
