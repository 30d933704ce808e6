//! Sampling of appearances, the table, the background and the lights: everything that affects only images.

use nalgebra::{UnitQuaternion, Vector3};

use crate::appearance::Texture;
use crate::appearance::{AppearanceSpec, AppearanceVariation};
use crate::drawn::{Appearance, Background, DirectionalLight, Lights, Table};
use crate::range::Range;
use crate::spec::{BackgroundSpec, LightsSpec, TableSpec};
use crate::stream::Stream;

/// Draws the appearance of each table part independently, except that a resampled colour is shared by the
/// whole table. The plate above the lower table has a colour of its own.
pub(crate) fn table(spec: &TableSpec, episode_seed: u64) -> Table {
    let draw = |appearance, part: &str, color: &str| {
        let drawn = draw_with_color_stream(appearance, episode_seed, &format!("table/{part}"), color);
        // The benchmark replaces a recoloured table by a plain block.
        let metallic = if drawn.texture.is_some() { drawn.metallic } else { 0.0 };
        Appearance { metallic, ..drawn }
    };
    let top_color = if spec.lower_top.is_some() { "plate/color" } else { "table/color" };
    Table {
        kind: spec.kind,
        top: draw(spec.top, "top", top_color),
        legs: draw(spec.legs, "legs", "table/color"),
        lower_top: spec.lower_top.map(|appearance| draw(appearance, "under", "table/color")),
        as_block: spec.as_block,
    }
}

pub(crate) fn background(spec: &BackgroundSpec, episode_seed: u64) -> Background {
    let has_walls = spec.walls.variation != AppearanceVariation::NONE;
    Background {
        floor: draw(spec.floor, episode_seed, "floor"),
        walls: has_walls.then(|| draw(spec.walls, episode_seed, "walls")),
    }
}

pub(crate) fn lights(spec: &LightsSpec, episode_seed: u64) -> Lights {
    let draw = |name: &str, ranges: [Range; 3]| {
        let mut stream = Stream::new(episode_seed, name);
        ranges.map(|range| stream.uniform(range))
    };
    let directional = spec.directional.iter().enumerate().map(|(i, light)| {
        let yaw = Stream::new(episode_seed, &format!("light/{i}/turn")).uniform(light.yaw);
        let direction =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * Vector3::from(light.direction);
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

/// Draws an appearance from the streams whose names start with `name`.
pub(crate) fn draw(spec: AppearanceSpec, episode_seed: u64, name: &str) -> Appearance {
    draw_with_color_stream(spec, episode_seed, name, &format!("{name}/color"))
}

/// Draws an appearance from the streams whose names start with `name`, except that a resampled colour comes
/// from `color_stream`, which several parts may share.
fn draw_with_color_stream(
    spec: AppearanceSpec,
    episode_seed: u64,
    name: &str,
    color_stream: &str,
) -> Appearance {
    let AppearanceSpec { color, texture, specular, metallic, variation } = spec;
    let chance = |of: &str, limit: f64| Stream::new(episode_seed, &format!("{name}/{of}")).unit() < limit;
    let both = variation.color > 0.0 && variation.texture > 0.0;
    let recolors = variation.color > 0.0 && (!both || chance("coin", 0.5));
    if recolors {
        let mut stream = Stream::new(episode_seed, color_stream);
        let ranges = color.map(|c| Range::new(0.0, 1.0).shrunk_to(c, variation.color));
        let color = ranges.map(|range| stream.uniform(range));
        let texture = texture.filter(|_| !chance("plain", variation.color));
        Appearance { color, texture, specular, metallic }
    } else if variation.texture > 0.0 && chance("pattern", variation.texture) {
        let choice = Stream::new(episode_seed, &format!("{name}/texture")).choose(Texture::PERTURBATION);
        Appearance { color: [1.0; 3], texture: Some(*choice), specular, metallic }
    } else {
        Appearance { color, texture, specular, metallic }
    }
}
