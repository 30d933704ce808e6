//! Evaluation protocols: what a policy sees and reads, and when an episode ends.
//!
//! The benchmark evaluates ACT by one program, and π0.5 and other policies by a second one, a fork of LeRobot
//! (docs/protocols.md).

use std::fmt;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use ipc_types::{ImageSize, ImageSizes};
use serde::{Deserialize, Serialize};

use crate::language_file::LanguageFile;

/// Evaluation program of the benchmark that a run follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum ProtocolName {
    /// ACT's: images of 224x224 and 128x128, the simulator's sentences, episodes up to the horizon
    #[default]
    Act,
    /// The one through LeRobot: images of 640x480, its own sentences, episodes up to the first success
    Lerobot,
}

/// The end of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum EpisodeEnd {
    /// The task's horizon
    #[default]
    Horizon,
    /// The first success, or the horizon
    Success,
}

/// Source of the tasks' instructions, which language perturbations replace.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Instructions {
    /// The simulator's.
    #[default]
    Act,
    /// Those of the evaluation through LeRobot.
    Lerobot,
    /// Those of a file: a YAML mapping from env ids to sentences.
    #[serde(untagged)]
    File(LanguageFile),
}

impl FromStr for Instructions {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.to_ascii_lowercase().as_str() {
            "act" => Ok(Self::Act),
            "lerobot" => Ok(Self::Lerobot),
            _ => text.parse().map(Self::File),
        }
    }
}

/// The user's choice of a protocol.
#[derive(Args, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProtocolOptions {
    /// Evaluation protocol [default: what the checkpoint was trained for, or act]
    #[arg(long, value_enum, ignore_case = true)]
    pub protocol: Option<ProtocolName>,
    /// Size of the camera images in pixels: WxH, or WxH,wrist=WxH [default: the protocol's]
    #[arg(long, value_name = "WxH[,wrist=WxH]")]
    pub image_size: Option<ImageSizes>,
    /// Task instructions: act, lerobot, or a YAML file that maps env ids to sentences [default: the
    /// protocol's]
    #[arg(long, value_name = "act|lerobot|FILE")]
    pub instructions: Option<Instructions>,
    /// End of an episode [default: the protocol's]
    #[arg(long, value_enum, ignore_case = true)]
    pub end: Option<EpisodeEnd>,
}

/// A protocol in all its parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Protocol {
    /// Program that it follows, except for the parts that the user changed.
    pub protocol: ProtocolName,
    /// Sizes of the camera images.
    pub image_size: ImageSizes,
    /// Source of the tasks' instructions.
    pub instructions: Instructions,
    /// End of an episode.
    pub end: EpisodeEnd,
}

impl ProtocolName {
    /// Returns the name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Act => "act",
            Self::Lerobot => "lerobot",
        }
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { protocol, image_size, instructions, end } = self;
        let source = match instructions {
            Instructions::Act => ProtocolName::Act.name().to_owned(),
            Instructions::Lerobot => ProtocolName::Lerobot.name().to_owned(),
            Instructions::File(file) => file.path().display().to_string(),
        };
        let end = match end {
            EpisodeEnd::Horizon => "at the horizon",
            EpisodeEnd::Success => "at the first success or the horizon",
        };
        let name = protocol.name();
        write!(f, "protocol {name}: {image_size} images, {source} instructions, episodes end {end}")
    }
}

impl From<ProtocolName> for Protocol {
    fn from(protocol: ProtocolName) -> Self {
        let image_size = ImageSize { width: 640, height: 480 };
        match protocol {
            ProtocolName::Act => Self::default(),
            ProtocolName::Lerobot => Self {
                protocol,
                image_size: ImageSizes { external: image_size, hand: image_size },
                instructions: Instructions::Lerobot,
                end: EpisodeEnd::Success,
            },
        }
    }
}

impl From<Protocol> for ProtocolOptions {
    fn from(Protocol { protocol, image_size, instructions, end }: Protocol) -> Self {
        Self {
            protocol: Some(protocol),
            image_size: Some(image_size),
            instructions: Some(instructions),
            end: Some(end),
        }
    }
}

impl ProtocolOptions {
    /// Returns the protocol with the user's changes. `preferred` is the one of the policies' checkpoints.
    #[must_use]
    pub fn resolve(&self, preferred: Option<ProtocolName>) -> Protocol {
        let Protocol { protocol, image_size, instructions, end } =
            self.protocol.or(preferred).unwrap_or_default().into();
        Protocol {
            protocol,
            image_size: self.image_size.unwrap_or(image_size),
            instructions: self.instructions.clone().unwrap_or(instructions),
            end: self.end.unwrap_or(end),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_protocol_can_be_changed() {
        let given = ProtocolOptions { end: Some(EpisodeEnd::Horizon), ..ProtocolOptions::default() };
        let resolved = given.resolve(Some(ProtocolName::Lerobot));
        let expected = Protocol { end: EpisodeEnd::Horizon, ..ProtocolName::Lerobot.into() };
        assert_eq!(resolved, expected);
        let given = ProtocolOptions { protocol: Some(ProtocolName::Act), ..ProtocolOptions::default() };
        assert_eq!(given.resolve(Some(ProtocolName::Lerobot)), Protocol::default());
    }

    #[test]
    fn protocols_survive_json() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let file: LanguageFile = file.path().to_str().unwrap().parse().unwrap();
        let own = Protocol { instructions: Instructions::File(file), ..Protocol::default() };
        for protocol in [Protocol::default(), ProtocolName::Lerobot.into(), own] {
            let text = serde_json::to_string(&protocol).unwrap();
            assert_eq!(serde_json::from_str::<Protocol>(&text).unwrap(), protocol, "{text}");
        }
        assert_eq!(serde_json::from_str::<Protocol>("{}").unwrap(), Protocol::default());
    }
}
