//! The cooking pot that two tasks take by its two handles (spec/tasks.md §1 and §3, tasks 19 and 22).

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::vessel::Vessel;
use super::{BIMANUAL_TABLE_Z, movable, rgb, visual_of};
use crate::expert::{Move, both_arms, grasp};
use crate::scene::{AppearanceSpec, BodySpec, PartSpec, Primitive, Scene, VisualShape, VisualSpec};

/// Start pose P of spec/tasks.md §3: the hands level, on either side of the pot and turned to it.
pub(in crate::tasks) const QPOS: [[f64; 7]; 2] =
    [[0.599, 0.4, -0.561, -2.511, 1.695, 1.395, -0.479], [2.358, 0.442, 0.697, -2.513, -1.775, 1.347, 2.031]];

/// Narrow enough below that a tray and it stand side by side at any size.
pub(in crate::tasks) const VESSEL: Vessel = Vessel { radii: [0.106, 0.146], height: 0.175, thickness: 0.006 };
/// Radius of the rim's bead and, from the axis to its outside, of the rim, in m.
const RIM: [f64; 2] = [0.0032, 0.1524];

/// The handles' bars: distance from the axis, half their length, height over the base, radius; in m.
const BAR_AT: f64 = 0.1726;
const BAR_HALF_LENGTH: f64 = 0.04;
const BAR_Z: f64 = 0.15;
const BAR_RADIUS: f64 = 0.008;

/// The pot on the bimanual table, its origin in the middle of its base and its handles along y.
pub(in crate::tasks) fn pot(region: usize) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.5, ..AppearanceSpec::plain(rgb([129, 133, 137])) };
    let handles: Vec<PartSpec> = [-1.0, 1.0].into_iter().flat_map(|side| handle(side, steel)).collect();
    let [bead, rim] = RIM;
    let ring = VisualShape::Torus { major_radius: rim - bead, minor_radius: bead };
    let mut visuals =
        vec![VESSEL.look(0.008, steel), VisualSpec::at(ring, [0.0, 0.0, VESSEL.height - bead], steel)];
    visuals.extend(handles.iter().map(visual_of));
    let parts = VESSEL.parts(steel).into_iter().chain(handles).collect();
    BodySpec { visuals, ..movable("pot", parts, region, BIMANUAL_TABLE_Z) }
}

/// A bar along x and what holds it.
fn handle(side: f64, appearance: AppearanceSpec) -> [PartSpec; 3] {
    let rod = |half_height, position: [f64; 3], axis| {
        let turned = UnitQuaternion::from_axis_angle(&axis, FRAC_PI_2);
        let pose = Isometry3::from_parts(Translation3::from(position), turned);
        PartSpec { shape: Primitive::Capsule { radius: BAR_RADIUS, half_height }, pose, appearance }
    };
    let stem_half_length = (BAR_AT - VESSEL.radii[1] + VESSEL.thickness) / 2.0;
    let stem = |x| rod(stem_half_length, [x, side * (BAR_AT - stem_half_length), BAR_Z], Vector3::x_axis());
    [
        rod(BAR_HALF_LENGTH, [0.0, side * BAR_AT, BAR_Z], Vector3::y_axis()),
        stem(-BAR_HALF_LENGTH),
        stem(BAR_HALF_LENGTH),
    ]
}

/// From how far away the hands come to the handles, in m.
const AWAY: f64 = 0.1;

/// TCP poses of the two arms at the handles: level, and closing from above and below the way round that they start.
pub(in crate::tasks) fn grips(scene: &Scene) -> [Isometry3<f64>; 2] {
    let pot = scene.body("pot");
    [0, 1].map(|arm| {
        let side = [-1.0, 1.0][arm];
        let bar = pot.pose * Point3::from(Vector3::new(0.0, side * BAR_AT, BAR_Z) * pot.scale);
        let inwards = pot.pose.rotation * Vector3::y() * -side;
        let closing = grasp::closest_closing(Vector3::z(), &grasp::start_closing(scene, arm));
        grasp::pose(&bar.coords, &inwards, &closing)
    })
}

/// The TCP pose from where a hand comes to its handle.
pub(in crate::tasks) fn away(grip: &Isometry3<f64>) -> Isometry3<f64> {
    grasp::retreated(grip, AWAY)
}

/// Goes on to the handles and takes the pot by both.
pub(in crate::tasks) fn seize(grips: &[Isometry3<f64>; 2]) -> [Move; 3] {
    [Move::Straight(both_arms(*grips)), Move::close(&[0], 10), Move::close(&[1], 10)]
}
