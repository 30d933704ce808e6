//! Paints: the appearances of distractor objects as their recipes write them.

use serde::Deserialize;

use crate::{AppearanceSpec, Texture, srgb};

/// Specular strength of a textured paint without a finish.
const TEXTURED_SPECULAR: f64 = 0.2;

/// Returns the specular strength of a finish.
fn finish(word: &str) -> Option<f64> {
    Some(match word {
        "plain" => 0.0,
        "matt" => 0.05,
        "peel" => 0.4,
        "glossy" => 0.5,
        "satin" => 0.6,
        "polished" => 0.8,
        _ => return None,
    })
}

fn texture(word: &str) -> Option<Texture> {
    Texture::ALL.iter().copied().find(|texture| format!("{texture:?}") == word)
}

/// Returns the linear colour of `rrggbb`.
fn color(hex: &str) -> Option<[f64; 3]> {
    let [_, channels @ ..] = u32::from_str_radix(hex, 16).ok().filter(|_| hex.len() == 6)?.to_be_bytes();
    Some(srgb(channels))
}

/// A colour `#rrggbb` (sRGB) or the name of another paint, after an optional finish and an optional texture:
/// `#ba1c20`, `glossy main`, `polished BrushedMetal #c7c9cf`.
#[derive(Deserialize)]
#[serde(try_from = "String")]
pub(crate) struct Paint {
    base: Base,
    texture: Option<Texture>,
    specular: Option<f64>,
}

enum Base {
    Color([f64; 3]),
    Named(String),
}

impl TryFrom<String> for Paint {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let (modifiers, base) = text.rsplit_once(' ').unwrap_or(("", &text));
        let base = match base.strip_prefix('#') {
            Some(hex) => Base::Color(color(hex).ok_or_else(|| format!("`{base}` is not #rrggbb"))?),
            None => Base::Named(base.into()),
        };
        let mut paint = Self { base, texture: None, specular: None };
        for word in modifiers.split_whitespace() {
            match (finish(word), texture(word)) {
                (None, None) => {
                    return Err(format!("`{word}` in `{text}` is neither a finish nor a texture"));
                }
                (None, texture) => paint.texture = texture,
                (specular, _) => paint.specular = specular,
            }
        }
        Ok(paint)
    }
}

impl Paint {
    /// Returns the appearance, given those of named paints.
    pub(crate) fn appearance(&self, named: impl FnOnce(&str) -> AppearanceSpec) -> AppearanceSpec {
        let mut appearance = match &self.base {
            Base::Color(color) => AppearanceSpec::plain(*color),
            Base::Named(name) => named(name),
        };
        if self.texture.is_some() {
            (appearance.texture, appearance.specular) = (self.texture, TEXTURED_SPECULAR);
        }
        appearance.specular = self.specular.unwrap_or(appearance.specular);
        appearance
    }
}
