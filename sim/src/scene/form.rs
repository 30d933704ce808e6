//! Forms that bodies are seen as. Lengths in metres, centred on their own origin unless said otherwise. They never
//! collide: that is what [`Primitive`]s are for, which can be seen too.

use core::f64::consts::FRAC_1_SQRT_2;

use super::shape::Primitive;

/// A closed surface.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// A convex solid.
    Primitive(Primitive),
    /// Box with half extents along x, y, z whose edges are rounded.
    RoundedBox {
        /// Half extents in m, the roundings included.
        half: [f64; 3],
        /// Radius of the edges in m, at most the least half extent.
        edge_radius: f64,
    },
    /// What a profile sweeps that is turned once around z. The origin is wherever the profile puts it.
    Lathe {
        /// Points (r, z) in m with the outside to the right of the way: up the outside and, for a vessel, down the
        /// inside. It starts and ends on the axis (r = 0), or ends where it starts.
        profile: Vec<[f64; 2]>,
    },
    /// Ring about z.
    Torus {
        /// Radius in m of the circle that the tube goes around.
        major_radius: f64,
        /// Radius in m of the tube, at most the other.
        minor_radius: f64,
    },
    /// Plate or bar along z over an outline. The origin lies in its middle plane, wherever the outline puts it.
    Extrusion {
        /// Points (x, y) in m, either way around, the first not repeated.
        outline: Vec<[f64; 2]>,
        /// What is left out, each as the outline and inside it; they neither touch it nor one another.
        holes: Vec<Vec<[f64; 2]>>,
        /// Half of its length in m.
        half_height: f64,
    },
}

impl Form {
    /// The same form, every length times `scale`.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        let points = |points: &Vec<[f64; 2]>| points.iter().map(|p| p.map(|x| x * scale)).collect();
        match self {
            Self::Primitive(solid) => Self::Primitive(solid.scaled(scale)),
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

/// Cosines of 0°, 15°, … 90°, written down so that no outline depends on a system's libm.
const COSINES: [f64; 7] = [
    1.0,
    0.965_925_826_289_068_3,
    0.866_025_403_784_438_6,
    FRAC_1_SQRT_2,
    0.5,
    0.258_819_045_102_520_76,
    0.0,
];

/// Outline of the rectangle |x|, |y| ≤ `half` (m) whose corners are rounded to `radius` (m), counter-clockwise.
///
/// # Panics
/// If the radius is not above zero and below both half extents.
#[must_use]
pub fn rounded_rectangle(half: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let fits = radius > 0.0 && half.iter().all(|half| radius < *half);
    assert!(fits, "corners of radius {radius} m do not fit a rectangle of half extents {half:?} m");
    let last = COSINES.len() - 1;
    let corner = |signs: [f64; 2]| {
        (0..=last).map(move |i| {
            // On the second and fourth corner the arc runs from y to x.
            let step = if signs[0] * signs[1] > 0.0 { i } else { last - i };
            let arc = [COSINES[step], COSINES[last - step]];
            core::array::from_fn(|axis| signs[axis] * (half[axis] - radius + radius * arc[axis]))
        })
    };
    [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]].into_iter().flat_map(corner).collect()
}
