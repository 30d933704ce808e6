//! The tensors of CLIP's text tower: their names in Hugging Face's and in OpenAI's files, their shapes, and the
//! fingerprint over all of them.
//!
//! Hugging Face's names, order of axes and separate projections are the canonical ones. OpenAI keeps queries, keys and
//! values of a layer in one tensor and the last projection transposed.

use std::path::Path;

use xxhash_rust::xxh3::Xxh3;

use super::Fingerprint;
use super::tokens::{MAX_TOKENS, VOCABULARY};
use crate::act::tensors::TensorSpec;
use crate::checkpoint::file::TensorFile;
use crate::checkpoint::{CheckpointError, Weights};

/// Width of a head.
pub(super) const HEAD_WIDTH: usize = 64;
/// Most layers of a tower.
const MAX_LAYERS: usize = 64;

/// Canonical names.
pub(super) const TOKENS: &str = "text_model.embeddings.token_embedding.weight";
pub(super) const POSITIONS: &str = "text_model.embeddings.position_embedding.weight";
pub(super) const LAYERS: &str = "text_model.encoder.layers";
pub(super) const FINAL_NORM: &str = "text_model.final_layer_norm";
pub(super) const PROJECTION: &str = "text_projection.weight";

/// Size of a tower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TowerShape {
    /// Layers.
    pub n_layers: usize,
    /// Width of a token, in heads of 64.
    pub width: usize,
    /// Width of an embedding.
    pub dim: usize,
}

/// How a file names its tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Naming {
    HuggingFace,
    OpenAi,
}

/// What a canonical tensor is of a stored one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Whole,
    /// One of three equal blocks of rows.
    Third(usize),
    Transposed,
}

/// A weights file whose tensors have been checked by name and shape.
#[derive(Debug)]
pub(super) struct TowerFile {
    file: TensorFile,
    naming: Naming,
    shape: TowerShape,
}

impl TowerFile {
    /// Reads the header and checks it. Tensors of other names are ignored: the file may hold CLIP's images' half, too.
    pub(super) fn open(path: &Path) -> Result<Self, CheckpointError> {
        let file = TensorFile::open(path)?;
        let naming =
            if file.has(&Naming::OpenAi.stored(TOKENS).0) { Naming::OpenAi } else { Naming::HuggingFace };
        let shape = naming.tower_shape(&file)?;
        let tower = Self { file, naming, shape };
        for spec in shape.tensors() {
            let (stored, shape, _) = tower.place(&spec);
            tower.file.check(&stored, &shape)?;
        }
        Ok(tower)
    }

    pub(super) fn shape(&self) -> TowerShape {
        self.shape
    }

    /// Checks that embeddings are `dim` wide.
    pub(super) fn check_dim(&self, dim: usize) -> Result<(), CheckpointError> {
        let expected = TensorSpec { name: PROJECTION.to_owned(), shape: vec![dim, self.shape.width] };
        let (stored, shape, _) = self.place(&expected);
        self.file.check(&stored, &shape)
    }

    /// Reads all tensors, by their canonical names, and says which they are.
    pub(super) fn read(mut self) -> Result<(Weights, Fingerprint), CheckpointError> {
        let (mut weights, mut hash) = (Weights::default(), Xxh3::new());
        for spec in self.shape.tensors() {
            let (stored, _, part) = self.place(&spec);
            let numbers = part.of(self.file.read(&stored)?, &spec.shape);
            hash.update(spec.name.as_bytes());
            hash.update(&[0]);
            for block in numbers.chunks(1 << 14) {
                hash.update(&block.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>());
            }
            weights.insert(spec.name, numbers);
        }
        Ok((weights, Fingerprint(hash.digest())))
    }

    /// Where a canonical tensor is: name and shape as stored, and which part of that it is.
    fn place(&self, spec: &TensorSpec) -> (String, Vec<usize>, Part) {
        let (name, part) = self.naming.stored(&spec.name);
        let mut shape = spec.shape.clone();
        match part {
            Part::Whole => {}
            Part::Third(_) => shape[0] *= 3,
            Part::Transposed => shape.reverse(),
        }
        (name, shape, part)
    }
}

impl TowerShape {
    /// The canonical tensors, in the order of the fingerprint.
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

impl Naming {
    /// The size that a file's tensors have.
    fn tower_shape(self, file: &TensorFile) -> Result<TowerShape, CheckpointError> {
        let width = match self.axes(file, TOKENS)?[..] {
            [VOCABULARY, width] if width > 0 && width % HEAD_WIDTH == 0 => width,
            _ => {
                return Err(self.unfit(
                    file,
                    TOKENS,
                    format!("F32 [{VOCABULARY}, a multiple of {HEAD_WIDTH}]"),
                ));
            }
        };
        let dim = match (self, &self.axes(file, PROJECTION)?[..]) {
            (Self::HuggingFace, &[dim, _]) | (Self::OpenAi, &[_, dim]) if dim > 0 => dim,
            _ => return Err(self.unfit(file, PROJECTION, format!("two axes, one of {width}"))),
        };
        let prefix = format!("{}.", self.stored(LAYERS).0);
        let layer_of = |name: &str| name.strip_prefix(&prefix)?.split('.').next()?.parse::<usize>().ok();
        let last = file.names().iter().filter_map(|name| layer_of(name)).max().unwrap_or(0);
        Ok(TowerShape { n_layers: last.saturating_add(1).min(MAX_LAYERS), width, dim })
    }

    fn axes(self, file: &TensorFile, name: &str) -> Result<Vec<usize>, CheckpointError> {
        let stored = self.stored(name).0;
        let missing = || CheckpointError::Missing {
            path: file.path().to_owned(),
            tensor: stored.clone(),
            expected: "the text tower of CLIP ViT-B/32, by Hugging Face's names or OpenAI's".to_owned(),
        };
        file.shape(&stored).map(<[usize]>::to_vec).ok_or_else(missing)
    }

    fn unfit(self, file: &TensorFile, name: &str, expected: String) -> CheckpointError {
        let tensor = self.stored(name).0;
        let found = file.describe(&tensor).unwrap_or_default();
        CheckpointError::Mismatch { path: file.path().to_owned(), tensor, expected, found }
    }

    /// The name under which a canonical tensor is stored, alone or with others.
    fn stored(self, name: &str) -> (String, Part) {
        if self == Self::HuggingFace {
            return (name.to_owned(), Part::Whole);
        }
        match name {
            TOKENS => return ("token_embedding.weight".to_owned(), Part::Whole),
            POSITIONS => return ("positional_embedding".to_owned(), Part::Whole),
            PROJECTION => return ("text_projection".to_owned(), Part::Transposed),
            _ => {}
        }
        if let Some(rest) = name.strip_prefix(FINAL_NORM) {
            return (format!("ln_final{rest}"), Part::Whole);
        }
        let (mut stored, mut part) = (name.replace(LAYERS, "transformer.resblocks"), Part::Whole);
        for (canonical, own) in [
            ("self_attn.out_proj", "attn.out_proj"),
            ("layer_norm", "ln_"),
            ("mlp.fc1", "mlp.c_fc"),
            ("mlp.fc2", "mlp.c_proj"),
        ] {
            stored = stored.replace(canonical, own);
        }
        for (third, own) in ["q_proj.", "k_proj.", "v_proj."].into_iter().enumerate() {
            if let Some((layer, tensor)) = stored.split_once(&format!("self_attn.{own}")) {
                (stored, part) = (format!("{layer}attn.in_proj_{tensor}"), Part::Third(third));
            }
        }
        (stored, part)
    }
}

impl Part {
    /// The canonical tensor of this `shape`.
    fn of(self, mut stored: Vec<f32>, shape: &[usize]) -> Vec<f32> {
        match self {
            Self::Whole => stored,
            Self::Third(idx) => {
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
