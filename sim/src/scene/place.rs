//! Where bodies start: regions of the ground, places in them, and clutter. Plain data of ranges.

use nalgebra::{Isometry3, UnitQuaternion};

use super::range::Range;

/// A rectangle of the ground plane in which bodies are placed without overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionSpec {
    /// Names its random streams.
    pub name: &'static str,
    /// World x of a body, in m, before the common offset.
    pub x: Range,
    /// World y of a body, in m, before the common offset.
    pub y: Range,
    /// Offset (x, y) that all bodies of the region share, in m.
    pub common: [Range; 2],
    /// Whether the region lies, with equal chances, on the other side of y = 0 for all its bodies.
    pub either_side: bool,
    /// Least gap between the circles around the footprints of a body and of those placed before it, in m, marks included;
    /// `None` places without looking.
    pub gap_m: Option<f64>,
    /// The same place under Pose-Randomization; `None` where the benchmark keeps it.
    pub widened: Option<Widened>,
}

/// What takes the place of a region's ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Widened {
    /// World x, in m.
    pub x: Range,
    /// World y, in m.
    pub y: Range,
    /// Common offset (x, y), in m.
    pub common: [Range; 2],
}

impl RegionSpec {
    /// The same with a common offset (m), as wide under Pose-Randomization as otherwise.
    #[must_use]
    pub fn sharing(self, common: [Range; 2]) -> Self {
        let widened = self.widened.map(|widened| Widened { common, ..widened });
        Self { common, widened, ..self }
    }

    /// The same, left as it is by Pose-Randomization.
    #[must_use]
    pub fn kept(self) -> Self {
        Self { widened: None, ..self }
    }
}

/// Clutter: things of random kinds, each at rest on the table where nothing else is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistractorsSpec {
    /// How many there may be.
    pub n: usize,
    /// Chance of each to be there.
    pub presence: f64,
    /// World x of the middle of each, in m.
    pub x: Range,
    /// World y, in m.
    pub y: Range,
    /// World z of the table's top, in m.
    pub surface_z_m: f64,
}

/// Where a body starts.
#[derive(Clone, Debug, PartialEq)]
pub enum PlacementSpec {
    /// Somewhere in a region, its lowest point on a surface.
    On {
        /// Index into [`super::SceneSpec::regions`].
        region: usize,
        /// World z of the surface, in m.
        surface_z_m: f64,
        /// Orientation before yaw.
        upright: UnitQuaternion<f64>,
        /// Rotation about world z, in rad.
        yaw: Range,
    },
    /// At a pose in the frame of another body that is placed on a surface.
    With {
        /// Index of that body.
        body: usize,
        /// Pose at scale 1; its translation scales with that body.
        pose: Isometry3<f64>,
    },
}
