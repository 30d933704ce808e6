//! The hammer and nail of HammerNail and the dustpan and banana of ScoopBanana. See docs/benchmark.md,
//! "Scenes and objects".

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, UnitVector3, Vector3};

use super::{SINGLE_TABLE_Z, box_part, movable, rgb, visual_of};
use crate::scene::{
    AppearanceSpec, BodySpec, JointKind, JointSpec, Mass, Motion, PartSpec, Primitive, Role, ScaledBy,
    Texture, VisualShape, VisualSpec,
};

/// Centre (x, y) of the hammer's face in its own frame, in m. The face points along −y.
pub(in crate::tasks) const HAMMER_FACE: [f64; 2] = [0.147, -0.065];
/// Half-length of the nail, in m.
pub(in crate::tasks) const NAIL_HALF_LENGTH: f64 = 0.043;
/// Radius of the nail's head, in m.
pub(in crate::tasks) const NAIL_HEAD_RADIUS: f64 = 0.009;

/// Creates a claw hammer that lies on the table, its handle along x and its head along y at the far end; 0.33
/// × 0.13 × 0.035 m overall.
pub(in crate::tasks) fn hammer(region: usize) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.7, ..AppearanceSpec::plain(rgb([120, 124, 130])) };
    let wood = AppearanceSpec::textured(Texture::Wood, rgb([170, 95, 50]));
    let thick = 0.0175;
    let [head_x, face_y] = HAMMER_FACE;
    let poll_half = 0.023;
    let poll = Primitive::Cylinder { radius: 0.0165, half_height: poll_half };
    let poll_pose = rotated_at([head_x, face_y + poll_half, 0.0], Vector3::x_axis(), FRAC_PI_2);
    let rounded = |half, position, appearance| {
        VisualSpec::at(VisualShape::RoundedBox { half, edge_radius: 0.006 }, position, appearance)
    };
    // The poll narrows behind the face, which is at +z in the profile's frame.
    let poll_profile = [
        [0.0, -poll_half],
        [0.011, -poll_half],
        [0.011, 0.004],
        [0.0165, 0.010],
        [0.0165, 0.021],
        [0.0145, poll_half],
        [0.0, poll_half],
    ];
    let claw_outline = [
        [0.160, 0.017],
        [0.163, 0.036],
        [0.152, 0.053],
        [0.130, 0.065],
        [0.128, 0.063],
        [0.140, 0.046],
        [0.137, 0.017],
    ];
    let claw =
        VisualShape::Extrusion { outline: claw_outline.to_vec(), holes: Vec::new(), half_height: 0.0125 };
    BodySpec {
        visuals: vec![
            rounded([0.0725, 0.013, thick], [-0.0925, 0.0, 0.0], wood),
            rounded([0.085, 0.0125, 0.0125], [0.055, 0.0, 0.0], wood),
            rounded([0.018, 0.019, thick], [head_x, 0.0, 0.0], steel),
            VisualSpec {
                shape: VisualShape::Lathe { profile: poll_profile.to_vec() },
                pose: poll_pose,
                appearance: steel,
            },
            VisualSpec::at(claw, [0.0; 3], steel),
        ],
        mass: Mass::Density(2000.0),
        friction: 2.0,
        damping: [10.0, 12.0],
        ..movable(
            "hammer",
            vec![
                box_part([0.0725, 0.013, thick], [-0.0925, 0.0, 0.0], wood),
                box_part([0.0745, 0.0125, 0.0125], [0.0545, 0.0, 0.0], wood),
                box_part([0.018, 0.019, thick], [head_x, 0.0, 0.0], steel),
                PartSpec { shape: poll, pose: poll_pose, appearance: steel },
                box_part([0.012, 0.023, 0.0125], [head_x, 0.042, 0.0], steel),
            ],
            region,
            SINGLE_TABLE_Z,
        )
    }
}

/// Creates a nail that slides along its own z axis, tip first, and stays where it is driven. It lies along y
/// with its tip towards −y and its lowest point at `lowest_z_m`.
pub(in crate::tasks) fn nail(region: usize, lowest_z_m: f64) -> BodySpec {
    let (half, shank, head) = (NAIL_HALF_LENGTH, 0.003, NAIL_HEAD_RADIUS);
    let steel = AppearanceSpec { specular: 0.7, ..AppearanceSpec::plain([0.75; 3]) };
    let head_half = 0.002;
    let cylinder = |radius, half_height, z| {
        PartSpec::at(Primitive::Cylinder { radius, half_height }, [0.0, 0.0, z], steel)
    };
    let profile = vec![
        [0.0, -half],
        [head, -half],
        [head, 2.0 * head_half - half],
        [shank, 2.0 * head_half - half],
        [shank, half - 0.012],
        [0.0, half],
    ];
    let guide = JointSpec {
        kind: JointKind::Slide,
        axis: [0.0, 0.0, 1.0],
        upper: 0.035,
        damping: 20.0,
        friction: 2.0,
    };
    BodySpec {
        role: Role::Fixture,
        motion: Motion::Jointed(guide),
        scaled_by: ScaledBy::Nothing("it fits its hole"),
        visuals: vec![VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], steel)],
        mass: Mass::Density(5000.0),
        friction: 2.0,
        ..movable(
            "nail",
            vec![cylinder(shank, half, 0.0), cylinder(head, head_half, head_half - half)],
            region,
            lowest_z_m,
        )
        .with_orientation(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2))
    }
}

/// x of the dustpan's mouth in its own frame, in m.
pub(in crate::tasks) const DUSTPAN_MOUTH_X: f64 = 0.10;
/// Grasp position at the dustpan's handle in its own frame, in m.
pub(in crate::tasks) const DUSTPAN_GRIP: [f64; 3] = [-0.05, 0.0, 0.007];

/// Creates a dustpan that stands on the table, its mouth at +x and its handle pointing backwards and up; 0.2
/// × 0.173 × 0.058 m overall.
pub(in crate::tasks) fn dustpan(region: usize) -> BodySpec {
    let blue = AppearanceSpec::plain(rgb([40, 90, 170]));
    let [back, half_width, half_height] = [-0.02, 0.0865, 0.029];
    let half_thickness = 0.002;
    // A box given by its x range, its centre and half-width along y, and its height above the table.
    let standing = |x: [f64; 2], y: f64, half_y: f64, height: f64| {
        let position = [(x[0] + x[1]) / 2.0, y, height / 2.0 - half_height];
        box_part([(x[1] - x[0]) / 2.0, half_y, height / 2.0], position, blue)
    };
    let floor = standing([back, DUSTPAN_MOUTH_X], 0.0, half_width, 0.003);
    let back_wall = standing([back, back + 2.0 * half_thickness], 0.0, half_width, 0.04);
    let sides = [half_thickness - half_width, half_width - half_thickness];
    // The sloping side walls are approximated by two steps for collision.
    let side_walls = sides.into_iter().flat_map(|y| {
        [standing([back, 0.03], y, half_thickness, 0.03), standing([0.03, 0.08], y, half_thickness, 0.012)]
    });
    let handle_half = [0.040, 0.0125, 0.010];
    let handle_pose = rotated_at([-0.0587, 0.0, 0.0094], Vector3::y_axis(), 0.25);
    let handle =
        PartSpec { shape: Primitive::Box { half: handle_half }, pose: handle_pose, appearance: blue };
    let slope = vec![[back, 0.0], [DUSTPAN_MOUTH_X, 0.0], [DUSTPAN_MOUTH_X, 0.004], [back, 0.04]];
    let slope = VisualShape::Extrusion { outline: slope, holes: Vec::new(), half_height: half_thickness };
    let mut visuals = vec![visual_of(&floor), visual_of(&back_wall)];
    visuals.push(VisualSpec {
        shape: VisualShape::RoundedBox { half: handle_half, edge_radius: 0.006 },
        pose: handle_pose,
        appearance: blue,
    });
    visuals.extend(sides.map(|y| VisualSpec {
        shape: slope.clone(),
        pose: rotated_at([0.0, y, -half_height], Vector3::x_axis(), FRAC_PI_2),
        appearance: blue,
    }));
    let parts = [floor, back_wall, handle].into_iter().chain(side_walls).collect();
    BodySpec { visuals, ..movable("dustpan", parts, region, SINGLE_TABLE_Z) }
}

/// Radius at the middle of the banana, in m.
pub(in crate::tasks) const BANANA_RADIUS: f64 = 0.0175;

/// Creates a banana that lies on the table along y, 0.18 m long including its curvature, its ends towards −x.
pub(in crate::tasks) fn banana(region: usize) -> BodySpec {
    let yellow = AppearanceSpec::plain(rgb([250, 215, 50]));
    let segments = |n: u32| {
        let t = move |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
        (0..n).map(move |i| banana_segment(t(i), t(i + 1)))
    };
    let parts = segments(6).map(|(shape, pose)| PartSpec { shape, pose, appearance: yellow });
    let visuals = segments(14).map(|(shape, pose)| VisualSpec {
        shape: VisualShape::Primitive(shape),
        pose,
        appearance: yellow,
    });
    BodySpec { visuals: visuals.collect(), ..movable("banana", parts.collect(), region, SINGLE_TABLE_Z) }
}

/// Returns the capsule between two curve parameters, where −1 and 1 are the banana's ends.
fn banana_segment(from: f64, to: f64) -> (Primitive, Isometry3<f64>) {
    // Half of the length of the centre line, which is a parabola, in m.
    const HALF_LENGTH: f64 = 0.075;
    /// Sagitta of the centre line, in m.
    const SAGITTA: f64 = 0.027;
    /// Radius at the ends, in m.
    const END_RADIUS: f64 = 0.009;
    let along = (from + to) / 2.0;
    let radius = BANANA_RADIUS + (END_RADIUS - BANANA_RADIUS) * along * along * along * along;
    // The thin ends rest on the table too.
    let centre_line =
        |at: f64| Vector3::new(SAGITTA * (0.5 - at * at), HALF_LENGTH * at, radius - BANANA_RADIUS);
    let offset = centre_line(to) - centre_line(from);
    let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &offset)
        .expect("no segment of the banana points down");
    let shape = Primitive::Capsule { radius, half_height: offset.norm() / 2.0 };
    (shape, Isometry3::from_parts(((centre_line(from) + centre_line(to)) / 2.0).into(), rotation))
}

/// Returns the pose at a position (m), rotated by an angle (rad) about an axis.
fn rotated_at(position: [f64; 3], axis: UnitVector3<f64>, angle: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(position), UnitQuaternion::from_axis_angle(&axis, angle))
}
