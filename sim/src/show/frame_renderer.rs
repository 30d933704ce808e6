//! Rendering of frames as colour, depth or segmentation images.

use std::collections::BTreeMap;
use std::ops::Range;

use ipc_types::ImageSize;

use super::depth::DepthRange;
use super::segmentation::{LegendEntry, color_of, legend};
use render::{CpuOptions, CpuRenderer, Inspection, RenderScene, Samples, Segment};
use scene::{Scene, Snapshot};

/// Number of pixels from which on a body counts as visible.
const VISIBLE_PIXELS: usize = 16;

/// Quantity shown by the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewMode {
    /// Colour, as policies receive it.
    Rgb,
    /// Depth along the optical axis.
    Depth,
    /// Object that covers each pixel.
    Seg,
}

/// Meaning of the colours.
#[derive(Clone, Debug, PartialEq)]
pub enum Legend {
    /// Colours of the scene.
    Rgb,
    /// Depths within this range; near is bright, and pixels without a surface are black.
    Depth(DepthRange),
    /// Objects by colour.
    Seg(Vec<LegendEntry>),
}

/// Renders frames of a sequence with a common legend.
pub(crate) struct FrameRenderer {
    renderer: CpuRenderer,
    legend: Legend,
}

impl ViewMode {
    /// All modes, the default first.
    pub const ALL: [Self; 3] = [Self::Rgb, Self::Depth, Self::Seg];

    /// Returns the name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Depth => "depth",
            Self::Seg => "seg",
        }
    }
}

impl FrameRenderer {
    /// Creates a renderer whose legend covers all frames. `scenes` are the prepared versions of `sampled`.
    pub(crate) fn new(
        mode: ViewMode,
        sampled: &[Scene],
        scenes: &[RenderScene],
        frames: &[SequenceFrame],
    ) -> Self {
        let mut renderer = CpuRenderer::new(rayon::current_num_threads());
        let legend = match mode {
            ViewMode::Rgb => Legend::Rgb,
            ViewMode::Depth => Legend::Depth(depth_range(&mut renderer, scenes, frames)),
            ViewMode::Seg => Legend::Seg(legend(sampled)),
        };
        Self { renderer, legend }
    }

    /// Renders colour images with this many samples per pixel from now on.
    pub(crate) fn set_samples(&mut self, samples: Samples) {
        let options = CpuOptions { samples, ..CpuOptions::default() };
        self.renderer = CpuRenderer::with_options(rayon::current_num_threads(), options);
    }

    pub(crate) fn legend(&self) -> &Legend {
        &self.legend
    }

    /// Counts the bodies of which a camera sees at least [`VISIBLE_PIXELS`] pixels.
    pub(crate) fn n_visible_bodies(
        &mut self,
        scene: &RenderScene,
        snapshot: &Snapshot,
        camera: usize,
    ) -> usize {
        let mut n_pixels = BTreeMap::new();
        for segment in self.renderer.inspect(scene, snapshot, camera).segments {
            if let Segment::Body(idx) = segment {
                *n_pixels.entry(idx).or_insert(0) += 1;
            }
        }
        n_pixels.into_values().filter(|n| *n >= VISIBLE_PIXELS).count()
    }

    /// Renders some cameras. Returns each camera's size and its `[height, width, 3] u8` sRGB image.
    pub(crate) fn render(
        &mut self,
        scene: &RenderScene,
        snapshot: &Snapshot,
        cameras: Range<usize>,
    ) -> Vec<(ImageSize, Vec<u8>)> {
        let Self { renderer, legend } = self;
        let mut for_each_camera = |to_image: &dyn Fn(Inspection) -> Vec<u8>| {
            let camera = |idx| (scene.size(idx), to_image(renderer.inspect(scene, snapshot, idx)));
            cameras.clone().map(camera).collect()
        };
        match legend {
            Legend::Rgb => renderer.render_camera_range(scene, snapshot, cameras.clone()),
            Legend::Depth(range) => for_each_camera(&|inspection| {
                inspection.depth_m.iter().flat_map(|depth_m| range.color_of(*depth_m)).collect()
            }),
            Legend::Seg(_) => for_each_camera(&|inspection| {
                inspection.segments.iter().flat_map(|segment| color_of(*segment)).collect()
            }),
        }
    }
}

/// Returns the range of depths over all cameras and frames.
fn depth_range(renderer: &mut CpuRenderer, scenes: &[RenderScene], frames: &[SequenceFrame]) -> DepthRange {
    let mut range = DepthRange::EMPTY;
    for SequenceFrame { scene_idx, snapshot, .. } in frames {
        let scene = &scenes[*scene_idx];
        for camera_idx in 0..scene.n_cameras() {
            range.extend(&renderer.inspect(scene, snapshot, camera_idx).depth_m);
        }
    }
    range
}

/// One frame of a sequence.
pub(crate) struct SequenceFrame {
    /// Index of the frame's scene.
    pub(crate) scene_idx: usize,
    /// Poses of bodies and links.
    pub(crate) snapshot: Snapshot,
    /// Number of control steps taken.
    pub(crate) step: u32,
}
