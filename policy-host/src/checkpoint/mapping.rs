//! Which of the robot's cameras and numbers a checkpoint's features are: from a small file beside it, or from their names
//! and widths.
//!
//! `hypogeum.json`, every key optional:
//!
//! ```json
//! {
//!   "morphology": "single",
//!   "control_mode": "pd_ee_delta_pose",
//!   "mapping": {
//!     "observation.images.front": "external1_camera",
//!     "observation.state": ["qpos", "tcp_pose"],
//!     "observation.environment_state": "language"
//!   },
//!   "language": {"encoder": "hashed", "dim": 512}
//! }
//! ```
//!
//! Without it, `observation.images.X` is the camera `X` or `X_camera`; `observation.state` is the whole state, `qpos`, or
//! `qpos` and `qvel`, whichever has its width; the robot and its control mode follow from the width of an action.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use ipc_types::{ControlMode, Morphology};
use serde::Deserialize;

use super::{CheckpointError, parse};
use crate::text::LanguageConfig;

/// Name of the file.
pub const MAPPING_FILE: &str = "hypogeum.json";
/// What the instruction's embedding is called in a mapping.
const LANGUAGE: &str = "language";

/// How a robot's observation becomes a network's input, and what its actions mean.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// The robot.
    pub morphology: Morphology,
    /// How action rows are meant.
    pub control_mode: ControlMode,
    /// For each of the network's cameras, the robot's.
    pub cameras: Vec<usize>,
    /// Parts of the robot's state that make up the network's, in order.
    pub state: Vec<Range<usize>>,
}

/// The file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Sidecar {
    pub(super) morphology: Option<Morphology>,
    #[serde(deserialize_with = "super::colosseum::optional_control_mode")]
    pub(super) control_mode: Option<ControlMode>,
    pub(super) mapping: BTreeMap<String, Source>,
    pub(super) language: Option<LanguageConfig>,
}

/// What a feature is made of.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum Source {
    One(String),
    Parts(Vec<String>),
}

/// An input of a checkpoint.
#[derive(Debug)]
pub(super) struct Feature {
    pub(super) name: String,
    pub(super) shape: Vec<usize>,
    pub(super) kind: FeatureKind,
}

/// What an input is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum FeatureKind {
    Visual,
    State,
    Env,
    Action,
}

impl Sidecar {
    /// Reads the file in `folder`; nothing, if there is none.
    pub(super) fn read(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(MAPPING_FILE);
        match std::fs::read(&path) {
            Ok(text) => parse(&path, &text),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(source) => Err(CheckpointError::Read { path, source }),
        }
    }
}

impl Source {
    fn names(&self) -> &[String] {
        match self {
            Self::One(name) => std::slice::from_ref(name),
            Self::Parts(names) => names,
        }
    }
}

/// Wires `inputs` (cameras in the network's order) for actions of `action_dim` numbers.
///
/// # Errors
/// What does not fit, with both sides listed.
pub(super) fn wire(inputs: &[Feature], action_dim: usize, sidecar: &Sidecar) -> Result<Wiring, String> {
    let (morphology, control_mode) = robot(action_dim, sidecar)?;
    let both_sides = |problem: String| format!("{problem}; {}", both_sides(inputs, morphology));
    let known = |name: &String| inputs.iter().any(|input| input.name == *name);
    if let Some(name) = sidecar.mapping.keys().find(|name| !known(name)) {
        return Err(both_sides(format!("{MAPPING_FILE} maps `{name}`, which is no input")));
    }
    let mut wiring = Wiring { morphology, control_mode, cameras: Vec::new(), state: Vec::new() };
    for input in inputs {
        let source = sidecar.mapping.get(&input.name);
        let fits = match input.kind {
            FeatureKind::Visual => {
                camera(input, source, morphology).map(|camera| wiring.cameras.push(camera))
            }
            FeatureKind::State => state(input, source, morphology).map(|parts| wiring.state = parts),
            FeatureKind::Env => language(input, source, sidecar.language.as_ref()),
            FeatureKind::Action => Err(format!("`{}` is an action", input.name)),
        };
        fits.map_err(both_sides)?;
    }
    Ok(wiring)
}

fn robot(action_dim: usize, sidecar: &Sidecar) -> Result<(Morphology, ControlMode), String> {
    let all = Morphology::ALL.into_iter().flat_map(|robot| ControlMode::ALL.map(|mode| (robot, mode)));
    // An absolute pose is as wide as a relative one, which is what the benchmark trains on: it has to be asked for.
    let wanted = |&(robot, mode): &(Morphology, ControlMode)| {
        mode.action_dim(robot) == action_dim
            && sidecar.morphology.is_none_or(|wanted| wanted == robot)
            && sidecar.control_mode.is_none_or(|wanted| wanted == mode)
    };
    all.clone().find(wanted).ok_or_else(|| {
        let known: Vec<String> = all
            .map(|(robot, mode)| format!("{} {} {}", robot.name(), mode.name(), mode.action_dim(robot)))
            .collect();
        format!("its actions have {action_dim} numbers; robots and widths are: {}", known.join(", "))
    })
}

fn camera(input: &Feature, source: Option<&Source>, morphology: Morphology) -> Result<usize, String> {
    if !matches!(input.shape[..], [3, _, _]) {
        return Err(format!("`{}` is {:?}, expected [3, height, width]", input.name, input.shape));
    }
    let names = morphology.camera_names();
    let position = |name: &str| {
        names.iter().position(|camera| *camera == name || camera.strip_suffix("_camera") == Some(name))
    };
    match source {
        None => {
            let own = input.name.strip_prefix("observation.images.").unwrap_or(&input.name);
            position(own).ok_or_else(|| format!("no camera is called as `{}` is", input.name))
        }
        Some(Source::One(name)) => position(name)
            .ok_or_else(|| format!("`{}` is mapped to `{name}`, which is no camera", input.name)),
        Some(Source::Parts(_)) => Err(format!("`{}` is mapped to a list, expected one camera", input.name)),
    }
}

fn state(
    input: &Feature,
    source: Option<&Source>,
    morphology: Morphology,
) -> Result<Vec<Range<usize>>, String> {
    let [width] = input.shape[..] else {
        return Err(format!("`{}` is {:?}, expected [width]", input.name, input.shape));
    };
    let parts = morphology.state_parts();
    let range = |wanted: &str| -> Result<Range<usize>, String> {
        let mut start = 0;
        for (name, width) in parts {
            if *name == wanted {
                return Ok(start..start + width);
            }
            start += width;
        }
        Err(format!("`{}` is mapped to `{wanted}`, which is no part of the state", input.name))
    };
    let ranges = match source {
        Some(source) => source.names().iter().map(|name| range(name)).collect::<Result<Vec<_>, _>>()?,
        None => {
            let leading = [parts.len(), 1, 2].map(|n| 0..parts[..n].iter().map(|(_, width)| width).sum());
            leading.into_iter().filter(|range| range.len() == width).take(1).collect()
        }
    };
    let found: usize = ranges.iter().map(Range::len).sum();
    if found == width {
        Ok(ranges)
    } else if source.is_some() {
        Err(format!("`{}` has {width} numbers, what it is mapped to has {found}", input.name))
    } else {
        Err(format!("`{}` has {width} numbers, and nothing says which", input.name))
    }
}

fn language(
    input: &Feature,
    source: Option<&Source>,
    language: Option<&LanguageConfig>,
) -> Result<(), String> {
    let is_language = |source: &Source| matches!(source, Source::One(name) if name == LANGUAGE);
    let name = &input.name;
    if source.is_some_and(|source| !is_language(source)) {
        return Err(format!("`{name}` can only be mapped to `{LANGUAGE}`"));
    }
    let Some(language) = language else {
        return Err(format!(
            "`{name}` can only be the instruction's embedding, and no `language` encoder is named"
        ));
    };
    if input.shape == [language.dim()] {
        Ok(())
    } else {
        Err(format!("`{name}` is {:?}, the language encoder gives [{}]", input.shape, language.dim()))
    }
}

fn both_sides(inputs: &[Feature], morphology: Morphology) -> String {
    let inputs: Vec<String> =
        inputs.iter().map(|input| format!("{} {:?}", input.name, input.shape)).collect();
    let parts: Vec<String> =
        morphology.state_parts().iter().map(|(name, width)| format!("{name} {width}")).collect();
    format!(
        "the checkpoint sees {}; a {} robot has cameras {}, state {}, and `{LANGUAGE}`: map them in {MAPPING_FILE} beside \
         it",
        inputs.join(", "),
        morphology.name(),
        morphology.camera_names().join(", "),
        parts.join(", ")
    )
}
