//! Shapes that recipes are made of.

use serde::Deserialize;

use super::curve::{Bow, Seam};
use super::outline::Piece;

/// A shape in its own frame.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Shape {
    Box([f64; 3]),
    RoundedBox([f64; 4]),
    Cylinder([f64; 2]),
    Column([f64; 3]),
    Ball(f64),
    Capsule([f64; 2]),
    Lathe(Lathe),
    Extrusion(Extrusion),
    Band([f64; 3]),
    Panel([f64; 4]),
    Print([f64; 5]),
    Picture([f64; 2]),
    Seam(Seam),
    Bow(Bow),
}

/// Profile points (r, z), or a shared profile times a length.
#[derive(Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum Lathe {
    Points(Vec<[f64; 2]>),
    Scaled { profile: String, times: f64 },
}

/// Outline with holes and half of the height.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Extrusion {
    pub(crate) half: f64,
    pub(crate) outline: Vec<Piece>,
    #[serde(default)]
    pub(crate) holes: Vec<Vec<Piece>>,
}
