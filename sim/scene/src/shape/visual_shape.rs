//! Shapes of visuals. They never collide; collision shapes are [`Primitive`]s, which can also be rendered.
//!
//! Lengths are in m. Every shape is centred on its own origin unless stated otherwise.

use core::f64::consts::FRAC_1_SQRT_2;

use super::primitive::Primitive;

/// A closed surface.
#[derive(Clone, Debug, PartialEq)]
pub enum VisualShape {
    /// A primitive, as also used for collision.
    Primitive(Primitive),
    /// Axis-aligned box with rounded edges.
    RoundedBox {
        /// Half-extents along x, y and z including the rounding, in m.
        half: [f64; 3],
        /// Edge radius in m, at most the smallest half-extent.
        edge_radius: f64,
    },
    /// Surface of revolution about the z axis. The profile determines the origin.
    Lathe {
        /// Profile points (r, z) in m, ordered so that the outside lies to the right: up the outside and, for
        /// a vessel, down the inside. The profile either starts and ends on the axis (r = 0) or is closed
        /// (ends where it starts).
        profile: Vec<[f64; 2]>,
    },
    /// Torus about the z axis.
    Torus {
        /// Distance from the axis to the centre line of the tube, in m.
        major_radius: f64,
        /// Radius of the tube in m, at most the major radius.
        minor_radius: f64,
    },
    /// Outline in the xy plane, extruded symmetrically along z. The outline determines the origin's x and y.
    Extrusion {
        /// Outline points (x, y) in m, in either orientation, without repeating the first.
        outline: Vec<[f64; 2]>,
        /// Holes, each given like the outline. They lie inside it and touch neither it nor one another.
        holes: Vec<Vec<[f64; 2]>>,
        /// Half of the length along z, in m.
        half_height: f64,
    },
}

impl VisualShape {
    /// Returns the shape with every length multiplied by `scale`.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        let points = |points: &Vec<[f64; 2]>| points.iter().map(|p| p.map(|x| x * scale)).collect();
        match self {
            Self::Primitive(primitive) => Self::Primitive(primitive.scaled(scale)),
            Self::RoundedBox { half, edge_radius } => {
                Self::RoundedBox { half: half.map(|h| h * scale), edge_radius: edge_radius * scale }
            }
            Self::Lathe { profile } => Self::Lathe { profile: points(profile) },
            Self::Torus { major_radius, minor_radius } => {
                Self::Torus { major_radius: major_radius * scale, minor_radius: minor_radius * scale }
            }
            Self::Extrusion { outline, holes, half_height } => Self::Extrusion {
                outline: points(outline),
                holes: holes.iter().map(points).collect(),
                half_height: half_height * scale,
            },
        }
    }
}

/// Cosines of 0°, 15°, … 90°. They are tabulated so that no outline depends on the system's libm.
const COSINES: [f64; 7] = [
    1.0,
    0.965_925_826_289_068_3,
    0.866_025_403_784_438_6,
    FRAC_1_SQRT_2,
    0.5,
    0.258_819_045_102_520_76,
    0.0,
];

/// Returns the counter-clockwise outline of the rectangle |x| ≤ `half[0]`, |y| ≤ `half[1]` (m) with corners
/// rounded to `radius` (m).
///
/// # Panics
/// If `radius` is not positive or not smaller than both half-extents.
#[must_use]
pub fn rounded_rectangle(half: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let fits = radius > 0.0 && half.iter().all(|half| radius < *half);
    assert!(fits, "corner radius {radius} m does not fit a rectangle with half-extents {half:?} m");
    let last = COSINES.len() - 1;
    let corner = |signs: [f64; 2]| {
        (0..=last).map(move |i| {
            // In the second and fourth quadrants the arc runs from the y axis to the x axis.
            let step = if signs[0] * signs[1] > 0.0 { i } else { last - i };
            let arc = [COSINES[step], COSINES[last - step]];
            core::array::from_fn(|axis| signs[axis] * (half[axis] - radius + radius * arc[axis]))
        })
    };
    [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]].into_iter().flat_map(corner).collect()
}
