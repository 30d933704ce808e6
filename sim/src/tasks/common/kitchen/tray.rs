//! The tray of DualArmLiftTray and DualArmPourPot. See docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::tasks::common::{BIMANUAL_TABLE_Z, box_part, movable, rgb};
use scene::{
    AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, RenderParts, ScaleAxes, VisualShape, VisualSpec,
    rounded_rectangle,
};

/// Half-extents along x and y in m. The long side runs from arm to arm.
const HALF: [f64; 2] = [0.1354, 0.1975];
/// Radius of the corners, in m.
const CORNER_RADIUS: f64 = 0.03;
/// Height of the walls' lower and upper edges above the origin, in m.
const WALL_Z: [f64; 2] = [-0.0026, 0.0432];
/// Height of the lower and upper face of the floor above the origin, in m.
const FLOOR_Z: [f64; 2] = [-0.0012, 0.0097];
/// Thickness of the walls on the long sides, on the short sides and at the corners, in m.
const THICKNESS: [f64; 3] = [0.0124, 0.0105, 0.0115];

/// Distance of the middle of the short walls from the tray's centre, in m.
pub(crate) const RIM_Y: f64 = HALF[1] - THICKNESS[1] / 2.0;
/// Height of the walls above the origin, in m.
pub(crate) const RIM_Z: f64 = WALL_Z[1];

const GREY: [f64; 3] = rgb([48, 49, 51]);

/// Creates the tray on the bimanual table. Its frame has z up, whereas the benchmark's has y up: y and z here
/// are its x and y. Mass, centre and moments of inertia are those of the benchmark's collision shapes, whose
/// walls and floor are thicker than the visible ones.
pub(crate) fn tray(region: usize) -> BodySpec {
    let appearance = AppearanceSpec::plain(GREY);
    let [hx, hy] = HALF;
    let (floor_half, floor_z) = ((FLOOR_Z[1] - FLOOR_Z[0]) / 2.0, f64::midpoint(FLOOR_Z[0], FLOOR_Z[1]));
    let mut parts = vec![box_part([hx - 0.009, hy - 0.009, floor_half], [0.0, 0.0, floor_z], appearance)];
    parts.extend((0..4_u32).flat_map(|quarter| walls(quarter, appearance)));
    BodySpec {
        visuals: visuals(appearance),
        render_parts: RenderParts::Single,
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured {
            kg: 1.802,
            centre: [-0.0024, 0.0014, 0.0106],
            inertia: [0.0275, 0.0142, 0.0413],
        },
        ..movable("tray", parts, region, BIMANUAL_TABLE_Z)
    }
}

/// Creates the wall that faces +x turned by a number of quarters about z, and the corner next to it. The
/// outline is an octagon that touches the rounded corners in their middle.
fn walls(quarter: u32, appearance: AppearanceSpec) -> [PartSpec; 2] {
    let side = quarter as usize % 2;
    let [out, along] = [HALF[side], HALF[1 - side]];
    // Half the side of the regular octagon around the corners' circle.
    let facet = CORNER_RADIUS * libm::tan(FRAC_PI_4 / 2.0);
    let [low, high] = WALL_Z;
    let about_z = |angle| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
    let turned = about_z(f64::from(quarter) * FRAC_PI_2);
    let standing = |thickness: f64, half_length, face: Vector3<f64>, outward: Vector3<f64>, angle| {
        let centre = face - outward * (thickness / 2.0) + Vector3::z() * f64::midpoint(low, high);
        PartSpec {
            shape: Primitive::Box { half: [thickness / 2.0, half_length, (high - low) / 2.0] },
            pose: Isometry3::from_parts((turned * centre).into(), turned * about_z(angle)),
            appearance,
        }
    };
    let diagonal = about_z(FRAC_PI_4) * Vector3::x();
    let corner = Vector3::new(out - CORNER_RADIUS, along - CORNER_RADIUS, 0.0) + diagonal * CORNER_RADIUS;
    [
        standing(THICKNESS[side], along - CORNER_RADIUS + facet, Vector3::x() * out, Vector3::x(), 0.0),
        standing(THICKNESS[2], facet, corner, diagonal, FRAC_PI_4),
    ]
}

/// Distance by which the visible tray lies inside its collision shapes, in m.
const INSET: f64 = 0.001;
/// Thickness of the visible walls and of the visible floor, in m.
const VISIBLE_THICKNESS: [f64; 2] = [0.004, 0.003];
/// Half-extents of the slots in the short walls, along the wall and vertically, in m.
const SLOT_HALF: [f64; 2] = [0.042, 0.006];

/// Creates the visuals: the floor, the long walls with the corners, and the short walls, each with a slot.
fn visuals(appearance: AppearanceSpec) -> Vec<VisualSpec> {
    let [hx, hy] = HALF.map(|half| half - INSET);
    let [low, high] = [WALL_Z[0] + INSET, WALL_Z[1] - INSET];
    let [wall, floor] = VISIBLE_THICKNESS;
    let (half_height, middle) = ((high - low) / 2.0, f64::midpoint(low, high));
    let extrusion = |outline, holes, half_height| VisualShape::Extrusion { outline, holes, half_height };
    let rectangle = |x: f64, y: f64| vec![[-x, -y], [x, -y], [x, y], [-x, y]];
    let side = |sign: f64| {
        let inset = |by: f64| {
            let outline = rounded_rectangle([hx - by, hy - by], CORNER_RADIUS - by);
            let mut half: Vec<_> = outline.into_iter().filter(|[x, _]| *x > 0.0).collect();
            half.sort_by(|a, b| a[1].total_cmp(&b[1]));
            half
        };
        let outline = inset(0.0).into_iter().chain(inset(wall).into_iter().rev());
        let outline = outline.map(|[x, y]| [x * sign, y]).collect();
        VisualSpec::at(extrusion(outline, Vec::new(), half_height), [0.0, 0.0, middle], appearance)
    };
    let end = |sign: f64| {
        let plate = rectangle(hx - CORNER_RADIUS, half_height);
        let slot = rounded_rectangle(SLOT_HALF, 0.9 * SLOT_HALF[1]);
        let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        let at = Translation3::new(0.0, sign * (hy - wall / 2.0), middle);
        let shape = extrusion(plate, vec![slot], wall / 2.0);
        VisualSpec { shape, pose: Isometry3::from_parts(at, upright), appearance }
    };
    let outline = rounded_rectangle([hx - wall / 2.0, hy - wall / 2.0], CORNER_RADIUS - wall / 2.0);
    let floor = VisualSpec::at(
        extrusion(outline, Vec::new(), floor / 2.0),
        [0.0, 0.0, low + floor / 2.0],
        appearance,
    );
    vec![floor, side(-1.0), side(1.0), end(-1.0), end(1.0)]
}
