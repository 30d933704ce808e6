//! LeRobot's configuration of a π0.5 checkpoint.

use std::fmt;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::{ACTION, CheckpointError, Folder, Pi05Description};
use crate::checkpoint::lerobot::FeatureShape;
use crate::checkpoint::mapping::{FeatureKind, InputFeature};
use crate::checkpoint::processor::pi05_scaling;
use crate::spec::MAX_STEPS;

/// Upper bound on the rows of a chunk and on the entries of a state.
pub(super) const MAX_ROWS: usize = 1024;
/// Upper bound on the tokens of a prompt.
const MAX_PROMPT: usize = 4096;

/// The keys of LeRobot's `config.json` that inference depends on. All others are ignored.
#[derive(Debug, Deserialize)]
#[serde(default)]
pub(super) struct Pi05Config {
    input_features: Features,
    output_features: Features,
    n_obs_steps: usize,
    chunk_size: usize,
    pub(super) max_state_dim: usize,
    max_action_dim: usize,
    pub(super) num_inference_steps: usize,
    pub(super) min_period: f64,
    pub(super) max_period: f64,
    image_resolution: (usize, usize),
    pub(super) tokenizer_max_length: usize,
    use_relative_actions: bool,
}

/// Features in the order of the file, which is the order of the cameras in the prefix.
#[derive(Debug, Default)]
struct Features(Vec<(String, FeatureShape)>);

impl Default for Pi05Config {
    fn default() -> Self {
        Self {
            input_features: Features::default(),
            output_features: Features::default(),
            n_obs_steps: 1,
            chunk_size: 50,
            max_state_dim: 32,
            max_action_dim: 32,
            num_inference_steps: 10,
            min_period: 4e-3,
            max_period: 4.0,
            image_resolution: (224, 224),
            tokenizer_max_length: 200,
            use_relative_actions: false,
        }
    }
}

impl<'de> Deserialize<'de> for Features {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Features;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a map of features")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Features, A::Error> {
                let mut features = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    features.push(entry);
                }
                Ok(Features(features))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

impl Pi05Config {
    /// Returns the first option that is not supported or out of range, as key, actual and expected value.
    fn unsupported(&self) -> Option<(&'static str, String, String)> {
        let counts = [
            ("chunk_size", self.chunk_size, MAX_ROWS),
            ("max_state_dim", self.max_state_dim, MAX_ROWS),
            ("num_inference_steps", self.num_inference_steps, MAX_STEPS as usize),
            ("tokenizer_max_length", self.tokenizer_max_length, MAX_PROMPT),
        ];
        let outside = counts.into_iter().find(|(_, found, limit)| !(1..=*limit).contains(found));
        if let Some((key, found, limit)) = outside {
            return Some((key, found.to_string(), format!("1 to {limit}")));
        }
        let (min, max) = (self.min_period, self.max_period);
        if !(min > 0.0 && max >= min && max.is_finite()) {
            let expected = "positive numbers, the shorter one first".to_owned();
            return Some(("min_period, max_period", format!("{min}, {max}"), expected));
        }
        if self.n_obs_steps != 1 {
            return Some(("n_obs_steps", self.n_obs_steps.to_string(), "1".to_owned()));
        }
        let relative = ("use_relative_actions", "true".to_owned(), "false".to_owned());
        self.use_relative_actions.then_some(relative)
    }
}

impl Folder<'_> {
    pub(super) fn lerobot(&self, config: Pi05Config) -> Result<Pi05Description, CheckpointError> {
        if let Some((key, found, expected)) = config.unsupported() {
            return Err(self.value(key, found, expected));
        }
        let architecture = self.architecture(config.chunk_size)?;
        let side = architecture.image_side();
        if config.image_resolution != (side, side) {
            let found = format!("{:?}", config.image_resolution);
            return Err(self.value(
                "image_resolution",
                found,
                format!("({side}, {side}), as in the weights"),
            ));
        }
        let width = architecture.action_width;
        if config.max_action_dim != width {
            return Err(self.value(
                "max_action_dim",
                config.max_action_dim,
                format!("{width}, as in the weights"),
            ));
        }
        let action = config.output_features.0.iter().find(|(name, _)| name == ACTION);
        let action_dim = match action.map(|(_, feature)| &feature.shape[..]) {
            Some(&[dim]) if (1..=width).contains(&dim) => dim,
            found => {
                let expected = format!("a shape [dim] of at most {width}");
                return Err(self.value("output_features.action", format!("{found:?}"), expected));
            }
        };
        let features = self.features(config.input_features, config.max_state_dim)?;
        let state = features.iter().find(|feature| feature.kind == FeatureKind::State);
        let Some((state, state_dim)) = state.map(|state| (state.name.clone(), state.shape[0])) else {
            return Err(self.value("input_features", "no state", "a feature of type STATE"));
        };
        let mapping = self.mapping(features, action_dim)?;
        let (state, action) = pi05_scaling(self.folder, (&state, state_dim), (ACTION, action_dim))?;
        Ok(Pi05Description {
            architecture,
            mapping,
            state,
            action,
            action_dim,
            prompt_state: self.sidecar.prompt_state,
            max_state_dim: config.max_state_dim,
            max_tokens: config.tokenizer_max_length,
            n_steps: config.num_inference_steps,
            periods: (config.min_period, config.max_period),
        })
    }

    /// Returns the input features in their order.
    fn features(&self, inputs: Features, max_state_dim: usize) -> Result<Vec<InputFeature>, CheckpointError> {
        let mut features = Vec::new();
        for (name, FeatureShape { kind, shape }) in inputs.0 {
            let fits = match kind {
                FeatureKind::Visual => matches!(shape[..], [3, _, _]),
                FeatureKind::State => matches!(shape[..], [dim] if dim <= max_state_dim),
                FeatureKind::Env | FeatureKind::Action => false,
            };
            if !fits {
                let expected =
                    format!("an image [3, height, width], or a state of at most {max_state_dim} entries");
                return Err(self.value(
                    &format!("input_features.{name}"),
                    format!("{kind:?} {shape:?}"),
                    expected,
                ));
            }
            features.push(InputFeature { name, shape, kind });
        }
        Ok(features)
    }
}
