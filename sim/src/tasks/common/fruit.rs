//! A tomato and an apple: balls that look like them (spec/tasks.md §1, tasks 16 and 22).

use super::{movable, rgb};
use crate::scene::{APPLE_PROFILE, AppearanceSpec, BodySpec, PartSpec, Primitive, VisualShape, VisualSpec};

/// Radius of either in m.
pub(in crate::tasks) const RADIUS: f64 = 0.0375;
/// Share of its spin that either loses per second, for it is no perfect ball; in 1/s.
const ROLLING_LOSS: f64 = 3.0;

/// A red tomato with a green star of leaves, its origin where it touches what it lies on.
pub(in crate::tasks) fn tomato(region: usize, surface_z_m: f64) -> BodySpec {
    /// Points of the leaves in m.
    const STAR: [[f64; 2]; 10] = [
        [0.02, 0.0],
        [0.0049, 0.0035],
        [0.0062, 0.019],
        [-0.0019, 0.0057],
        [-0.0162, 0.0118],
        [-0.006, 0.0],
        [-0.0162, -0.0118],
        [-0.0019, -0.0057],
        [0.0062, -0.019],
        [0.0049, -0.0035],
    ];
    let (skin, green) = (skin([200, 34, 24]), AppearanceSpec::plain(rgb([62, 112, 36])));
    let (middle, top) = ([0.0, 0.0, RADIUS], [0.0, 0.0, 2.0 * RADIUS - 0.002]);
    let ball = Primitive::Ball { radius: RADIUS };
    let leaves = VisualShape::Extrusion { outline: STAR.to_vec(), holes: Vec::new(), half_height: 0.0015 };
    BodySpec {
        visuals: vec![
            VisualSpec::at(VisualShape::Primitive(ball), middle, skin),
            VisualSpec::at(leaves, top, green),
            VisualSpec::at(stalk(), top, green),
        ],
        damping: [0.0, ROLLING_LOSS],
        ..movable("tomato", vec![PartSpec::at(ball, middle, skin)], region, surface_z_m)
    }
}

/// A red apple with its stalk, its origin in its middle.
pub(in crate::tasks) fn apple(region: usize, surface_z_m: f64) -> BodySpec {
    let skin = skin([190, 28, 32]);
    let profile = APPLE_PROFILE.iter().map(|point| point.map(|x| x * RADIUS)).collect();
    let ball = PartSpec::at(Primitive::Ball { radius: RADIUS }, [0.0; 3], skin);
    BodySpec {
        visuals: vec![
            VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], skin),
            VisualSpec::at(stalk(), [0.0, 0.0, 0.9 * RADIUS], AppearanceSpec::plain(rgb([84, 58, 34]))),
        ],
        damping: [0.0, ROLLING_LOSS],
        ..movable("apple", vec![ball], region, surface_z_m)
    }
}

fn skin(color: [u8; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(rgb(color)) }
}

fn stalk() -> VisualShape {
    VisualShape::Primitive(Primitive::Capsule { radius: 0.0025, half_height: 0.007 })
}
