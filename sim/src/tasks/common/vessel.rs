//! Round open vessels that can contain objects: pots and pans.

use core::f64::consts::TAU;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::scene::{AppearanceSpec, PartSpec, Primitive, VisualShape, VisualSpec};

/// Number of boxes that form a vessel's wall.
const N_WALLS: u32 = 12;

/// Dimensions of a vessel that stands on z = 0 and is symmetric about z. Lengths in m.
pub(in crate::tasks) struct Vessel {
    /// Outer radius at the base and at the rim.
    pub(in crate::tasks) radii: [f64; 2],
    /// Height of the rim above the base.
    pub(in crate::tasks) height: f64,
    /// Thickness of the wall and floor.
    pub(in crate::tasks) thickness: f64,
}

impl Vessel {
    /// Creates the floor, and the wall as a ring of boxes that lean outwards.
    pub(in crate::tasks) fn parts(&self, appearance: AppearanceSpec) -> Vec<PartSpec> {
        let half_height = self.thickness / 2.0;
        let floor = Primitive::Cylinder { radius: self.radii[0], half_height };
        let floor = PartSpec::at(floor, [0.0, 0.0, half_height], appearance);
        (0..N_WALLS).map(|i| self.wall(i, appearance)).chain([floor]).collect()
    }

    fn wall(&self, i: u32, appearance: AppearanceSpec) -> PartSpec {
        let ([low, high], half_thickness) = (self.radii, self.thickness / 2.0);
        let lean = libm::atan2(high - low, self.height);
        let middle = f64::midpoint(low, high) - half_thickness;
        let half_angle = TAU / f64::from(2 * N_WALLS);
        // The lowest corners lie on z = 0 and the highest at the height of the rim.
        let half_length = (self.height / 2.0 - half_thickness * libm::sin(lean)) / libm::cos(lean);
        let half = [half_thickness, middle * libm::tan(half_angle), half_length];
        let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        let around = about(Vector3::z_axis(), f64::from(2 * i + 1) * half_angle);
        let centre = around * Vector3::new(middle, 0.0, self.height / 2.0);
        let pose = Isometry3::from_parts(centre.into(), around * about(Vector3::y_axis(), lean));
        PartSpec { shape: Primitive::Box { half }, pose, appearance }
    }

    /// Creates the visual of the wall and floor, with a fillet of radius `fillet` (m) between them.
    pub(in crate::tasks) fn visual(&self, fillet: f64, appearance: AppearanceSpec) -> VisualSpec {
        let &Self { radii: [low, high], height, thickness } = self;
        let profile = vec![
            [0.0, 0.0],
            [low - fillet, 0.0],
            [low, fillet],
            [high, height],
            [high - thickness, height],
            [low - thickness, thickness + fillet],
            [low - thickness - fillet, thickness],
            [0.0, thickness],
        ];
        VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], appearance)
    }
}
