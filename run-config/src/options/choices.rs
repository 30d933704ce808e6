//! Options with a fixed set of values. The doc comments of variants are help texts.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// The reading of the benchmark where its released code contradicts its evident intent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum Profile {
    /// The evident intent
    #[default]
    Strict,
    /// The behaviour of the released code
    Paper,
}

impl Profile {
    /// Both profiles, the default first.
    pub const ALL: [Self; 2] = [Self::Strict, Self::Paper];
}

/// The use of predicted action chunks. Results of different modes are never mixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum QueryMode {
    /// Execute several rows of each chunk open loop
    Chunk,
    /// Query at every control step and execute the mean of all predictions for it
    Ensemble,
}

/// The renderer to open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum RendererChoice {
    /// A GPU if one is usable, otherwise the CPU
    #[default]
    Auto,
    /// The CPU rasteriser
    Cpu,
    /// A GPU, through Vulkan
    Gpu,
    /// The GPU renderer on a software Vulkan driver, for tests
    Software,
}

/// The device on which policies compute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum DeviceChoice {
    /// A GPU if one is usable and the policy supports it, otherwise the CPU
    #[default]
    Auto,
    /// The CPU
    Cpu,
    /// A GPU, through Vulkan: for ACT and π0.5
    Gpu,
    /// The GPU kernels on a software Vulkan driver, for tests
    Software,
}

/// The number of samples per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
pub enum Samples {
    /// The pixel centre only: jagged edges, as in the benchmark
    #[default]
    #[serde(rename = "1")]
    #[value(name = "1")]
    One,
    /// Four positions: smooth edges
    #[serde(rename = "4")]
    #[value(name = "4")]
    Four,
}
