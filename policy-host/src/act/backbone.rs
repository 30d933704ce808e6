//! The residual network: an image in, a map of features out.

use std::ops::Range;

use super::architecture::{Architecture, ImageSize};
use super::image::{Image, ImageScratch, Preprocessor};
use super::normalise::Normalisation;
use super::team::in_bands;
use super::tensors::BACKBONE;
use crate::checkpoint::Weights;
use crate::nn::Precision;
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
        precision: Precision,
        sizes: &[ImageSize],
    ) -> Self {
        let conv = |conv: &str, norm: &str, window, precision| {
            let part = |name: &str| weights.get(&format!("{BACKBONE}.{norm}.{name}"));
            let norm = FrozenNorm {
                weight: part("weight"),
                bias: part("bias"),
                mean: part("running_mean"),
                variance: part("running_var"),
            };
            Conv::folded(weights.get(&format!("{BACKBONE}.{conv}.weight")), norm, window, precision)
        };
        let (mut early, mut late) = (Vec::new(), Vec::new());
        for (stage, n_blocks) in architecture.backbone.blocks.into_iter().enumerate() {
            for block in 0..n_blocks {
                let name = format!("layer{}.{block}", stage + 1);
                let shrinks = stage > 0 && block == 0;
                let stride = if shrinks { 2 } else { 1 };
                let same = Window { kernel: 3, stride: 1, padding: 1 };
                let skip = Window { kernel: 1, stride, padding: 0 };
                let (down, down_norm) = (format!("{name}.downsample.0"), format!("{name}.downsample.1"));
                let blocks = if stage < N_EARLY_STAGES { &mut early } else { &mut late };
                let of_block = |idx: usize, window| {
                    conv(&format!("{name}.conv{idx}"), &format!("{name}.bn{idx}"), window, precision)
                };
                blocks.push(Block {
                    first: of_block(1, Window { stride, ..same }),
                    second: of_block(2, same),
                    downsample: shrinks.then(|| conv(&down, &down_norm, skip, precision)),
                });
            }
        }
        let stem = conv("conv1", "bn1", Window { kernel: 7, stride: 2, padding: 3 }, Precision::F32);
        let cameras = architecture.cameras.iter().zip(&normalisation.images);
        let preprocessors =
            cameras.map(|(&size, affine)| Preprocessor::new(size, affine.as_ref(), sizes)).collect();
        let mut groups: Vec<Range<usize>> = Vec::new();
        for same in architecture.cameras.chunk_by(|a, b| a == b) {
            let start = groups.last().map_or(0, |group| group.end);
            groups.push(start..start + same.len());
        }
        Self { preprocessors, groups, stem, early, late }
    }

    /// Working memory for up to `n_samples` at a time; lets every member's grow to what it needs, too.
    #[must_use]
    pub(super) fn scratch(&self, n_samples: usize, members: &mut [ConvScratch]) -> TrunkScratch {
        let mut scratch = TrunkScratch { n_samples, ..TrunkScratch::default() };
        for group in &self.groups {
            self.preprocessors[group.start].reserve(&mut scratch.resize);
            let [image, stem, pooled] = self.shapes(group.start);
            grow(&mut scratch.image, image.len());
            grow(&mut scratch.stem, stem.len());
            members.iter_mut().for_each(|member| self.stem.reserve(image, member));
            let n_images = n_samples * group.len();
            let pooled = MapShape { n_maps: n_early(n_images, members.len()), ..pooled };
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
            let n_early = n_early(n_images, members.len());
            let [.., pooled] = self.shapes(group.start);
            let shape = output_shape(&self.early, pooled);
            for start in (0..n_images).step_by(n_early) {
                let images = (start..n_images.min(start + n_early)).map(|idx| {
                    let camera = group.start + idx % group.len();
                    (camera, image(idx / group.len(), camera))
                });
                let len = images.len() * shape.map_len();
                self.run_early(images, pooled, scratch, members);
                let late = &mut scratch.late[0][start * shape.map_len()..][..len];
                late.copy_from_slice(&scratch.early[0][..len]);
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

    /// Brings images of one size, `pooled` after the pooling, through the stem and the early stages, to the first of the
    /// early maps.
    fn run_early<'a>(
        &self,
        images: impl ExactSizeIterator<Item = (usize, Image<'a>)>,
        pooled: MapShape,
        scratch: &mut TrunkScratch,
        members: &mut [ConvScratch],
    ) {
        let TrunkScratch { resize, image: pixels, stem, early, .. } = scratch;
        let n_images = images.len();
        for (idx, (camera, image)) in images.enumerate() {
            let preprocessor = &self.preprocessors[camera];
            let [image_shape, stem_shape, _] = self.shapes(camera);
            let (pixels, stem) = (&mut pixels[..image_shape.len()], &mut stem[..stem_shape.len()]);
            preprocessor.prepare(image, resize);
            in_bands(members, (pixels, image_shape), 1, |lines, out, _| {
                preprocessor.run(image, resize, lines, out);
            });
            convolve(&self.stem, (pixels, image_shape), (stem, stem_shape), Finish::Relu, members);
            let map = &mut early[0][idx * pooled.len()..][..pooled.len()];
            in_bands(members, (map, pooled), 1, |lines, out, _| {
                max_pool_3x3((stem, stem_shape), (out, pooled), lines);
            });
        }
        run_blocks(&self.early, MapShape { n_maps: n_images, ..pooled }, early, members);
    }

    /// Shapes of one image of a camera: as prepared, after the stem, and after the pooling.
    fn shapes(&self, camera: usize) -> [MapShape; 3] {
        let image = self.preprocessors[camera].shape();
        let stem = self.stem.output_shape(image, 1);
        let [height, width] = [stem.height, stem.width].map(|side| side.div_ceil(2));
        [image, stem, MapShape { height, width, ..stem }]
    }
}

/// Images that go through the early stages together: one, but all of them where a team has to share out their lines.
fn n_early(n_images: usize, n_members: usize) -> usize {
    if n_members > 1 { n_images } else { 1 }
}

fn grow(buffer: &mut Vec<f32>, len: usize) {
    buffer.resize(buffer.len().max(len), 0.0);
}

/// Shape of what these blocks make of such an input.
fn output_shape(blocks: &[Block], input: MapShape) -> MapShape {
    blocks.iter().fold(input, |shape, block| block.first.output_shape(shape, 1))
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
