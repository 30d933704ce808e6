//! Distributions of initial poses: placement regions, placements of bodies in them, and distractor placement.

use nalgebra::{Isometry3, UnitQuaternion};

use crate::range::Range;

/// An axis-aligned rectangle of the ground plane from which the positions of one or more bodies are sampled.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionSpec {
    /// Name; also the name of the region's random streams.
    pub name: &'static str,
    /// World x of a body before the shared offset, in m.
    pub x: Range,
    /// World y of a body before the shared offset, in m.
    pub y: Range,
    /// Offset (x, y) sampled once and added to every body of the region, in m.
    pub shared_offset: [Range; 2],
    /// If `true`, the whole region is mirrored in the plane y = 0 with probability 0.5.
    pub random_mirror: bool,
    /// Minimum gap between the bounding circle of a body's footprint and those of the bodies placed before it
    /// (visual-only bodies included), in m. `None` disables rejection sampling.
    pub min_gap_m: Option<f64>,
    /// Ranges under Pose-Randomization; `None` if the benchmark does not widen this region.
    pub widened: Option<WidenedRanges>,
}

/// Ranges that replace those of a region under Pose-Randomization.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WidenedRanges {
    /// World x, in m.
    pub x: Range,
    /// World y, in m.
    pub y: Range,
    /// Shared offset (x, y), in m.
    pub shared_offset: [Range; 2],
}

impl RegionSpec {
    /// Sets the shared offset (m), which Pose-Randomization does not widen.
    #[must_use]
    pub fn with_shared_offset(self, shared_offset: [Range; 2]) -> Self {
        let widened = self.widened.map(|widened| WidenedRanges { shared_offset, ..widened });
        Self { shared_offset, widened, ..self }
    }

    /// Excludes the region from Pose-Randomization.
    #[must_use]
    pub fn not_widened(self) -> Self {
        Self { widened: None, ..self }
    }
}

/// Placement of distractor objects within their region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DistractorPlacement {
    /// At rest on the table at any yaw, clear of the arms, of all bodies and of each other, and without
    /// hiding a manipulated object from an external camera.
    Resting,
    /// In the air, upright at yaw 0, wherever that is: the object falls onto whatever is below it.
    Dropped,
}

/// Distribution of the distractor objects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistractorsSpec {
    /// Maximum number of distractor objects.
    pub n: usize,
    /// Probability that each of them is present.
    pub presence: f64,
    /// World x of each object's origin, in m.
    pub x: Range,
    /// World y of each object's origin, in m.
    pub y: Range,
    /// Placement within these ranges.
    pub placement: DistractorPlacement,
    /// World z of the table top, on which objects rest, in m.
    pub surface_z_m: f64,
    /// Height from which objects are dropped, in m: above the origin of the body with this index, or above
    /// world z = 0.
    pub drop_m: (f64, Option<usize>),
}

/// Distribution of a body's initial pose.
#[derive(Clone, Debug, PartialEq)]
pub enum PlacementSpec {
    /// Sampled from a region, on or above a horizontal surface.
    OnSurface {
        /// Index into [`super::SceneSpec::regions`].
        region: usize,
        /// World z of the surface, in m.
        surface_z_m: f64,
        /// World z of the body's origin at the start, in m; the body drops onto the surface. `None` starts it
        /// with its lowest point on the surface, and so does a height at which it would be inside.
        origin_z_m: Option<f64>,
        /// Orientation before the yaw rotation.
        orientation: UnitQuaternion<f64>,
        /// Rotation about world z, in rad.
        yaw: Range,
    },
    /// Unrotated, at the y of another body, which must be placed [`OnSurface`](Self::OnSurface), and on its
    /// −x side.
    Beside {
        /// Index of the other body.
        body: usize,
        /// World x of the body's origin, in m. It is less if the gap would be too small otherwise.
        x_m: f64,
        /// Minimum gap between the bounding boxes of the two bodies, in m. `None` accepts overlaps.
        min_gap_m: Option<f64>,
        /// World z of the surface, in m.
        surface_z_m: f64,
        /// World z of the body's origin at the start, in m; the body drops onto the surface.
        origin_z_m: f64,
    },
    /// Unrotated, with its origin above that of another body, which must be placed
    /// [`OnSurface`](Self::OnSurface); it drops onto a surface of the other body.
    Over {
        /// Index of the other body.
        body: usize,
        /// World z of the body's origin at the start, in m. The body starts higher if its lowest point would
        /// otherwise be below the surface.
        origin_z_m: f64,
        /// Height of the surface in the other body's frame at scale 1, in m.
        surface_z_m: f64,
    },
    /// Fixed relative to another body, which must be placed [`OnSurface`](Self::OnSurface).
    RelativeTo {
        /// Index of the other body.
        body: usize,
        /// Pose in the other body's frame at scale 1. The translation scales with the other body.
        pose: Isometry3<f64>,
    },
}
