//! Mapping from the robot's observation to the input features of a checkpoint, taken from a file in the
//! checkpoint folder or inferred from the features' names and shapes.
//!
//! The file is `hypogeum.json`, with every key optional:
//!
//! ```json
//! {
//!   "morphology": "single",
//!   "control_mode": "pd_ee_delta_pose",
//!   "protocol": "act",
//!   "mapping": {
//!     "observation.images.front": "external1_camera",
//!     "observation.state": ["qpos", "tcp_pose"],
//!     "observation.environment_state": "language"
//!   },
//!   "language": {"encoder": "hashed", "dim": 512}
//! }
//! ```
//!
//! A part of the state may be followed by a slice, for example `qpos[0:8]`. `ignore` lists unknown settings
//! of the checkpoint that the user accepts to be ignored.
//!
//! A π0.5 checkpoint has further keys: `vision_heads`; `prompt_state`, which is `unpadded` or `padded`; and,
//! in openpi's format, `chunk_size`. Its cameras may be mapped to `none`.
//!
//! Without it, `observation.images.X`, or the name that the checkpoint's preprocessor renames to it, maps to
//! the camera `X` or `X_camera`; `observation.state` maps to the full state, to `qpos`, or to `qpos` and
//! `qvel`, whichever has its dimension; robot and control mode follow from the dimension of an action.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use ipc_types::{ControlMode, ImageSize, ImageSizes, Morphology, ObservationView};
use run_config::{Protocol, ProtocolName, input};
use serde::Deserialize;

use super::error::CheckpointError;
pub use super::files::MAPPING_FILE;
use super::lerobot::feature::{FeatureKind, InputFeature};
use super::settings::{IgnoreList, parse};
use crate::policy::PolicyError;
use crate::text::LanguageConfig;

/// Name of the instruction embedding in a mapping.
const LANGUAGE: &str = "language";
/// Source of a π0.5 camera that the robot does not have.
pub(crate) const NO_CAMERA: &str = "none";

/// The mapping from a robot's observation to a network's input, and the meaning of its actions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObservationMapping {
    /// Robot that the network controls.
    pub morphology: Morphology,
    /// Control mode of the network's actions.
    pub control_mode: ControlMode,
    /// Index of the robot's camera for each camera of the network.
    pub cameras: Vec<usize>,
    /// Ranges of the robot's state vector whose concatenation is the network's state input.
    pub state: Vec<Range<usize>>,
    /// Size of each camera's images in training; empty if the checkpoint does not state it.
    pub trained_sizes: Vec<ImageSize>,
    /// Evaluation protocol that the mapping file names, or whose images all cameras had in training.
    pub protocol: Option<ProtocolName>,
}

/// Contents of the mapping file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Sidecar {
    pub(crate) morphology: Option<Morphology>,
    pub(crate) control_mode: Option<ControlMode>,
    pub(crate) protocol: Option<ProtocolName>,
    pub(crate) mapping: BTreeMap<String, FeatureSource>,
    pub(crate) language: Option<LanguageConfig>,
    /// π0.5: heads of the vision tower, if they are not SigLIP So400m's.
    pub(crate) vision_heads: Option<usize>,
    /// π0.5: state numbers in the prompt.
    pub(crate) prompt_state: Option<PromptState>,
    /// π0.5 in openpi's format: rows of an action chunk.
    pub(crate) chunk_size: Option<usize>,
    /// Unknown settings that are ignored.
    #[serde(deserialize_with = "ignore_list")]
    pub(crate) ignore: IgnoreList,
}

fn ignore_list<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<IgnoreList, D::Error> {
    Vec::deserialize(deserializer).map(IgnoreList::new)
}

/// State numbers in the prompt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PromptState {
    /// One number per entry of the robot's state, as in LeRobot 0.5 and later.
    #[default]
    Unpadded,
    /// One number per entry of the network's state, which is padded with zeros to `max_state_dim`, as in
    /// LeRobot before 0.5, which also scaled the letterbox padding of images twice.
    Padded,
}

/// Source of a feature: a camera, `language`, or parts of the state.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum FeatureSource {
    One(String),
    Parts(Vec<String>),
}

impl Sidecar {
    /// Reads the mapping file in `folder`, or returns the default if there is none.
    pub(crate) fn read(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(MAPPING_FILE);
        match input::read(&path) {
            Ok(text) => parse(&path, &text),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(source) => Err(CheckpointError::Read { path, source }),
        }
    }
}

impl Sidecar {
    /// Refuses the keys that only π0.5 has.
    pub(crate) fn refuse_pi05_keys(&self, folder: &Path) -> Result<(), CheckpointError> {
        let keys = [
            ("vision_heads", self.vision_heads.is_some()),
            ("prompt_state", self.prompt_state.is_some()),
            ("chunk_size", self.chunk_size.is_some()),
        ];
        keys.into_iter().try_for_each(|(key, is_set)| refuse_if(is_set, folder, key, "π0.5 only"))
    }

    /// Returns `true` if a camera of the network has no counterpart and is left out of its input.
    pub(crate) fn leaves_out(&self, input: &InputFeature) -> bool {
        let own = input.name.strip_prefix("observation.images.").unwrap_or(&input.name);
        match self.mapping.get(&input.name) {
            Some(FeatureSource::One(name)) => name == NO_CAMERA,
            Some(FeatureSource::Parts(_)) => false,
            // LeRobot's own name for cameras that a configuration adds.
            None => own.starts_with("empty_camera_"),
        }
    }
}

impl Sidecar {
    /// Returns the width of parts of the state of a robot, or `None` if one of them is unknown.
    pub(crate) fn width_of(&self, source: &FeatureSource) -> Option<usize> {
        let parts = self.morphology?.state_parts();
        source.names().iter().map(|part| state_range(part, parts).ok().map(|range| range.len())).sum()
    }
}

/// Refuses a key of the mapping file that would have no effect.
pub(crate) fn refuse_if(
    is_set: bool,
    folder: &Path,
    key: &str,
    applies_to: &str,
) -> Result<(), CheckpointError> {
    if !is_set {
        return Ok(());
    }
    Err(CheckpointError::Value {
        path: folder.join(MAPPING_FILE),
        key: key.to_owned(),
        found: "set".to_owned(),
        expected: format!("no such key: it applies to {applies_to}"),
    })
}

impl FeatureSource {
    fn names(&self) -> &[String] {
        match self {
            Self::One(name) => std::slice::from_ref(name),
            Self::Parts(names) => names,
        }
    }
}

/// Maps the robot's observation to `inputs` (cameras in the network's order), for actions of dimension
/// `action_dim`.
///
/// # Errors
/// The first feature that cannot be mapped, with a list of both sides.
pub(crate) fn map_features(
    inputs: &[InputFeature],
    action_dim: usize,
    sidecar: &Sidecar,
) -> Result<ObservationMapping, String> {
    let (morphology, control_mode) = robot(action_dim, sidecar)?;
    let with_both_sides = |problem: String| format!("{problem}; {}", both_sides(inputs, morphology));
    let known = |name: &String| inputs.iter().any(|input| input.name == *name);
    let is_left_out = |source: &FeatureSource| source.names() == [NO_CAMERA];
    let unknown = sidecar.mapping.iter().find(|(name, source)| !known(name) && !is_left_out(source));
    if let Some((name, _)) = unknown {
        return Err(with_both_sides(format!("{MAPPING_FILE} maps `{name}`, which is not an input")));
    }
    let mut mapping = ObservationMapping {
        morphology,
        control_mode,
        cameras: Vec::new(),
        state: Vec::new(),
        trained_sizes: inputs.iter().filter_map(InputFeature::image_size).collect(),
        protocol: None,
    };
    mapping.protocol = sidecar.protocol.or_else(|| protocol_of(&mapping.trained_sizes));
    for input in inputs {
        let source = sidecar.mapping.get(&input.name);
        let mapped = match input.kind {
            FeatureKind::Visual => {
                camera(input, source, morphology).map(|camera| mapping.cameras.push(camera))
            }
            FeatureKind::State => state(input, source, morphology).map(|parts| mapping.state = parts),
            FeatureKind::Env => language(input, source, sidecar.language.as_ref()),
            FeatureKind::Action => Err(format!("`{}` is an action, not an input", input.name)),
        };
        mapped.map_err(with_both_sides)?;
    }
    Ok(mapping)
}

/// Returns the protocol all of whose images have these sizes, if that can only be one of them.
fn protocol_of(sizes: &[ImageSize]) -> Option<ProtocolName> {
    let lerobot = Protocol::from(ProtocolName::Lerobot).image_size.external;
    let is_lerobot = !sizes.is_empty() && sizes.iter().all(|size| *size == lerobot);
    is_lerobot.then_some(ProtocolName::Lerobot)
}

fn robot(action_dim: usize, sidecar: &Sidecar) -> Result<(Morphology, ControlMode), String> {
    let all = Morphology::ALL.into_iter().flat_map(|robot| ControlMode::ALL.map(|mode| (robot, mode)));
    // Absolute and delta poses have the same dimension. Delta, which the benchmark trains on, comes first in
    // the list; absolute must be requested explicitly.
    let matches = |&(robot, mode): &(Morphology, ControlMode)| {
        mode.action_dim(robot) == action_dim
            && sidecar.morphology.is_none_or(|required| required == robot)
            && sidecar.control_mode.is_none_or(|required| required == mode)
    };
    all.clone().find(matches).ok_or_else(|| {
        let known: Vec<String> = all
            .map(|(robot, mode)| format!("{} {} {}", robot.name(), mode.name(), mode.action_dim(robot)))
            .collect();
        format!("actions have {action_dim} entries, expected one of: {}", known.join(", "))
    })
}

fn camera(
    input: &InputFeature,
    source: Option<&FeatureSource>,
    morphology: Morphology,
) -> Result<usize, String> {
    if !matches!(input.shape[..], [3, _, _]) {
        return Err(format!("`{}` is {:?}, expected [3, height, width]", input.name, input.shape));
    }
    let names = morphology.camera_names();
    let position = |name: &str| {
        names.iter().position(|camera| *camera == name || camera.strip_suffix("_camera") == Some(name))
    };
    match source {
        None => {
            let own = input.source.strip_prefix("observation.images.").unwrap_or(&input.source);
            position(own).ok_or_else(|| match input.source == input.name {
                true => format!("no camera matches `{}`", input.name),
                false => format!(
                    "no camera matches `{}`, which the preprocessor's `rename_map` renames to `{}`",
                    input.source, input.name
                ),
            })
        }
        Some(FeatureSource::One(name)) => position(name)
            .ok_or_else(|| format!("`{}` is mapped to `{name}`, which is not a camera", input.name)),
        Some(FeatureSource::Parts(_)) => {
            Err(format!("`{}` is mapped to a list, expected a single camera", input.name))
        }
    }
}

fn state(
    input: &InputFeature,
    source: Option<&FeatureSource>,
    morphology: Morphology,
) -> Result<Vec<Range<usize>>, String> {
    let [dim] = input.shape[..] else {
        return Err(format!("`{}` is {:?}, expected [dim]", input.name, input.shape));
    };
    let parts = morphology.state_parts();
    let range = |part: &str| {
        state_range(part, parts)
            .map_err(|problem| format!("`{}` is mapped to `{part}`, {problem}", input.name))
    };
    let ranges = match source {
        Some(source) => source.names().iter().map(|name| range(name)).collect::<Result<Vec<_>, _>>()?,
        None => {
            let leading = [parts.len(), 1, 2].map(|n| 0..parts[..n].iter().map(|(_, width)| width).sum());
            leading.into_iter().filter(|range| range.len() == dim).take(1).collect()
        }
    };
    let found: usize = ranges.iter().map(Range::len).sum();
    if found == dim {
        Ok(ranges)
    } else if source.is_some() {
        Err(format!("`{}` has {dim} entries, its mapping has {found}", input.name))
    } else {
        Err(format!("`{}` has {dim} entries and no mapping", input.name))
    }
}

/// Returns the entries of the state that a part such as `qpos[0:8]` names, or what is wrong with it.
fn state_range(part: &str, parts: &[(&str, usize)]) -> Result<Range<usize>, String> {
    let (name, slice) = match part.split_once('[') {
        Some((name, rest)) => (name, rest.strip_suffix(']').and_then(|slice| slice.split_once(':'))),
        None => (part, Some(("0", ""))),
    };
    let mut first = 0;
    for (known, width) in parts {
        if *known == name {
            let bound =
                |text: &str| if text.is_empty() && name == part { Some(*width) } else { text.parse().ok() };
            let bounds = slice.and_then(|(start, stop)| Some((bound(start)?, bound(stop)?)));
            return match bounds {
                Some((start, stop)) if start < stop && stop <= *width => Ok(first + start..first + stop),
                _ => Err(format!("which is no slice of its {width} entries, such as `{name}[0:{width}]`")),
            };
        }
        first += width;
    }
    Err("which is not part of the state".to_owned())
}

fn language(
    input: &InputFeature,
    source: Option<&FeatureSource>,
    language: Option<&LanguageConfig>,
) -> Result<(), String> {
    let is_language = |source: &FeatureSource| matches!(source, FeatureSource::One(name) if name == LANGUAGE);
    let name = &input.name;
    if source.is_some_and(|source| !is_language(source)) {
        return Err(format!("`{name}` can only be mapped to `{LANGUAGE}`"));
    }
    let Some(language) = language else {
        return Err(format!(
            "`{name}` must be the instruction embedding, but no `language` encoder is given"
        ));
    };
    if input.shape == [language.dim()] {
        Ok(())
    } else {
        Err(format!("`{name}` is {:?}, the language encoder produces [{}]", input.shape, language.dim()))
    }
}

fn both_sides(inputs: &[InputFeature], morphology: Morphology) -> String {
    let inputs: Vec<String> =
        inputs.iter().map(|input| format!("{} {:?}", input.name, input.shape)).collect();
    let parts: Vec<String> =
        morphology.state_parts().iter().map(|(name, width)| format!("{name} {width}")).collect();
    format!(
        "the checkpoint expects {}; a {} robot has the cameras {}, the state {} and `{LANGUAGE}`. Map them in \
         {MAPPING_FILE} in the checkpoint folder",
        inputs.join(", "),
        morphology.name(),
        morphology.camera_names().join(", "),
        parts.join(", ")
    )
}

impl ObservationMapping {
    /// Returns a sentence about the cameras whose training images had a different aspect ratio from the
    /// `given` ones, or more pixels. Larger images of the same aspect ratio are reduced to the size of
    /// training.
    #[must_use]
    pub fn image_differences(&self, given: ImageSizes) -> Option<String> {
        let names = self.morphology.camera_names();
        let differs = self.cameras.iter().zip(&self.trained_sizes).filter_map(|(camera, trained)| {
            let given = given.of_camera(self.morphology, *camera);
            let is_stretched = given.width * trained.height != given.height * trained.width;
            (is_stretched || given.width < trained.width)
                .then(|| format!("{} {given} instead of {trained}", names[*camera]))
        });
        let differs: Vec<_> = differs.collect();
        (!differs.is_empty()).then(|| {
            format!(
                "resizes images that differ from those of training: {}; choose others with --image-size or --protocol",
                differs.join(", ")
            )
        })
    }

    /// Checks that an observation has what the network needs.
    ///
    /// # Errors
    /// The first thing that is missing or differs.
    pub(crate) fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let Self { morphology, control_mode, cameras, .. } = self;
        if !cameras.is_empty() && observation.image_sizes().is_none() {
            return Err(PolicyError::NoImages);
        }
        if observation.control_mode() != *control_mode {
            let (expected, found) = (control_mode.name(), observation.control_mode().name());
            return Err(PolicyError::ControlMode { expected, found });
        }
        (0..observation.n_envs()).try_for_each(|env_idx| {
            let (expected, found) = (morphology.state_dim(), observation.env(env_idx).state.len());
            if expected == found { Ok(()) } else { Err(PolicyError::StateDim { env_idx, expected, found }) }
        })
    }

    /// Writes the network's state input `[state_dim]` from the robot's state vector.
    pub(crate) fn gather_state(&self, state: &[f32], mut out: &mut [f32]) {
        for part in &self.state {
            let (own, others) = out.split_at_mut(part.len());
            own.copy_from_slice(&state[part.clone()]);
            out = others;
        }
    }
}
