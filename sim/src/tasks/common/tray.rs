//! The tray of two tasks (spec/tasks.md §1 and §3, tasks 20 and 22).

use super::{BIMANUAL_TABLE_Z, box_part, movable, rgb};
use crate::scene::{AppearanceSpec, BodySpec, VisualShape, VisualSpec, rounded_rectangle};

/// Half of 0.388 × 0.264 m; the long side lies along the body's y, from arm to arm.
pub(in crate::tasks) const HALF: [f64; 2] = [0.132, 0.194];
/// Height of the rim, in m.
pub(in crate::tasks) const HEIGHT: f64 = 0.041;
/// Half the thickness of the rim, in m.
pub(in crate::tasks) const RIM_HALF_THICKNESS: f64 = 0.004;
const FLOOR_HALF_THICKNESS: f64 = 0.003;
const GREY: [f64; 3] = rgb([48, 49, 51]);

/// The tray on the bimanual table, its origin in the middle of its lower face.
pub(in crate::tasks) fn tray(region: usize) -> BodySpec {
    let slab = |half, position| box_part(half, position, AppearanceSpec::plain(GREY));
    let [hx, hy] = HALF;
    let (floor, rim, rim_z) = (FLOOR_HALF_THICKNESS, RIM_HALF_THICKNESS, HEIGHT / 2.0);
    let parts = vec![
        slab([hx, hy, floor], [0.0, 0.0, floor]),
        slab([rim, hy, rim_z], [hx - rim, 0.0, rim_z]),
        slab([rim, hy, rim_z], [rim - hx, 0.0, rim_z]),
        slab([hx, rim, rim_z], [0.0, hy - rim, rim_z]),
        slab([hx, rim, rim_z], [0.0, rim - hy, rim_z]),
    ];
    let visuals = visuals(HALF, [floor, rim_z], rim, AppearanceSpec::plain(GREY));
    BodySpec { visuals, ..movable("tray", parts, region, BIMANUAL_TABLE_Z) }
}

/// Radius of a tray's corners as they are seen, in m; they collide as square ones.
const TRAY_CORNER_RADIUS: f64 = 0.022;

/// How a tray of half extents `half` looks that stands on z 0: a rim that runs around rounded corners and, within it, the
/// floor. Half heights are those of floor and rim. In m.
fn visuals(
    half: [f64; 2],
    half_heights: [f64; 2],
    rim_half_thickness: f64,
    appearance: AppearanceSpec,
) -> Vec<VisualSpec> {
    let inset = |by: f64| rounded_rectangle(half.map(|half| half - by), TRAY_CORNER_RADIUS - by);
    let standing = |outline, holes, half_height| {
        VisualSpec::at(
            VisualShape::Extrusion { outline, holes, half_height },
            [0.0, 0.0, half_height],
            appearance,
        )
    };
    let [floor, rim] = half_heights;
    vec![
        standing(inset(0.0), vec![inset(2.0 * rim_half_thickness)], rim),
        standing(inset(rim_half_thickness), Vec::new(), floor),
    ]
}
