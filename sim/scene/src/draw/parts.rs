//! Sampling of a body's shapes and of their appearance.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::appearance;
use crate::appearance::AppearanceSpec;
use crate::drawn::{Appearance, Part, Visual};
use crate::shape::factors_along;
use crate::spec::{PartSpec, RenderParts, VisualSpec};

/// Draws the appearances of a body's render parts.
pub(crate) struct Painter<'a> {
    /// Name of the body.
    pub(crate) name: &'a str,
    pub(crate) render_parts: RenderParts,
    pub(crate) episode_seed: u64,
}

impl Painter<'_> {
    /// Draws the appearances of all shapes of a kind, "part" or "visual". The random stream of a render part
    /// is named after its first shape.
    fn draw(&self, appearances: &[AppearanceSpec], kind: &str) -> Vec<Appearance> {
        let draw = |(idx, appearance): (usize, &AppearanceSpec)| {
            let first = match self.render_parts {
                RenderParts::PerAppearance => appearances.iter().position(|other| other == appearance),
                RenderParts::PerShape => Some(idx),
                RenderParts::Single => Some(0),
            };
            let name = format!("{}/{kind}{}", self.name, first.unwrap_or(idx));
            appearance::draw(*appearance, self.episode_seed, &name)
        };
        appearances.iter().enumerate().map(draw).collect()
    }
}

/// Scales the parts of a body and draws their appearances.
pub(crate) fn draw_parts(painter: &Painter<'_>, parts: &[PartSpec], scale: &Vector3<f64>) -> Vec<Part> {
    let appearances: Vec<_> = parts.iter().map(|part| part.appearance).collect();
    let draw = |(part, appearance): (&PartSpec, Appearance)| {
        let (shape, pose) = part.shape.stretched(&part.pose, scale);
        Part { shape, pose, appearance }
    };
    parts.iter().zip(painter.draw(&appearances, "part")).map(draw).collect()
}

/// Scales the visuals of a body and draws their appearances.
pub(crate) fn draw_visuals(
    painter: &Painter<'_>,
    visuals: &[VisualSpec],
    scale: &Vector3<f64>,
) -> Vec<Visual> {
    let appearances: Vec<_> = visuals.iter().map(|visual| visual.appearance).collect();
    let draw = |(visual, appearance): (&VisualSpec, Appearance)| {
        let (shape, stretch) = if scale.x == scale.y && scale.x == scale.z {
            (visual.shape.scaled(scale.x), [1.0; 3])
        } else {
            let along = factors_along(&visual.pose.rotation, scale);
            (
                visual.shape.clone(),
                along.unwrap_or_else(|| panic!("a visual of {} is oblique", painter.name)).into(),
            )
        };
        Visual { shape, stretch, pose: scale_translation(&visual.pose, scale), appearance }
    };
    visuals.iter().zip(painter.draw(&appearances, "visual")).map(draw).collect()
}

pub(crate) fn scale_translation(pose: &Isometry3<f64>, scale: &Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(pose.translation.vector.component_mul(scale)), pose.rotation)
}
