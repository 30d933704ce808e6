//! The ResNet backbone: maps images to feature maps.

use std::ops::Range;

use ipc_types::ImageSize;

use super::architecture::{Architecture, Normalisation};
use super::checkpoint::tensors::BACKBONE;
use super::image::{Image, ImageScratch, Preprocessor};
use super::team::in_bands;
use crate::nn::Precision;
use crate::nn::conv::feature_map::FeatureMapShape;
use crate::nn::conv::pool::max_pool2d_3x3;
use crate::nn::conv::{Conv2d, ConvGeometry, ConvScratch, Epilogue, FrozenBatchNorm2d};
use crate::weights::StateDict;

/// A ResNet with the batch normalisations folded into the convolutions.
#[derive(Debug)]
pub(crate) struct Backbone {
    /// One preprocessor per camera.
    preprocessors: Vec<Preprocessor>,
    /// Ranges of consecutive cameras with equal image size, which are computed together.
    groups: Vec<Range<usize>>,
    stem: Conv2d,
    /// Blocks of the first stages, with large maps and small kernels. Each image passes through all of them
    /// before the next image, so that its maps stay in the cache.
    early: Vec<BasicBlock>,
    /// Blocks of the last stages, with small maps and large kernels. All images pass through a block before
    /// the next block, so that its kernels are read once.
    late: Vec<BasicBlock>,
}

/// Number of stages in [`Backbone::early`].
const N_EARLY_STAGES: usize = 2;

/// A residual block of two 3×3 convolutions, torchvision's `BasicBlock`.
#[derive(Debug)]
struct BasicBlock {
    conv1: Conv2d,
    conv2: Conv2d,
    /// 1×1 convolution of the skip connection, where input and output shapes differ.
    downsample: Option<Conv2d>,
}

/// Working memory for the images of a group of samples.
#[derive(Debug, Default)]
pub(crate) struct BackboneScratch {
    n_samples: usize,
    resize: ImageScratch,
    image: Vec<f32>,
    stem: Vec<f32>,
    early: BlockMaps,
    late: BlockMaps,
}

/// Feature maps of a block: input and output, after the first convolution, and skip connection.
type BlockMaps = [Vec<f32>; 3];

impl Backbone {
    /// Builds the backbone from a checked state dict, for images of these sizes.
    #[must_use]
    pub(crate) fn new(
        architecture: &Architecture,
        normalisation: &Normalisation,
        state_dict: &StateDict,
        precision: Precision,
        sizes: &[ImageSize],
    ) -> Self {
        let conv = |conv: &str, norm: &str, geometry, precision| {
            let part = |name: &str| state_dict.get(&format!("{BACKBONE}.{norm}.{name}"));
            let norm = FrozenBatchNorm2d {
                weight: part("weight"),
                bias: part("bias"),
                mean: part("running_mean"),
                variance: part("running_var"),
            };
            let weight = state_dict.get(&format!("{BACKBONE}.{conv}.weight"));
            Conv2d::with_batch_norm(weight, norm, geometry, precision)
        };
        let (mut early, mut late) = (Vec::new(), Vec::new());
        for (stage, n_blocks) in architecture.backbone.blocks.into_iter().enumerate() {
            for block in 0..n_blocks {
                let name = format!("layer{}.{block}", stage + 1);
                let downsamples = stage > 0 && block == 0;
                let stride = if downsamples { 2 } else { 1 };
                let same = ConvGeometry { kernel_size: 3, stride: 1, padding: 1 };
                let skip = ConvGeometry { kernel_size: 1, stride, padding: 0 };
                let (down, down_norm) = (format!("{name}.downsample.0"), format!("{name}.downsample.1"));
                let blocks = if stage < N_EARLY_STAGES { &mut early } else { &mut late };
                let block_conv = |idx: usize, geometry| {
                    conv(&format!("{name}.conv{idx}"), &format!("{name}.bn{idx}"), geometry, precision)
                };
                blocks.push(BasicBlock {
                    conv1: block_conv(1, ConvGeometry { stride, ..same }),
                    conv2: block_conv(2, same),
                    downsample: downsamples.then(|| conv(&down, &down_norm, skip, precision)),
                });
            }
        }
        let stem =
            conv("conv1", "bn1", ConvGeometry { kernel_size: 7, stride: 2, padding: 3 }, Precision::F32);
        let cameras = architecture.cameras.iter().zip(&normalisation.images);
        let preprocessors = cameras
            .map(|(&size, normalisation)| Preprocessor::new(size, normalisation.as_ref(), sizes))
            .collect();
        let mut groups: Vec<Range<usize>> = Vec::new();
        for same in architecture.cameras.chunk_by(|a, b| a == b) {
            let start = groups.last().map_or(0, |group| group.end);
            groups.push(start..start + same.len());
        }
        Self { preprocessors, groups, stem, early, late }
    }

    /// Allocates working memory for up to `n_samples` samples and grows that of every team member as needed.
    #[must_use]
    pub(crate) fn scratch(&self, n_samples: usize, members: &mut [ConvScratch]) -> BackboneScratch {
        let mut scratch = BackboneScratch { n_samples, ..BackboneScratch::default() };
        for group in &self.groups {
            self.preprocessors[group.start].reserve(&mut scratch.resize);
            let [image, stem, pooled] = self.shapes(group.start);
            grow(&mut scratch.image, image.len());
            grow(&mut scratch.stem, stem.len());
            members.iter_mut().for_each(|member| self.stem.reserve(image, member));
            let n_images = n_samples * group.len();
            let pooled = FeatureMapShape { batch: n_early(n_images, members.len()), ..pooled };
            let shape = reserve(&self.early, pooled, &mut scratch.early, members);
            reserve(&self.late, FeatureMapShape { batch: n_images, ..shape }, &mut scratch.late, members);
        }
        scratch
    }

    /// Computes `features`, the concatenation over samples and cameras of `[h, w, c]`, with a team of
    /// `members.len()` threads.
    ///
    /// # Panics
    /// If `scratch` was allocated for fewer samples, or `features` has the wrong length.
    pub(crate) fn forward<'a>(
        &self,
        n_samples: usize,
        image: impl Fn(usize, usize) -> Image<'a>,
        scratch: &mut BackboneScratch,
        members: &mut [ConvScratch],
        features: &mut [f32],
    ) {
        assert!(n_samples <= scratch.n_samples, "{n_samples} samples");
        let sample_len = features.len() / n_samples;
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
                let len = images.len() * shape.image_len();
                self.forward_early(images, pooled, scratch, members);
                let late = &mut scratch.late[0][start * shape.image_len()..][..len];
                late.copy_from_slice(&scratch.early[0][..len]);
            }
            let shape = forward_blocks(
                &self.late,
                FeatureMapShape { batch: n_images, ..shape },
                &mut scratch.late,
                members,
            );
            let row_len = shape.width * shape.channels;
            let group_len = group.len() * shape.height * row_len;
            for (image_row, row) in (0..shape.n_rows()).map(|row| (row, row % (group.len() * shape.height))) {
                let to = image_row / (group.len() * shape.height) * sample_len + first + row * row_len;
                let from = shape.offset(image_row / shape.height, image_row % shape.height, 0);
                features[to..to + row_len].copy_from_slice(&scratch.late[0][from..from + row_len]);
            }
            first += group_len;
        }
        assert_eq!(first, sample_len, "feature length of a sample");
    }

    /// Passes images of one size through the stem and the early stages, into the first of the early maps.
    /// `pooled` is their shape after pooling.
    fn forward_early<'a>(
        &self,
        images: impl ExactSizeIterator<Item = (usize, Image<'a>)>,
        pooled: FeatureMapShape,
        scratch: &mut BackboneScratch,
        members: &mut [ConvScratch],
    ) {
        let BackboneScratch { resize, image: pixels, stem, early, .. } = scratch;
        let n_images = images.len();
        for (idx, (camera, image)) in images.enumerate() {
            let preprocessor = &self.preprocessors[camera];
            let [image_shape, stem_shape, _] = self.shapes(camera);
            let (pixels, stem) = (&mut pixels[..image_shape.len()], &mut stem[..stem_shape.len()]);
            preprocessor.prepare(image, resize);
            in_bands(members, (pixels, image_shape), 1, |rows, out, _| {
                preprocessor.run(image, resize, rows, out);
            });
            convolve(&self.stem, (pixels, image_shape), (stem, stem_shape), Epilogue::Relu, members);
            let map = &mut early[0][idx * pooled.len()..][..pooled.len()];
            in_bands(members, (map, pooled), 1, |rows, out, _| {
                max_pool2d_3x3((stem, stem_shape), (out, pooled), rows);
            });
        }
        forward_blocks(&self.early, FeatureMapShape { batch: n_images, ..pooled }, early, members);
    }

    /// Returns the shapes of one image of a camera: preprocessed, after the stem, and after pooling.
    fn shapes(&self, camera: usize) -> [FeatureMapShape; 3] {
        let image = self.preprocessors[camera].shape();
        let stem = self.stem.output_shape(image, 1);
        let [height, width] = [stem.height, stem.width].map(|side| side.div_ceil(2));
        [image, stem, FeatureMapShape { height, width, ..stem }]
    }
}

/// Returns the number of images that pass through the early stages together: one for a single thread, all for
/// a team, which divides their rows among its members.
fn n_early(n_images: usize, n_members: usize) -> usize {
    if n_members > 1 { n_images } else { 1 }
}

fn grow(buffer: &mut Vec<f32>, len: usize) {
    buffer.resize(buffer.len().max(len), 0.0);
}

/// Returns the output shape of a sequence of blocks.
fn output_shape(blocks: &[BasicBlock], input: FeatureMapShape) -> FeatureMapShape {
    blocks.iter().fold(input, |shape, block| block.conv1.output_shape(shape, 1))
}

/// Grows the maps and the members' working memory to what the blocks need. Returns the output shape.
fn reserve(
    blocks: &[BasicBlock],
    mut shape: FeatureMapShape,
    maps: &mut BlockMaps,
    members: &mut [ConvScratch],
) -> FeatureMapShape {
    maps.iter_mut().for_each(|map| grow(map, shape.len()));
    for block in blocks {
        let inner = block.conv1.output_shape(shape, 1);
        for member in &mut *members {
            block.conv1.reserve(shape, member);
            block.conv2.reserve(inner, member);
            if let Some(downsample) = &block.downsample {
                downsample.reserve(shape, member);
            }
        }
        shape = inner;
        maps.iter_mut().for_each(|map| grow(map, shape.len()));
    }
    shape
}

/// Passes the first of the maps through the blocks in place. Returns its new shape.
fn forward_blocks(
    blocks: &[BasicBlock],
    mut shape: FeatureMapShape,
    [x, inner, skip]: &mut BlockMaps,
    members: &mut [ConvScratch],
) -> FeatureMapShape {
    for block in blocks {
        let out = block.conv1.output_shape(shape, 1);
        let (from, inner) = (&x[..shape.len()], &mut inner[..out.len()]);
        convolve(&block.conv1, (from, shape), (inner, out), Epilogue::Relu, members);
        if let Some(downsample) = &block.downsample {
            convolve(downsample, (from, shape), (&mut skip[..out.len()], out), Epilogue::Store, members);
            std::mem::swap(x, skip);
        }
        convolve(&block.conv2, (inner, out), (&mut x[..out.len()], out), Epilogue::AddRelu, members);
        shape = out;
    }
    shape
}

/// Computes a convolution with a team of threads.
fn convolve(
    conv: &Conv2d,
    input: (&[f32], FeatureMapShape),
    output: (&mut [f32], FeatureMapShape),
    epilogue: Epilogue,
    members: &mut [ConvScratch],
) {
    let shape = output.1;
    in_bands(members, output, conv.row_granularity(), |rows, out, scratch| {
        conv.forward(input, (out, shape), rows, epilogue, scratch);
    });
}
