//! The ResNet backbone: from the bytes of all cameras to image tokens.

use ipc_types::ImageSizes;

use super::layers::{StepList, TokenRows};
use crate::formats::ObservationMapping;
use crate::models::act::architecture::Normalisation;
use crate::models::act::checkpoint::tensors::BACKBONE;
use crate::models::act::image::Preprocessor;
use crate::nn::conv::{ConvGeometry, FrozenBatchNorm2d};
use crate::nn::gpu::DeviceBuffer;
use crate::nn::gpu::ops::{DeviceMaps, DeviceWeights, ImageSource, ProductEpilogue, SampleRows};

const STEM: ConvGeometry = ConvGeometry { kernel_size: 7, stride: 2, padding: 3 };

/// Returns the largest number of words per sample of a buffer of the backbone.
pub(crate) fn max_words(maps: DeviceMaps, width: usize) -> usize {
    maps.len().max(maps.convolved(STEM, width).len())
}

impl StepList<'_> {
    /// Adds the backbone, for images of these sizes. Returns the buffers of the cameras' bytes, each image
    /// padded to whole words.
    pub(crate) fn backbone(
        &mut self,
        normalisation: &Normalisation,
        (mapping, sizes): (&ObservationMapping, ImageSizes),
        n_leading: usize,
        tokens: &TokenRows,
    ) -> Vec<DeviceBuffer> {
        let cameras = &self.architecture.cameras;
        let (mut bytes, mut first_token) = (Vec::new(), n_leading);
        let projection = (!cameras.is_empty()).then(|| self.weights("input_proj"));
        for group in cameras.chunk_by(|a, b| a == b) {
            let (images, size) = (group.len(), group[0]);
            let maps = DeviceMaps { images, height: size.height, width: size.width, channels: 3 };
            let input = self.buffer("images", maps.len());
            for image in 0..images {
                let camera = bytes.len();
                let from = sizes.of_camera(mapping.morphology, mapping.cameras[camera]);
                let preprocessor = Preprocessor::new(size, normalisation.images[camera].as_ref(), &[from]);
                let source = self.buffer("bytes", from.n_bytes().div_ceil(4));
                let table = DeviceBuffer::of(self.ops.gpu, "values", preprocessor.values().as_flattened());
                let filters = preprocessor.filters(from);
                let filters = filters
                    .map(|(words, n_words)| (DeviceBuffer::of(self.ops.gpu, "filters", &words), n_words));
                let camera = ImageSource {
                    bytes: &source,
                    from: [from.height, from.width],
                    table: &table,
                    filters: filters.as_ref().map(|(filters, n_words)| (filters, *n_words)),
                    image,
                };
                let step = self.ops.image(camera, maps, &input);
                self.push(step);
                bytes.push(source);
            }
            let (features, maps) = self.residual_blocks(&input, maps);
            let n_tokens = maps.n_pixels();
            let (from, to) =
                (SampleRows::all(n_tokens), SampleRows { first: first_token, of: tokens.n_rows });
            if let Some(projection) = &projection {
                let step = self.ops.linear(
                    projection,
                    n_tokens,
                    (&features, from, None),
                    (&tokens.buffer, to),
                    ProductEpilogue::Store,
                );
                self.push(step);
            }
            first_token += n_tokens;
        }
        bytes
    }

    /// Adds stem, pooling and residual blocks. Returns the last maps.
    fn residual_blocks(&mut self, input: &DeviceBuffer, maps: DeviceMaps) -> (DeviceBuffer, DeviceMaps) {
        let backbone = self.architecture.backbone;
        let stem_maps = maps.convolved(STEM, backbone.width);
        let stem = self.buffer("stem", stem_maps.len());
        self.conv("conv1", "bn1", STEM, (input, maps), &stem, ProductEpilogue::Relu);
        let (height, width) = (stem_maps.height.div_ceil(2), stem_maps.width.div_ceil(2));
        let mut maps = DeviceMaps { height, width, ..stem_maps };
        let [mut x, y, mut skip] = ["maps"; 3].map(|label| self.buffer(label, maps.len()));
        let step = self.ops.max_pool((&stem, stem_maps), &x);
        self.push(step);
        for (stage, n_blocks) in backbone.blocks.into_iter().enumerate() {
            for block in 0..n_blocks {
                let name = format!("layer{}.{block}", stage + 1);
                let stride = if stage > 0 && block == 0 { 2 } else { 1 };
                let first = ConvGeometry { kernel_size: 3, stride, padding: 1 };
                let out = maps.convolved(first, backbone.channels(stage));
                let norms = [1, 2].map(|idx| (format!("{name}.conv{idx}"), format!("{name}.bn{idx}")));
                self.conv(&norms[0].0, &norms[0].1, first, (&x, maps), &y, ProductEpilogue::Relu);
                if stride > 1 {
                    let geometry = ConvGeometry { kernel_size: 1, stride, padding: 0 };
                    let (conv, norm) = (format!("{name}.downsample.0"), format!("{name}.downsample.1"));
                    self.conv(&conv, &norm, geometry, (&x, maps), &skip, ProductEpilogue::Store);
                    std::mem::swap(&mut x, &mut skip);
                }
                let second = ConvGeometry { stride: 1, ..first };
                self.conv(&norms[1].0, &norms[1].1, second, (&y, out), &x, ProductEpilogue::AddRelu);
                maps = out;
            }
        }
        (x, maps)
    }

    fn conv(
        &mut self,
        conv: &str,
        norm: &str,
        geometry: ConvGeometry,
        input: (&DeviceBuffer, DeviceMaps),
        out: &DeviceBuffer,
        epilogue: ProductEpilogue,
    ) {
        let part = |name: &str| self.state_dict.get(&format!("{BACKBONE}.{norm}.{name}"));
        let norm = FrozenBatchNorm2d {
            weight: part("weight"),
            bias: part("bias"),
            mean: part("running_mean"),
            variance: part("running_var"),
        };
        let weight = self.state_dict.get(&format!("{BACKBONE}.{conv}.weight"));
        let (matrix, bias) = norm.fold_into(weight, geometry);
        let layer = DeviceWeights::new(self.ops.gpu, &matrix, &bias);
        let step = self.ops.conv(&layer, geometry, input, out, epilogue);
        self.push(step);
    }
}
