//! The book of PlaceBookInShelf. Lengths in m.
//!
//! Its origin is the benchmark's, outside the book's centre. Its axes are parallel to its edges: x from the
//! spine to the fore edge, y across the pages, z up the spine. The benchmark's axes are oblique to them.

use crate::tasks::common::{box_part, srgb};
use scene::{AppearanceSpec, Mass, PartSpec, Primitive, VisualShape, VisualSpec};

/// Half-depth, half-thickness and half-height as it collides.
pub(crate) const HALF: [f64; 3] = [0.04955, 0.02675, 0.05565];
/// Centre in the body's frame. Standing upright, the book has its origin 0.0737 above its support.
pub(crate) const CENTRE: [f64; 3] = [-0.0452, -0.0146, -0.01805];
/// Mass properties of the benchmark's collision hulls.
pub(crate) const MASS: Mass =
    Mass::Measured { kg: 0.563, centre: CENTRE, inertia: [7.0e-4, 10.2e-4, 5.7e-4] };

/// Creates the collision shape.
pub(crate) fn parts() -> Vec<PartSpec> {
    vec![box_part(HALF, CENTRE, AppearanceSpec::plain(COVER_COLOR))]
}

/// Half-extents as seen.
const VISIBLE_HALF: [f64; 3] = [0.04815, 0.025, 0.05425];
/// Thickness of the cover.
const COVER: f64 = 0.003;
const COVER_COLOR: [f64; 3] = srgb([13, 13, 15]);
/// Distance by which the pages are recessed from the cover.
const PAGE_INSET: f64 = 0.003;
/// Number of groups of pages that are coloured independently.
const N_SHEETS: u32 = 10;

/// Creates the visuals: a dark cover around groups of pale pages.
pub(crate) fn visuals() -> Vec<VisualSpec> {
    let [hx, hy, hz] = VISIBLE_HALF;
    let (spine, board) = (COVER - hx, hy - COVER);
    let outline = vec![
        [spine, -hy],
        [hx, -hy],
        [hx, -board],
        [spine, -board],
        [spine, board],
        [hx, board],
        [hx, hy],
        [spine, hy],
        [-hx, board],
        [-hx, -board],
    ];
    let cover = VisualShape::Extrusion { outline, holes: Vec::new(), half_height: hz };
    let mut visuals = vec![VisualSpec::at(cover, CENTRE, AppearanceSpec::plain(COVER_COLOR))];
    let half_sheet = board / f64::from(N_SHEETS);
    visuals.extend((0..N_SHEETS).map(|i| {
        let y = half_sheet * f64::from(2 * i + 1) - board;
        let half = [hx - (COVER + PAGE_INSET) / 2.0, half_sheet, hz - PAGE_INSET];
        let position = [CENTRE[0] + (COVER - PAGE_INSET) / 2.0, CENTRE[1] + y, CENTRE[2]];
        let paper = AppearanceSpec::plain(srgb([237, 230, 204]));
        VisualSpec::at(VisualShape::Primitive(Primitive::Box { half }), position, paper)
    }));
    visuals
}
