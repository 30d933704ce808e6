//! File names in a checkpoint folder, beside those of the configuration and the weights.

/// File name of the mapping in a checkpoint folder.
pub const MAPPING_FILE: &str = "hypogeum.json";
/// File name of the preprocessor, written since LeRobot 0.4.
pub(crate) const PREPROCESSOR: &str = "policy_preprocessor.json";
/// File name of the postprocessor, written since LeRobot 0.4.
pub(crate) const POSTPROCESSOR: &str = "policy_postprocessor.json";
