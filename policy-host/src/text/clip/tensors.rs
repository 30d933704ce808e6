//! The tensors of CLIP's text tower: names in Hugging Face and OpenAI files, shapes, and fingerprint.
//!
//! The canonical form is Hugging Face's: its names, its axis order and its separate projections. OpenAI's
//! files store the query, key and value projections of a layer as one tensor and the final projection
//! transposed.

use std::path::Path;

use xxhash_rust::xxh3::Xxh3;

use super::fingerprint::WeightsFingerprint;
use super::tokens::{MAX_TOKENS, VOCABULARY};
use crate::weights::{StateDict, TensorFile, TensorSpec, WeightsError};

/// Width of an attention head.
pub(crate) const HEAD_WIDTH: usize = 64;
/// Maximum number of layers of a tower.
const MAX_LAYERS: usize = 64;

// Canonical names.
pub(crate) const TOKENS: &str = "text_model.embeddings.token_embedding.weight";
pub(crate) const POSITIONS: &str = "text_model.embeddings.position_embedding.weight";
pub(crate) const LAYERS: &str = "text_model.encoder.layers";
pub(crate) const FINAL_NORM: &str = "text_model.final_layer_norm";
pub(crate) const PROJECTION: &str = "text_projection.weight";

/// Dimensions of a text tower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TowerShape {
    /// Number of transformer layers.
    pub n_layers: usize,
    /// Width `d` of a token, a multiple of the head width 64.
    pub width: usize,
    /// Dimension of an embedding.
    pub dim: usize,
}

/// Tensor naming scheme of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NamingScheme {
    HuggingFace,
    OpenAi,
}

/// Relation of a canonical tensor to the stored tensor that contains it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StoredLayout {
    /// The stored tensor itself.
    Identity,
    /// One of three equal blocks of rows: query, key, value.
    QkvBlock(usize),
    /// The transpose of the stored tensor.
    Transposed,
}

/// An open weights file whose tensors have been checked by name and shape.
#[derive(Debug)]
pub(crate) struct TowerFile {
    file: TensorFile,
    scheme: NamingScheme,
    shape: TowerShape,
}

impl TowerFile {
    /// Opens the file and checks its header. Unknown tensors are ignored: the file may also contain the
    /// vision tower.
    pub(crate) fn open(path: &Path) -> Result<Self, WeightsError> {
        let file = TensorFile::open(path)?;
        let is_open_ai = file.contains(&NamingScheme::OpenAi.stored(TOKENS).0);
        let scheme = if is_open_ai { NamingScheme::OpenAi } else { NamingScheme::HuggingFace };
        let shape = scheme.tower_shape(&file)?;
        let tower = Self { file, scheme, shape };
        for spec in shape.tensors() {
            let (stored, shape, _) = tower.locate(&spec);
            tower.file.check(&stored, &shape)?;
        }
        Ok(tower)
    }

    pub(crate) fn shape(&self) -> TowerShape {
        self.shape
    }

    /// Checks that embeddings have dimension `dim`.
    pub(crate) fn check_dim(&self, dim: usize) -> Result<(), WeightsError> {
        let expected = TensorSpec { name: PROJECTION.to_owned(), shape: vec![dim, self.shape.width] };
        let (stored, shape, _) = self.locate(&expected);
        self.file.check(&stored, &shape)
    }

    /// Reads all tensors in canonical form and computes their fingerprint.
    pub(crate) fn read(mut self) -> Result<(StateDict, WeightsFingerprint), WeightsError> {
        let (mut state_dict, mut hash) = (StateDict::default(), Xxh3::new());
        for spec in self.shape.tensors() {
            let (stored, _, layout) = self.locate(&spec);
            let values = layout.to_canonical(self.file.read(&stored)?, &spec.shape);
            hash.update(spec.name.as_bytes());
            hash.update(&[0]);
            for block in values.chunks(1 << 14) {
                hash.update(&block.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>());
            }
            state_dict.insert(spec.name, values);
        }
        Ok((state_dict, WeightsFingerprint(hash.digest())))
    }

    /// Returns the stored name and shape of the tensor that contains a canonical one, and the relation
    /// between the two.
    fn locate(&self, spec: &TensorSpec) -> (String, Vec<usize>, StoredLayout) {
        let (name, layout) = self.scheme.stored(&spec.name);
        let mut shape = spec.shape.clone();
        match layout {
            StoredLayout::Identity => {}
            StoredLayout::QkvBlock(_) => shape[0] *= 3,
            StoredLayout::Transposed => shape.reverse(),
        }
        (name, shape, layout)
    }
}

impl TowerShape {
    /// Returns the canonical tensors in the order in which the fingerprint hashes them.
    pub fn tensors(self) -> impl Iterator<Item = TensorSpec> {
        let Self { n_layers, width, dim } = self;
        let first = [spec(TOKENS, "", &[VOCABULARY, width]), spec(POSITIONS, "", &[MAX_TOKENS, width])];
        let layers = (0..n_layers).flat_map(move |layer| layer_tensors(&format!("{LAYERS}.{layer}"), width));
        let last = norm(FINAL_NORM, width).into_iter().chain([spec(PROJECTION, "", &[dim, width])]);
        first.into_iter().chain(layers).chain(last)
    }
}

fn layer_tensors(name: &str, width: usize) -> impl Iterator<Item = TensorSpec> + use<> {
    let attention = ["q_proj", "k_proj", "v_proj", "out_proj"]
        .map(|part| linear(&format!("{name}.self_attn.{part}"), width, width));
    let tensors = [norm(&format!("{name}.layer_norm1"), width)]
        .into_iter()
        .chain(attention)
        .chain([norm(&format!("{name}.layer_norm2"), width)])
        .chain([linear(&format!("{name}.mlp.fc1"), 4 * width, width)])
        .chain([linear(&format!("{name}.mlp.fc2"), width, 4 * width)]);
    tensors.flatten()
}

fn linear(name: &str, n_out: usize, n_in: usize) -> [TensorSpec; 2] {
    [spec(name, ".weight", &[n_out, n_in]), spec(name, ".bias", &[n_out])]
}

fn norm(name: &str, width: usize) -> [TensorSpec; 2] {
    [".weight", ".bias"].map(|part| spec(name, part, &[width]))
}

fn spec(name: &str, part: &str, shape: &[usize]) -> TensorSpec {
    TensorSpec { name: format!("{name}{part}"), shape: shape.to_vec() }
}

impl NamingScheme {
    /// Derives the dimensions of the tower from the shapes in a file.
    fn tower_shape(self, file: &TensorFile) -> Result<TowerShape, WeightsError> {
        let width = match self.axes(file, TOKENS)?[..] {
            [VOCABULARY, width] if width > 0 && width % HEAD_WIDTH == 0 => width,
            _ => {
                return Err(self.mismatch(
                    file,
                    TOKENS,
                    format!("F32 [{VOCABULARY}, a multiple of {HEAD_WIDTH}]"),
                ));
            }
        };
        let dim = match (self, &self.axes(file, PROJECTION)?[..]) {
            (Self::HuggingFace, &[dim, _]) | (Self::OpenAi, &[_, dim]) if dim > 0 => dim,
            _ => return Err(self.mismatch(file, PROJECTION, format!("a matrix with one axis of {width}"))),
        };
        let prefix = format!("{}.", self.stored(LAYERS).0);
        let layer_of = |name: &str| name.strip_prefix(&prefix)?.split('.').next()?.parse::<usize>().ok();
        let last = file.names().iter().filter_map(|name| layer_of(name)).max().unwrap_or(0);
        Ok(TowerShape { n_layers: last.saturating_add(1).min(MAX_LAYERS), width, dim })
    }

    fn axes(self, file: &TensorFile, name: &str) -> Result<Vec<usize>, WeightsError> {
        let stored = self.stored(name).0;
        let missing = || WeightsError::Missing {
            path: file.path().to_owned(),
            tensor: stored.clone(),
            expected: "the text tower of CLIP ViT-B/32 under Hugging Face's names or OpenAI's".to_owned(),
        };
        file.shape(&stored).map(<[usize]>::to_vec).ok_or_else(missing)
    }

    fn mismatch(self, file: &TensorFile, name: &str, expected: String) -> WeightsError {
        let tensor = self.stored(name).0;
        let found = file.describe(&tensor).unwrap_or_default();
        WeightsError::Mismatch { path: file.path().to_owned(), tensor, expected, found }
    }

    /// Returns the name of the stored tensor that contains a canonical one, and the relation between the two.
    fn stored(self, name: &str) -> (String, StoredLayout) {
        if self == Self::HuggingFace {
            return (name.to_owned(), StoredLayout::Identity);
        }
        match name {
            TOKENS => return ("token_embedding.weight".to_owned(), StoredLayout::Identity),
            POSITIONS => return ("positional_embedding".to_owned(), StoredLayout::Identity),
            PROJECTION => return ("text_projection".to_owned(), StoredLayout::Transposed),
            _ => {}
        }
        if let Some(rest) = name.strip_prefix(FINAL_NORM) {
            return (format!("ln_final{rest}"), StoredLayout::Identity);
        }
        let (mut stored, mut layout) =
            (name.replace(LAYERS, "transformer.resblocks"), StoredLayout::Identity);
        for (canonical, open_ai) in [
            ("self_attn.out_proj", "attn.out_proj"),
            ("layer_norm", "ln_"),
            ("mlp.fc1", "mlp.c_fc"),
            ("mlp.fc2", "mlp.c_proj"),
        ] {
            stored = stored.replace(canonical, open_ai);
        }
        for (block, projection) in ["q_proj.", "k_proj.", "v_proj."].into_iter().enumerate() {
            if let Some((layer, tensor)) = stored.split_once(&format!("self_attn.{projection}")) {
                (stored, layout) = (format!("{layer}attn.in_proj_{tensor}"), StoredLayout::QkvBlock(block));
            }
        }
        (stored, layout)
    }
}

impl StoredLayout {
    /// Extracts the canonical tensor of this `shape` from the stored values.
    fn to_canonical(self, mut stored: Vec<f32>, shape: &[usize]) -> Vec<f32> {
        match self {
            Self::Identity => stored,
            Self::QkvBlock(idx) => {
                let len = stored.len() / 3;
                stored.drain(idx * len..(idx + 1) * len).collect()
            }
            Self::Transposed => {
                let (n_rows, n_cols) = (shape[0], shape[1]);
                (0..n_rows * n_cols).map(|idx| stored[idx % n_cols * n_rows + idx / n_cols]).collect()
            }
        }
    }
}
