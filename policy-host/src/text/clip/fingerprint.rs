//! Fingerprint of a text tower's weights, as text of 16 hexadecimal digits in configurations.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Identity of a text tower's weights: xxh3-64 over all tensors, each as its name, a zero byte and its values
/// as little-endian f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct WeightsFingerprint(pub u64);

impl fmt::Display for WeightsFingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl From<WeightsFingerprint> for String {
    fn from(fingerprint: WeightsFingerprint) -> Self {
        fingerprint.to_string()
    }
}

impl TryFrom<String> for WeightsFingerprint {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = text.len() == 16 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
        let number = u64::from_str_radix(&text, 16).ok().filter(|_| digits);
        number.map(Self).ok_or_else(|| format!("fingerprint `{text}`, expected 16 hexadecimal digits"))
    }
}
