//! The hammer and nail of HammerNail and the dustpan and banana of ScoopBanana. See docs/benchmark.md,
//! "Scenes and objects".

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, UnitVector3, Vector3};

use crate::tasks::common::{SINGLE_TABLE_Z, box_part, movable, srgb};
use scene::{
    AppearanceSpec, BodySpec, JointKind, JointSpec, Mass, Motion, PartSpec, Primitive, Range, RenderParts,
    Role, ScaleAxes, ScaledBy, Texture, VisualShape, VisualSpec, rounded_rectangle,
};

/// Centre (x, y) of the hammer's face in its own frame, in m. The face points along −y.
pub(crate) const HAMMER_FACE: [f64; 2] = [0.147, -0.065];
/// Height of the hammer's centre plane above the table while it lies flat, in m.
pub(crate) const HAMMER_HALF_THICKNESS: f64 = 0.0175;
/// Half-length of the nail, in m.
pub(crate) const NAIL_HALF_LENGTH: f64 = 0.043;
/// Radius of the nail's head, in m.
pub(crate) const NAIL_HEAD_RADIUS: f64 = 0.0057;
/// Friction coefficients of the hammer and of the nail and its block: the benchmark's static ones. Its
/// dynamic ones are 2.0.
const HAMMER_FRICTION: f64 = 3.0;
pub(crate) const NAIL_FRICTION: f64 = 2.5;

/// Creates a claw hammer that lies on the table, its handle along x and its head along y at the far end; 0.33
/// × 0.13 × 0.035 m overall. It drops 1 mm.
pub(crate) fn hammer(region: usize) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.7, ..AppearanceSpec::plain(srgb([120, 124, 130])) };
    let wood = AppearanceSpec::textured(Texture::Wood, srgb([170, 95, 50]));
    let thick = HAMMER_HALF_THICKNESS;
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
        render_parts: RenderParts::Single,
        mass: Mass::Density(2000.0),
        friction: HAMMER_FRICTION,
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
        .with_origin_z(SINGLE_TABLE_Z + thick + 0.001)
    }
}

/// Creates a nail that slides along its own z axis, tip first, slowed only by damping. It lies along y with
/// its tip towards −y and its lowest point at `lowest_z_m`.
pub(crate) fn nail(region: usize, lowest_z_m: f64) -> BodySpec {
    /// Mass in the simulation, in kg: the minimum. At the benchmark's density the nail weighs 9.3 g.
    const MASS: f64 = 0.025;
    /// Fraction of its speed that the nail loses per second, in 1/s.
    const DAMPING: f64 = 2.0;
    let (half, shank, head) = (NAIL_HALF_LENGTH, 0.0026, NAIL_HEAD_RADIUS);
    let steel = AppearanceSpec { specular: 0.7, ..AppearanceSpec::plain(srgb([191; 3])) };
    let [under_head, tip_base] = [0.0025 - half, 0.0365];
    let cylinder = |radius, [from, to]: [f64; 2]| {
        let shape = Primitive::Cylinder { radius, half_height: (to - from) / 2.0 };
        PartSpec::at(shape, [0.0, 0.0, f64::midpoint(from, to)], steel)
    };
    let tip = PartSpec::at(Primitive::frustum([[shank, tip_base], [0.0005, half]]), [0.0; 3], steel);
    let profile = vec![
        [0.0, -half],
        [head, -half],
        [head, under_head],
        [shank, under_head],
        [shank, tip_base],
        [0.0, half],
    ];
    let guide = JointSpec {
        kind: JointKind::Slide,
        axis: [0.0, 0.0, 1.0],
        // The head stops at the block.
        upper: 0.036,
        damping: DAMPING * MASS,
        friction: 0.0,
    };
    BodySpec {
        role: Role::Fixture,
        motion: Motion::Jointed(guide),
        scaled_by: ScaledBy::Nothing("it fits its hole"),
        visuals: vec![VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], steel)],
        mass: Mass::Measured { kg: MASS, centre: [0.0, 0.0, -0.0085], inertia: [1.6e-5, 1.6e-5, 1.2e-7] },
        friction: NAIL_FRICTION,
        ..movable(
            "nail",
            vec![cylinder(head, [-half, under_head]), cylinder(shank, [under_head, tip_base]), tip],
            region,
            lowest_z_m,
        )
        .with_orientation(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2))
    }
}

/// x of the dustpan's mouth in its own frame, in m.
pub(crate) const DUSTPAN_MOUTH_X: f64 = 0.1005;
/// Grasp position at the dustpan's handle in its own frame, in m.
pub(crate) const DUSTPAN_GRIP: [f64; 3] = [-0.05, 0.0, 0.015];

/// Creates a dustpan that stands on the table, its mouth towards +x turned by −3.75° and its handle at the
/// back; 0.202 × 0.176 × 0.061 m overall as it collides. The x, y and z axes of its frame are z, x and y of
/// the benchmark's.
pub(crate) fn dustpan(region: usize) -> BodySpec {
    let blue = AppearanceSpec::plain(srgb([40, 90, 170]));
    BodySpec {
        visuals: dustpan_visuals(blue),
        render_parts: RenderParts::Single,
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured {
            kg: 0.386,
            centre: [0.0123, 0.0005, -0.0159],
            inertia: [11.5e-4, 6.2e-4, 16.8e-4],
        },
        ..movable("dustpan", dustpan_parts(blue), region, SINGLE_TABLE_Z)
            .with_yaw(Range::fixed((-3.75_f64).to_radians()))
    }
}

/// Returns the dustpan's collision shapes, which are thicker than it looks: a wedge between two walls and a
/// back, and a handle.
fn dustpan_parts(blue: AppearanceSpec) -> Vec<PartSpec> {
    const BOTTOM: f64 = -0.0311;
    // The solid with this outline in the xz plane, `2 · half_y` wide about `y`.
    let prism = |outline: &[[f64; 2]], half_y: f64, y: f64| {
        let points: Vec<[f64; 3]> = outline.iter().map(|&[x, z]| [x, half_y, z]).collect();
        PartSpec::at(mirrored_hull(&points), [0.0, y, 0.0], blue)
    };
    let lip = DUSTPAN_MOUTH_X;
    let floor = [
        [-0.030, BOTTOM],
        [lip, BOTTOM],
        [lip, -0.0267],
        [0.09, -0.0254],
        [0.05, -0.0207],
        [0.02, -0.018],
        [-0.030, -0.018],
    ];
    let wall = [[-0.0275, BOTTOM], [lip, BOTTOM], [lip, -0.028], [-0.012, 0.021], [-0.0275, 0.021]];
    let root = [[-0.0306, 0.029], [-0.0416, 0.016]].map(|[x, half_y]| {
        let underside = if x < -0.04 { 0.0148 } else { 0.009 };
        [[x, half_y, underside], [x, half_y, 0.025]]
    });
    let handle = [[-0.0416, 0.0155], [-0.0416, 0.0251], [-0.0901, 0.0292], [-0.0901, 0.0240]];
    vec![
        prism(&floor, 0.0767, 0.0),
        prism(&wall, 0.0057, -0.0824),
        prism(&wall, 0.0057, 0.0824),
        box_part([0.0069, 0.088, 0.02705], [-0.0237, 0.0, -0.00405], blue),
        PartSpec::at(mirrored_hull(root.as_flattened()), [0.0; 3], blue),
        prism(&handle, 0.0132, 0.0),
        box_part([0.0057, 0.011, 0.0041], [-0.0958, 0.0, 0.0261], blue),
    ]
}

/// Returns the dustpan as it looks: thin walls, and a handle that ends in a loop.
fn dustpan_visuals(blue: AppearanceSpec) -> Vec<VisualSpec> {
    let extruded = |outline: &[[f64; 2]], half_height| VisualShape::Extrusion {
        outline: outline.to_vec(),
        holes: Vec::new(),
        half_height,
    };
    // An outline in the xz plane, extruded along y.
    let upright = |outline: &[[f64; 2]], half_y: f64, y: f64| VisualSpec {
        shape: extruded(outline, half_y),
        pose: rotated_at([0.0, y, 0.0], Vector3::x_axis(), FRAC_PI_2),
        appearance: blue,
    };
    let floor = [
        [-0.0285, -0.0292],
        [0.0995, -0.0292],
        [0.0995, -0.0278],
        [0.09, -0.0268],
        [0.05, -0.0225],
        [0.02, -0.0200],
        [-0.0285, -0.0200],
    ];
    let wall = [
        [-0.0285, -0.0292],
        [0.0995, -0.0292],
        [0.0995, -0.0285],
        [0.02, 0.0060],
        [-0.010, 0.0185],
        [-0.0285, 0.0185],
    ];
    let root = [[-0.0285, -0.027], [-0.0285, 0.027], [-0.0416, 0.0145], [-0.0416, -0.0145]];
    let handle = [[-0.040, 0.0165], [-0.040, 0.0240], [-0.0890, 0.0285], [-0.0890, 0.0245]];
    let back = VisualShape::RoundedBox { half: [0.0040, 0.0864, 0.0253], edge_radius: 0.003 };
    let end_loop = VisualShape::Extrusion {
        outline: rounded_rectangle([0.0075, 0.0105], 0.005),
        holes: vec![rounded_rectangle([0.0035, 0.0060], 0.003)],
        half_height: 0.0025,
    };
    vec![
        upright(&floor, 0.080, 0.0),
        upright(&wall, 0.0035, -0.0829),
        upright(&wall, 0.0035, 0.0829),
        VisualSpec::at(back, [-0.0245, 0.0, -0.0039], blue),
        VisualSpec::at(extruded(&root, 0.0055), [0.0, 0.0, 0.018], blue),
        upright(&handle, 0.0120, 0.0),
        VisualSpec::at(end_loop, [-0.0925, 0.0, 0.0267], blue),
    ]
}

/// Returns the convex hull of points (m) and of their mirror images in the plane y = 0.
pub(crate) fn mirrored_hull(points: &[[f64; 3]]) -> Primitive {
    Primitive::Hull { points: points.iter().flat_map(|&[x, y, z]| [[x, y, z], [x, -y, z]]).collect() }
}

/// Radius at the middle of the banana, in m.
pub(crate) const BANANA_RADIUS: f64 = 0.0183;

/// Creates a banana that lies on the table, obliquely along y and its ends towards −x, like the YCB banana;
/// 0.109 × 0.178 × 0.037 m overall.
pub(crate) fn banana(region: usize) -> BodySpec {
    let yellow = AppearanceSpec::plain(srgb([250, 215, 50]));
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
    BodySpec {
        visuals: visuals.collect(),
        render_parts: RenderParts::Single,
        ..movable("banana", parts.collect(), region, SINGLE_TABLE_Z)
    }
}

/// Returns the capsule between two curve parameters, where −1 and 1 are the banana's ends.
fn banana_segment(from: f64, to: f64) -> (Primitive, Isometry3<f64>) {
    // Half of the chord of the centre line, which is a parabola, in m.
    const HALF_LENGTH: f64 = 0.084;
    /// Sagitta of the centre line, in m.
    const SAGITTA: f64 = 0.036;
    /// x of the chord, in m: the origin is the middle of the bounding box.
    const CHORD_X: f64 = -0.005;
    /// Angle of the chord to the y axis, in rad.
    const OBLIQUITY: f64 = 0.45;
    /// Radius at the ends, in m.
    const END_RADIUS: f64 = 0.009;
    let along = (from + to) / 2.0;
    let radius = BANANA_RADIUS + (END_RADIUS - BANANA_RADIUS) * along * along * along * along;
    let (sin, cos) = libm::sincos(OBLIQUITY);
    // The thin ends rest on the table too.
    let centre_line = |at: f64| {
        let (bulge, chord) = (SAGITTA * (1.0 - at * at), HALF_LENGTH * at);
        Vector3::new(CHORD_X + cos * bulge + sin * chord, cos * chord - sin * bulge, radius - BANANA_RADIUS)
    };
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
