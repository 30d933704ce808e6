//! The cooking pot of DualArmLiftPot and DualArmPourPot, which both arms grasp by its two handles. See
//! docs/benchmark.md, "Scenes and objects".

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::vessel::Vessel;
use super::{BIMANUAL_TABLE_Z, movable, rgb, visual_of};
use crate::expert::{Move, both_arms, grasp};
use crate::scene::{AppearanceSpec, BodySpec, PartSpec, Primitive, Scene, VisualShape, VisualSpec};

/// Initial joint positions of both arms in rad: the hands are level, on either side of the pot and facing it.
pub(in crate::tasks) const QPOS: [[f64; 7]; 2] =
    [[0.599, 0.4, -0.561, -2.511, 1.695, 1.395, -0.479], [2.358, 0.442, 0.697, -2.513, -1.775, 1.347, 2.031]];

/// Dimensions of the pot. It is narrow enough at the base to fit beside a tray at any scale.
pub(in crate::tasks) const VESSEL: Vessel = Vessel { radii: [0.106, 0.146], height: 0.175, thickness: 0.006 };
/// Radius of the rim's bead and outer radius of the rim, in m.
const RIM: [f64; 2] = [0.0032, 0.1524];

/// Distance of a handle's bar from the pot's axis, in m.
const BAR_OFFSET: f64 = 0.1726;
/// Half-length of a handle's bar, in m.
const BAR_HALF_LENGTH: f64 = 0.04;
/// Height of the bars above the base, in m.
const BAR_Z: f64 = 0.15;
/// Radius of the bars and stems, in m.
const BAR_RADIUS: f64 = 0.008;

/// Creates the pot on the bimanual table. Its origin is the centre of its base; its handles are on the y
/// axis.
pub(in crate::tasks) fn pot(region: usize) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.5, ..AppearanceSpec::plain(rgb([129, 133, 137])) };
    let handles: Vec<PartSpec> = [-1.0, 1.0].into_iter().flat_map(|side| handle(side, steel)).collect();
    let [bead, rim] = RIM;
    let ring = VisualShape::Torus { major_radius: rim - bead, minor_radius: bead };
    let mut visuals =
        vec![VESSEL.visual(0.008, steel), VisualSpec::at(ring, [0.0, 0.0, VESSEL.height - bead], steel)];
    visuals.extend(handles.iter().map(visual_of));
    let parts = VESSEL.parts(steel).into_iter().chain(handles).collect();
    BodySpec { visuals, ..movable("pot", parts, region, BIMANUAL_TABLE_Z) }
}

/// Creates a handle: a bar along x with two stems.
fn handle(side: f64, appearance: AppearanceSpec) -> [PartSpec; 3] {
    let rod = |half_height, position: [f64; 3], axis| {
        let turned = UnitQuaternion::from_axis_angle(&axis, FRAC_PI_2);
        let pose = Isometry3::from_parts(Translation3::from(position), turned);
        PartSpec { shape: Primitive::Capsule { radius: BAR_RADIUS, half_height }, pose, appearance }
    };
    let stem_half_length = (BAR_OFFSET - VESSEL.radii[1] + VESSEL.thickness) / 2.0;
    let stem =
        |x| rod(stem_half_length, [x, side * (BAR_OFFSET - stem_half_length), BAR_Z], Vector3::x_axis());
    [
        rod(BAR_HALF_LENGTH, [0.0, side * BAR_OFFSET, BAR_Z], Vector3::y_axis()),
        stem(-BAR_HALF_LENGTH),
        stem(BAR_HALF_LENGTH),
    ]
}

/// Distance of the pre-grasp poses from the handles, in m.
const APPROACH: f64 = 0.1;

/// Returns the grasp poses of both arms at the handles: level, with the fingers closing from above and below
/// in the direction nearest to their start.
pub(in crate::tasks) fn grasps(scene: &Scene) -> [Isometry3<f64>; 2] {
    let pot = scene.body("pot");
    [0, 1].map(|arm| {
        let side = [-1.0, 1.0][arm];
        let bar = pot.pose * Point3::from(Vector3::new(0.0, side * BAR_OFFSET, BAR_Z) * pot.scale.x);
        let inwards = pot.pose.rotation * Vector3::y() * -side;
        let closing = grasp::closest_closing(Vector3::z(), &grasp::start_closing(scene, arm));
        grasp::pose(&bar.coords, &inwards, &closing)
    })
}

/// Returns the pre-grasp pose of a grasp pose.
pub(in crate::tasks) fn pre_grasp(grasp: &Isometry3<f64>) -> Isometry3<f64> {
    grasp::retreated(grasp, APPROACH)
}

/// Plans to move from the pre-grasp poses to the grasp poses and close both grippers.
pub(in crate::tasks) fn grasp_both(grasps: &[Isometry3<f64>; 2]) -> [Move; 3] {
    [Move::Straight(both_arms(*grasps)), Move::close(&[0], 10), Move::close(&[1], 10)]
}
