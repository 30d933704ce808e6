//! A tomato and an apple: spheres for collision, with detailed visuals. See docs/benchmark.md, "Scenes and
//! objects".

use super::{movable, rgb};
use crate::scene::{APPLE_PROFILE, AppearanceSpec, BodySpec, PartSpec, Primitive, VisualShape, VisualSpec};

/// Radius of either fruit, in m.
pub(in crate::tasks) const RADIUS: f64 = 0.0375;
/// Angular damping that stands in for rolling resistance, in 1/s.
const ROLLING_DAMPING: f64 = 3.0;

/// Creates a red tomato with a green calyx. Its origin is its lowest point.
pub(in crate::tasks) fn tomato(region: usize, surface_z_m: f64) -> BodySpec {
    /// Outline of the calyx, in m.
    const CALYX: [[f64; 2]; 10] = [
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
    let (skin, green) = (skin_appearance([200, 34, 24]), AppearanceSpec::plain(rgb([62, 112, 36])));
    let (middle, top) = ([0.0, 0.0, RADIUS], [0.0, 0.0, 2.0 * RADIUS - 0.002]);
    let ball = Primitive::Ball { radius: RADIUS };
    let calyx = VisualShape::Extrusion { outline: CALYX.to_vec(), holes: Vec::new(), half_height: 0.0015 };
    BodySpec {
        visuals: vec![
            VisualSpec::at(VisualShape::Primitive(ball.clone()), middle, skin),
            VisualSpec::at(calyx, top, green),
            VisualSpec::at(stem(), top, green),
        ],
        damping: [0.0, ROLLING_DAMPING],
        ..movable("tomato", vec![PartSpec::at(ball, middle, skin)], region, surface_z_m)
    }
}

/// Creates a red apple with its stem. Its origin is its centre.
pub(in crate::tasks) fn apple(region: usize, surface_z_m: f64) -> BodySpec {
    let skin = skin_appearance([190, 28, 32]);
    let profile = APPLE_PROFILE.iter().map(|point| point.map(|x| x * RADIUS)).collect();
    let ball = PartSpec::at(Primitive::Ball { radius: RADIUS }, [0.0; 3], skin);
    BodySpec {
        visuals: vec![
            VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], skin),
            VisualSpec::at(stem(), [0.0, 0.0, 0.9 * RADIUS], AppearanceSpec::plain(rgb([84, 58, 34]))),
        ],
        damping: [0.0, ROLLING_DAMPING],
        ..movable("apple", vec![ball], region, surface_z_m)
    }
}

fn skin_appearance(color: [u8; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(rgb(color)) }
}

fn stem() -> VisualShape {
    VisualShape::Primitive(Primitive::Capsule { radius: 0.0025, half_height: 0.007 })
}
