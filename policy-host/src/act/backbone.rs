//! The residual network: an image in, a map of features out.

use std::ops::Range;

use super::architecture::{Architecture, ImageSize, ResNet};
use super::image::{Image, ImageScratch, Preprocessor};
use super::normalise::Normalisation;
use super::team::in_bands;
use super::tensors::BACKBONE;
use crate::checkpoint::Weights;
use crate::nn::conv::{Conv, ConvScratch, Finish, FrozenNorm, Window};
use crate::nn::maps::MapShape;
use crate::nn::pool::max_pool_3x3;

/// The network, its normalisations folded into its convolutions.
#[derive(Debug)]
pub(super) struct Backbone {
    /// One for each camera.
    preprocessors: Vec<Preprocessor>,
    /// Neighbouring cameras whose images have the same sides, and so go through the network together.
    groups: Vec<Range<usize>>,
    stem: Conv,
    /// Of the stages whose maps are large and kernels small: an image goes through all of them before the next, so that its
    /// maps stay in the cache.
    early: Vec<Block>,
    /// Of the stages whose maps are small and kernels large: all images go through a block before the next, so that its
    /// kernels are read once.
    late: Vec<Block>,
    resnet: ResNet,
}

/// Stages that are early.
const N_EARLY_STAGES: usize = 2;

/// A residual block.
#[derive(Debug)]
struct Block {
    first: Conv,
    second: Conv,
    /// Brings the input to the output's shape where they differ.
    downsample: Option<Conv>,
}

/// Working memory for the images of some samples.
#[derive(Debug, Default)]
pub(super) struct TrunkScratch {
    n_samples: usize,
    resize: ImageScratch,
    image: Vec<f32>,
    stem: Vec<f32>,
    early: Maps,
    late: Maps,
}

/// The running features, a block's inner features, and its downsampled input.
type Maps = [Vec<f32>; 3];

impl Backbone {
    /// From checked weights, for images of these sizes.
    #[must_use]
    pub(super) fn new(
        architecture: &Architecture,
        normalisation: &Normalisation,
        weights: &Weights,
        sizes: &[ImageSize],
    ) -> Self {
        let conv = |conv: &str, norm: &str, window| {
            let part = |name: &str| weights.get(&format!("{BACKBONE}.{norm}.{name}"));
            let norm = FrozenNorm {
                weight: part("weight"),
                bias: part("bias"),
                mean: part("running_mean"),
                variance: part("running_var"),
            };
            Conv::folded(weights.get(&format!("{BACKBONE}.{conv}.weight")), norm, window)
        };
        let resnet = architecture.backbone;
        let (mut early, mut late) = (Vec::new(), Vec::new());
        for (stage, n_blocks) in resnet.blocks.into_iter().enumerate() {
            for block in 0..n_blocks {
                let name = format!("layer{}.{block}", stage + 1);
                let shrinks = stage > 0 && block == 0;
                let stride = if shrinks { 2 } else { 1 };
                let same = Window { kernel: 3, stride: 1, padding: 1 };
                let skip = Window { kernel: 1, stride, padding: 0 };
                let (down, down_norm) = (format!("{name}.downsample.0"), format!("{name}.downsample.1"));
                let blocks = if stage < N_EARLY_STAGES { &mut early } else { &mut late };
                blocks.push(Block {
                    first: conv(&format!("{name}.conv1"), &format!("{name}.bn1"), Window { stride, ..same }),
                    second: conv(&format!("{name}.conv2"), &format!("{name}.bn2"), same),
                    downsample: shrinks.then(|| conv(&down, &down_norm, skip)),
                });
            }
        }
        let stem = conv("conv1", "bn1", Window { kernel: 7, stride: 2, padding: 3 });
        let cameras = architecture.cameras.iter().zip(&normalisation.images);
        let preprocessors =
            cameras.map(|(&size, affine)| Preprocessor::new(size, affine.as_ref(), sizes)).collect();
        let mut groups: Vec<Range<usize>> = Vec::new();
        for same in architecture.cameras.chunk_by(|a, b| a == b) {
            let start = groups.last().map_or(0, |group| group.end);
            groups.push(start..start + same.len());
        }
        Self { preprocessors, groups, stem, early, late, resnet }
    }

    /// Working memory for up to `n_samples` at a time; lets every member's grow to what it needs, too.
    #[must_use]
    pub(super) fn scratch(&self, n_samples: usize, members: &mut [ConvScratch]) -> TrunkScratch {
        let mut scratch = TrunkScratch { n_samples, ..TrunkScratch::default() };
        for group in &self.groups {
            let preprocessor = &self.preprocessors[group.start];
            preprocessor.reserve(&mut scratch.resize);
            let image = preprocessor.shape();
            let stem = self.stem.output_shape(image, 1);
            grow(&mut scratch.image, image.len());
            grow(&mut scratch.stem, stem.len());
            members.iter_mut().for_each(|member| self.stem.reserve(image, member));
            let n_images = n_samples * group.len();
            let pooled = self.pooled_shape(stem, self.n_early(n_images, members.len()));
            let shape = reserve(&self.early, pooled, &mut scratch.early, members);
            reserve(&self.late, MapShape { n_maps: n_images, ..shape }, &mut scratch.late, members);
        }
        scratch
    }

    /// The features of the images of `n_samples`, sample after sample and camera after camera
    /// `[height, width, n_features]`, by a team of as many threads as there are `members`.
    ///
    /// # Panics
    /// If there are more samples than the working memory is for, or `features` does not have its size.
    pub(super) fn run<'a>(
        &self,
        n_samples: usize,
        image: impl Fn(usize, usize) -> Image<'a>,
        scratch: &mut TrunkScratch,
        members: &mut [ConvScratch],
        features: &mut [f32],
    ) {
        assert!(n_samples <= scratch.n_samples, "{n_samples} samples");
        let len_of_sample = features.len() / n_samples;
        let mut first = 0;
        for group in &self.groups {
            let n_images = n_samples * group.len();
            let n_early = self.n_early(n_images, members.len());
            let mut shape = MapShape { n_maps: 0, height: 0, width: 0, channels: 0, border: 1 };
            for start in (0..n_images).step_by(n_early) {
                let images = (start..n_images.min(start + n_early)).map(|idx| {
                    let camera = group.start + idx % group.len();
                    (camera, image(idx / group.len(), camera))
                });
                shape = self.run_early(images, scratch, members);
                let late = &mut scratch.late[0][start * shape.map_len()..][..shape.len()];
                late.copy_from_slice(&scratch.early[0][..shape.len()]);
            }
            let shape =
                run_blocks(&self.late, MapShape { n_maps: n_images, ..shape }, &mut scratch.late, members);
            let row_len = shape.width * shape.channels;
            let len_of_group = group.len() * shape.height * row_len;
            for (line, row) in (0..shape.n_lines()).map(|line| (line, line % (group.len() * shape.height))) {
                let to = line / (group.len() * shape.height) * len_of_sample + first + row * row_len;
                let from = shape.offset(line / shape.height, line % shape.height, 0);
                features[to..to + row_len].copy_from_slice(&scratch.late[0][from..from + row_len]);
            }
            first += len_of_group;
        }
        assert_eq!(first, len_of_sample, "features of a sample");
    }

    /// Images that go through the early stages together: one, but all of them where a team has to share out their lines.
    fn n_early(&self, n_images: usize, n_members: usize) -> usize {
        if n_members > 1 { n_images } else { 1 }
    }

    /// Brings images of one size through the stem and the early stages, to the first of the early maps; their shape is
    /// returned.
    fn run_early<'a>(
        &self,
        images: impl ExactSizeIterator<Item = (usize, Image<'a>)>,
        scratch: &mut TrunkScratch,
        members: &mut [ConvScratch],
    ) -> MapShape {
        let TrunkScratch { resize, image: pixels, stem, early, .. } = scratch;
        let n_images = images.len();
        let mut pooled = MapShape { n_maps: 0, height: 0, width: 0, channels: 0, border: 1 };
        for (idx, (camera, image)) in images.enumerate() {
            let preprocessor = &self.preprocessors[camera];
            let image_shape = preprocessor.shape();
            let stem_shape = self.stem.output_shape(image_shape, 1);
            let (pixels, stem) = (&mut pixels[..image_shape.len()], &mut stem[..stem_shape.len()]);
            preprocessor.prepare(image, resize);
            in_bands(members, (pixels, image_shape), 1, |lines, out, _| {
                preprocessor.run(image, resize, lines, out);
            });
            convolve(&self.stem, (pixels, image_shape), (stem, stem_shape), Finish::Relu, members);
            pooled = self.pooled_shape(stem_shape, n_images);
            let map = &mut early[0][idx * pooled.map_len()..][..pooled.map_len()];
            in_bands(members, (map, pooled.single()), 1, |lines, out, _| {
                max_pool_3x3((stem, stem_shape), (out, pooled.single()), lines);
            });
        }
        run_blocks(&self.early, pooled, early, members)
    }

    fn pooled_shape(&self, stem: MapShape, n_maps: usize) -> MapShape {
        let [height, width] = [stem.height, stem.width].map(|side| side.div_ceil(2));
        MapShape { n_maps, height, width, channels: self.resnet.width, border: 1 }
    }
}

fn grow(buffer: &mut Vec<f32>, len: usize) {
    buffer.resize(buffer.len().max(len), 0.0);
}

/// Lets maps and members grow to what these blocks need for such an input; the output's shape is returned.
fn reserve(blocks: &[Block], mut shape: MapShape, maps: &mut Maps, members: &mut [ConvScratch]) -> MapShape {
    maps.iter_mut().for_each(|map| grow(map, shape.len()));
    for block in blocks {
        let inner = block.first.output_shape(shape, 1);
        for member in &mut *members {
            block.first.reserve(shape, member);
            block.second.reserve(inner, member);
            if let Some(downsample) = &block.downsample {
                downsample.reserve(shape, member);
            }
        }
        shape = inner;
        maps.iter_mut().for_each(|map| grow(map, shape.len()));
    }
    shape
}

/// Brings the first of the maps through these blocks; its shape is returned.
fn run_blocks(
    blocks: &[Block],
    mut shape: MapShape,
    [x, inner, skip]: &mut Maps,
    members: &mut [ConvScratch],
) -> MapShape {
    for block in blocks {
        let out = block.first.output_shape(shape, 1);
        let (from, inner) = (&x[..shape.len()], &mut inner[..out.len()]);
        convolve(&block.first, (from, shape), (inner, out), Finish::Relu, members);
        if let Some(downsample) = &block.downsample {
            convolve(downsample, (from, shape), (&mut skip[..out.len()], out), Finish::Store, members);
            std::mem::swap(x, skip);
        }
        convolve(&block.second, (inner, out), (&mut x[..out.len()], out), Finish::AddRelu, members);
        shape = out;
    }
    shape
}

fn convolve(
    conv: &Conv,
    input: (&[f32], MapShape),
    output: (&mut [f32], MapShape),
    finish: Finish,
    members: &mut [ConvScratch],
) {
    let shape = output.1;
    in_bands(members, output, conv.lines_together(), |lines, out, scratch| {
        conv.run(input, (out, shape), lines, finish, scratch);
    });
}
