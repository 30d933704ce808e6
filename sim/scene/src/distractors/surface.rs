//! Surfaces of vessels and boxes, and what is printed on them. Places on a surface are fractions of its size,
//! so that a print fits every surface of its kind.

use nalgebra::Isometry3;
use serde::Deserialize;

use super::builder::{HALF_TURN_Z, IDENTITY, Z_TO_X, pose};
use super::outline::{arc, ellipse};
use super::shape::Shape;
use crate::{Primitive, VisualShape};

/// Distance by which a print protrudes per layer, so that it covers what is below it, in m.
const LAYER: f64 = 0.0003;

/// A surface to print on.
#[derive(Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum Surface {
    /// Radius and the two heights between which the print lies.
    Cylinder { cylinder: [f64; 3] },
    /// Half-extents of an upright box and its printed sides: 1 at +x, −1 at −x.
    Box { r#box: [f64; 3], sides: Vec<f64> },
}

impl Surface {
    /// Returns the visual shapes of a print.
    ///
    /// # Panics
    /// If `shape` is not a print for this kind of surface.
    pub(crate) fn prints(&self, shape: &Shape) -> Vec<(Isometry3<f64>, VisualShape)> {
        match (self, shape) {
            (&Self::Cylinder { cylinder: [radius, low, high] }, &Shape::Band([layer, from, to])) => {
                let between = [from, to].map(|fraction| low + (high - low) * fraction);
                vec![(Isometry3::identity(), column(radius + LAYER * layer, between))]
            }
            (&Self::Cylinder { cylinder: [radius, low, high] }, &Shape::Panel([layer, angle, from, to])) => {
                let [from, to] = [from, to].map(|fraction| low + (high - low) * fraction);
                let half_steps = angle as i32;
                let outer = arc(radius + LAYER * layer, [-half_steps, half_steps, 1]);
                let outline = outer.chain(arc(radius - 0.003, [half_steps, -half_steps, -1])).collect();
                let label = extrusion(outline, (to - from) / 2.0);
                let at = |turn| (pose([0.0, 0.0, f64::midpoint(from, to)], turn), label.clone());
                vec![at(IDENTITY), at(HALF_TURN_Z)]
            }
            (Self::Box { r#box: [x, y, z], sides }, &Shape::Print([layer, width, height, at_y, at_z])) => {
                let field = Primitive::Box { half: [layer * LAYER, y * width, z * height] };
                let at = |side| pose([side * x, y * at_y, z * at_z], IDENTITY);
                sides.iter().map(|side| (at(side), VisualShape::Primitive(field.clone()))).collect()
            }
            (Self::Box { r#box: [x, y, z], sides }, &Shape::Picture([layer, size])) => {
                let radius = size * (0.42 * y.min(*z));
                let picture = extrusion(ellipse([0.9 * radius, 1.15 * radius]), (layer + 1.0) * LAYER);
                let at = |side| pose([side * x, 0.0, 0.04 * z], Z_TO_X);
                sides.iter().map(|side| (at(side), picture.clone())).collect()
            }
            _ => panic!("a cylinder takes bands and panels, a box takes prints and pictures"),
        }
    }
}

/// Returns a cylinder about the z axis between two heights.
pub(crate) fn column(radius: f64, [low, high]: [f64; 2]) -> VisualShape {
    VisualShape::Lathe { profile: vec![[0.0, low], [radius, low], [radius, high], [0.0, high]] }
}

fn extrusion(outline: Vec<[f64; 2]>, half_height: f64) -> VisualShape {
    VisualShape::Extrusion { outline, holes: Vec::new(), half_height }
}
