//! The tray of DualArmLiftTray and DualArmPourPot. See docs/benchmark.md, "Scenes and objects".

use super::{BIMANUAL_TABLE_Z, box_part, movable, rgb};
use crate::scene::{AppearanceSpec, BodySpec, VisualShape, VisualSpec, rounded_rectangle};

/// Half-extents along x and y in m. The long side of the 0.264 × 0.388 m tray runs from arm to arm.
pub(in crate::tasks) const HALF: [f64; 2] = [0.132, 0.194];
/// Height of the rim, in m.
pub(in crate::tasks) const HEIGHT: f64 = 0.041;
/// Half-thickness of the rim, in m.
pub(in crate::tasks) const RIM_HALF_THICKNESS: f64 = 0.004;
/// Half-thickness of the floor, in m.
const FLOOR_HALF_THICKNESS: f64 = 0.003;
const GREY: [f64; 3] = rgb([48, 49, 51]);

/// Creates the tray on the bimanual table. Its origin is the centre of its lower face.
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

/// Radius of the tray's visual corners, in m. Its collision shapes have square corners.
const TRAY_CORNER_RADIUS: f64 = 0.022;

/// Creates the visuals of a tray on z = 0 with half-extents `half`: a rim around rounded corners and the
/// floor inside it. `half_heights` are those of floor and rim, in m.
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
