//! ResNet-18 without its classifier: an image in, `[7, 7, 8·width]` features out.

use super::checkpoint::Weights;
use super::config::ActConfig;
use super::image::{IMAGE_SHAPE, Image, Preprocessor};
use super::tensors::{BACKBONE, BLOCKS_PER_STAGE, N_STAGES};
use crate::nn::conv::{Conv, ConvScratch, Finish, FrozenNorm, Window};
use crate::nn::maps::MapShape;
use crate::nn::pool::max_pool_3x3;

/// Side of the first stage's maps.
const FIRST_SIDE: usize = 56;

/// The network, its normalisations folded into its convolutions.
#[derive(Clone, Debug)]
pub(super) struct ResNet18 {
    preprocessor: Preprocessor,
    stem: Conv,
    blocks: Vec<Block>,
    width: usize,
}

/// A residual block.
#[derive(Clone, Debug)]
struct Block {
    first: Conv,
    second: Conv,
    /// Brings the input to the output's shape where they differ.
    downsample: Option<Conv>,
}

/// Working memory for up to a number of images at a time.
#[derive(Clone, Debug)]
pub(super) struct TrunkScratch {
    image: Vec<f32>,
    stem: Vec<f32>,
    /// The running features, a block's inner features, and its downsampled input.
    maps: [Vec<f32>; 3],
    conv: ConvScratch,
}

impl ResNet18 {
    /// From checked weights.
    #[must_use]
    pub(super) fn new(config: &ActConfig, weights: &Weights) -> Self {
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
        let mut blocks = Vec::with_capacity(N_STAGES * BLOCKS_PER_STAGE);
        for stage in 0..N_STAGES {
            for block in 0..BLOCKS_PER_STAGE {
                let name = format!("layer{}.{block}", stage + 1);
                let shrinks = stage > 0 && block == 0;
                let stride = if shrinks { 2 } else { 1 };
                let same = Window { kernel: 3, stride: 1, padding: 1 };
                let skip = Window { kernel: 1, stride, padding: 0 };
                let (down, down_norm) = (format!("{name}.downsample.0"), format!("{name}.downsample.1"));
                blocks.push(Block {
                    first: conv(&format!("{name}.conv1"), &format!("{name}.bn1"), Window { stride, ..same }),
                    second: conv(&format!("{name}.conv2"), &format!("{name}.bn2"), same),
                    downsample: shrinks.then(|| conv(&down, &down_norm, skip)),
                });
            }
        }
        let stem = conv("conv1", "bn1", Window { kernel: 7, stride: 2, padding: 3 });
        Self { preprocessor: Preprocessor::default(), stem, blocks, width: config.backbone_width }
    }

    /// Numbers in a pixel of the features.
    #[must_use]
    pub(super) fn n_features(&self) -> usize {
        self.width << (N_STAGES - 1)
    }

    /// Working memory for up to `n_images` at a time.
    #[must_use]
    pub(super) fn scratch(&self, n_images: usize) -> TrunkScratch {
        let mut conv = ConvScratch::default();
        self.stem.reserve(IMAGE_SHAPE, &mut conv);
        let mut shape = self.first_shape(n_images);
        let largest = shape.len();
        for block in &self.blocks {
            let inner = block.first.output_shape(shape, 1);
            block.first.reserve(shape, &mut conv);
            block.second.reserve(inner, &mut conv);
            if let Some(downsample) = &block.downsample {
                downsample.reserve(shape, &mut conv);
            }
            shape = inner;
        }
        TrunkScratch {
            image: vec![0.0; IMAGE_SHAPE.len()],
            stem: vec![0.0; self.stem.output_shape(IMAGE_SHAPE, 1).len()],
            maps: [vec![0.0; largest], vec![0.0; largest], vec![0.0; largest]],
            conv,
        }
    }

    /// Computes the features of `images` and hands each token's to `take(image_idx, row, col, features)`.
    ///
    /// # Panics
    /// If `scratch` was made for fewer images.
    pub(super) fn run<'a>(
        &self,
        images: impl Iterator<Item = Image<'a>>,
        scratch: &mut TrunkScratch,
        mut take: impl FnMut(usize, usize, usize, &[f32]),
    ) {
        let single = self.first_shape(1);
        let stem_shape = self.stem.output_shape(IMAGE_SHAPE, 1);
        let TrunkScratch { image: pixels, stem, maps: [x, inner, skip], conv } = scratch;
        let mut n_images = 0;
        for image in images {
            self.preprocessor.run(image, pixels);
            self.stem.run((pixels, IMAGE_SHAPE), (stem, stem_shape), Finish::Relu, conv);
            let map = &mut x[n_images * single.len()..(n_images + 1) * single.len()];
            max_pool_3x3(stem, stem_shape, map, single);
            n_images += 1;
        }
        let mut shape = self.first_shape(n_images);
        for block in &self.blocks {
            let out = block.first.output_shape(shape, 1);
            let (from, inner) = (&x[..shape.len()], &mut inner[..out.len()]);
            block.first.run((from, shape), (inner, out), Finish::Relu, conv);
            if let Some(downsample) = &block.downsample {
                downsample.run((from, shape), (&mut skip[..out.len()], out), Finish::Store, conv);
                std::mem::swap(x, skip);
            }
            block.second.run((inner, out), (&mut x[..out.len()], out), Finish::AddRelu, conv);
            shape = out;
        }
        for image_idx in 0..n_images {
            for row in 0..shape.side {
                for col in 0..shape.side {
                    let first = shape.offset(image_idx, row, col);
                    take(image_idx, row, col, &x[first..first + shape.channels]);
                }
            }
        }
    }

    fn first_shape(&self, n_maps: usize) -> MapShape {
        MapShape { n_maps, side: FIRST_SIDE, channels: self.width, border: 1 }
    }
}
