//! The kinds of distractor objects, read from the embedded files.

use std::sync::LazyLock;

use super::distractor::Distractor;
use super::interpreter::sample;
use super::recipe::{File, Recipe};
use crate::stream::Stream;

/// The files. Their order and that of the kinds in them are part of the sampled scenes.
const FILES: [&str; 10] = [
    include_str!("kinds/cans.toml"),
    include_str!("kinds/cartons.toml"),
    include_str!("kinds/bottles.toml"),
    include_str!("kinds/fruit.toml"),
    include_str!("kinds/kitchenware.toml"),
    include_str!("kinds/cutlery.toml"),
    include_str!("kinds/tools.toml"),
    include_str!("kinds/balls.toml"),
    include_str!("kinds/toys.toml"),
    include_str!("kinds/paints.toml"),
];

/// The contents of all files, and the kinds in them.
static CATALOGUE: LazyLock<(File, Vec<DistractorKind>)> = LazyLock::new(|| {
    let mut all = File::default();
    for text in FILES {
        let file: File =
            toml::from_str(text).unwrap_or_else(|error| panic!("a file of distractors: {error}"));
        all.vivid.extend(file.vivid);
        all.profiles.extend(file.profiles);
        all.groups.extend(file.groups);
        all.kind.extend(file.kind);
    }
    let kinds = core::mem::take(&mut all.kind).into_iter().map(DistractorKind).collect();
    (all, kinds)
});

/// A kind of distractor object.
pub struct DistractorKind(Recipe);

impl DistractorKind {
    /// Returns all kinds. The order is part of the sampled scenes.
    #[must_use]
    pub fn all() -> &'static [Self] {
        &CATALOGUE.1
    }

    /// Returns the name; also the name of the stream from which its objects are sampled.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Samples an object of this kind: a pure function of the stream.
    pub fn sample(&self, stream: &mut Stream) -> Distractor {
        sample(&self.0, &CATALOGUE.0, stream)
    }
}

/// Returns the profile (r, z) of an apple from the lower to the upper dimple, in units of its radius.
#[must_use]
pub fn apple_profile() -> &'static [[f64; 2]] {
    &CATALOGUE.0.profiles["apple"]
}
