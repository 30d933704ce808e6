//! Drawing what is only seen: paints, the table, the room and its lights.

use nalgebra::{UnitQuaternion, Vector3};

use super::drawn::{Background, DirectionalLight, Lights, Paint, Table};
use super::paint::{PaintSpec, Variation};
use super::range::Range;
use super::spec::{BackgroundSpec, LightsSpec, TableSpec};
use super::texture::Texture;
use crate::stream::Stream;

/// Every part's look by itself, but one new colour for a whole table; the plate over another table has its own.
pub(super) fn table(spec: &TableSpec, episode_seed: u64) -> Table {
    let draw = |paint, part: &str, color: &str| varied(paint, episode_seed, &format!("table/{part}"), color);
    let top_color = if spec.under.is_some() { "plate/color" } else { "table/color" };
    Table {
        kind: spec.kind,
        top: draw(spec.top, "top", top_color),
        frame: draw(spec.frame, "frame", "table/color"),
        legs: draw(spec.legs, "legs", "table/color"),
        under: spec.under.map(|paint| draw(paint, "under", "table/color")),
    }
}

pub(super) fn background(spec: &BackgroundSpec, episode_seed: u64) -> Background {
    let walls = spec.walls.variation != Variation::NONE;
    Background {
        floor: paint(spec.floor, episode_seed, "floor"),
        walls: walls.then(|| paint(spec.walls, episode_seed, "walls")),
    }
}

pub(super) fn lights(spec: &LightsSpec, episode_seed: u64) -> Lights {
    let draw = |name: &str, ranges: [Range; 3]| {
        let mut stream = Stream::new(episode_seed, name);
        ranges.map(|range| stream.uniform(range))
    };
    let directional = spec.directional.iter().enumerate().map(|(i, light)| {
        let turn = Stream::new(episode_seed, &format!("light/{i}/turn")).uniform(light.turn);
        let direction =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn) * Vector3::from(light.direction);
        DirectionalLight {
            color: draw(&format!("light/{i}/color"), light.color),
            direction: direction.into(),
        }
    });
    Lights {
        ambient: draw("light/ambient", spec.ambient),
        directional: directional.collect(),
        shadows: spec.shadows,
    }
}

pub(super) fn paint(spec: PaintSpec, episode_seed: u64, name: &str) -> Paint {
    varied(spec, episode_seed, name, &format!("{name}/color"))
}

/// The look of what bears a name, its new colour from a stream that others may share.
fn varied(spec: PaintSpec, episode_seed: u64, name: &str, color_stream: &str) -> Paint {
    let PaintSpec { color, texture, specular, variation } = spec;
    let chance = |of: &str, limit: f64| Stream::new(episode_seed, &format!("{name}/{of}")).unit() < limit;
    let both = variation.color > 0.0 && variation.texture > 0.0;
    let recolors = variation.color > 0.0 && (!both || chance("coin", 0.5));
    if recolors {
        let mut stream = Stream::new(episode_seed, color_stream);
        let color = color.map(|c| Range::new(0.0, 1.0).about(c, variation.color)).map(|c| stream.uniform(c));
        Paint { color, texture: texture.filter(|_| !chance("plain", variation.color)), specular }
    } else if variation.texture > 0.0 && chance("pattern", variation.texture) {
        let choice = Stream::new(episode_seed, &format!("{name}/texture")).choose(Texture::PERTURBATION);
        Paint { color: [1.0; 3], texture: Some(*choice), specular }
    } else {
        Paint { color, texture, specular }
    }
}
