//! Serde adapter for control modes under ManiSkill's names.

use ipc_types::ControlMode;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

#[expect(clippy::trivially_copy_pass_by_ref, reason = "signature required by serde")]
pub(crate) fn serialize<S: Serializer>(mode: &ControlMode, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(mode.name())
}

pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<ControlMode, D::Error> {
    let name = String::deserialize(deserializer)?;
    ControlMode::ALL.into_iter().find(|mode| mode.name() == name).ok_or_else(|| {
        let known = ControlMode::ALL.map(ControlMode::name).join(", ");
        D::Error::custom(format!("unknown control_mode `{name}`, expected one of {known}"))
    })
}

/// Deserializes an optional control mode from ManiSkill's name.
pub(crate) fn deserialize_optional<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<ControlMode>, D::Error> {
    deserialize(deserializer).map(Some)
}
