//! Household objects of several tasks: a can, a bottle, a book and a bookcase. Lengths in m.

use core::f64::consts::{FRAC_PI_4, SQRT_2};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::{box_part, rgb};
use crate::scene::{AppearanceSpec, PartSpec, Primitive, Texture, VisualShape, VisualSpec};

/// Specular strength of shiny surfaces.
const GLOSS: f64 = 0.6;

const fn glossy(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: GLOSS, ..AppearanceSpec::plain(color) }
}

/// Builder of the visuals of an object with rotational symmetry about a vertical axis.
struct RevolvedVisuals {
    /// Position in the body's frame from which heights are measured.
    foot: [f64; 3],
    visuals: Vec<VisualSpec>,
}

impl RevolvedVisuals {
    fn on(foot: [f64; 3]) -> Self {
        Self { foot, visuals: Vec::new() }
    }

    /// Adds a surface of revolution with this profile, the outside to its right.
    fn with<const N: usize>(
        mut self,
        radii: [f64; N],
        heights: [f64; N],
        appearance: AppearanceSpec,
    ) -> Self {
        let profile = (0..N).map(|i| [radii[i], heights[i]]).collect();
        self.visuals.push(VisualSpec::at(VisualShape::Lathe { profile }, self.foot, appearance));
        self
    }

    /// Adds a cylinder between two heights.
    fn with_drum(self, radius: f64, [min, max]: [f64; 2], appearance: AppearanceSpec) -> Self {
        self.with([0.0, radius, radius, 0.0], [min, min, max, max], appearance)
    }
}

/// Distance by which a label protrudes in m, so that it covers what is below it.
const LABEL_THICKNESS: f64 = 0.0003;

/// Creates the visuals of a soda can of radius `r` standing on `foot`: red with a white band. Base, shoulder,
/// rim and the recessed lid are aluminium.
pub(in crate::tasks) fn can(r: f64, height: f64, foot: [f64; 3]) -> Vec<VisualSpec> {
    let aluminium =
        AppearanceSpec { specular: 0.8, ..AppearanceSpec::textured(Texture::BrushedMetal, [0.8; 3]) };
    let [inside, rim] = [0.7 * r, 0.76 * r];
    let radii = [0.0, inside, r - 0.001, r - 0.001, rim, rim, inside, inside, 0.0];
    let heights =
        [0.0, 0.0, 0.011, height - 0.014, height - 0.003, height, height, height - 0.005, height - 0.005];
    RevolvedVisuals::on(foot)
        .with(radii, heights, aluminium)
        .with_drum(r, [0.01, height - 0.013], glossy([0.72, 0.04, 0.07]))
        .with_drum(r + LABEL_THICKNESS, [0.4 * height, 0.6 * height], glossy([0.92; 3]))
        .visuals
}

/// Radius and upper z of a bottle's body, shoulder, and neck with its cap.
const BOTTLE: [[f64; 2]; 3] = [[0.03, 0.175], [0.022, 0.213], [0.0155, 0.25]];
/// Sum of the volumes of the boxes of a bottle's prism relative to their union. The density of a bottle must
/// be divided by it.
pub(in crate::tasks) const PRISM_OVERLAP: f64 = 2.0;

/// Creates the collision shapes of a bottle standing at the given position. Its body is an octagonal prism
/// made of four boxes: finger pads touch a cylinder along two lines only, and it rotates between them when it
/// is carried fast.
pub(in crate::tasks) fn bottle_parts([x, y, z]: [f64; 3]) -> Vec<PartSpec> {
    let [[radius, body_z], [shoulder_radius, shoulder_z], [neck_radius, neck_z]] = BOTTLE;
    let appearance = AppearanceSpec::plain([1.0; 3]);
    // tan 22.5° = √2 − 1.
    let half = [radius, radius * (SQRT_2 - 1.0), body_z / 2.0];
    let side = |eighths: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), eighths * FRAC_PI_4);
        let pose = Isometry3::from_parts(Translation3::new(x, y, z + body_z / 2.0), turn);
        PartSpec { shape: Primitive::Box { half }, pose, appearance }
    };
    let cylinder = |radius, [min_z, max_z]: [f64; 2]| {
        let solid = Primitive::Cylinder { radius, half_height: (max_z - min_z) / 2.0 };
        PartSpec::at(solid, [x, y, z + (max_z + min_z) / 2.0], appearance)
    };
    let upper =
        [cylinder(shoulder_radius, [body_z, shoulder_z]), cylinder(neck_radius, [shoulder_z, neck_z])];
    [0.0, 1.0, 2.0, 3.0].map(side).into_iter().chain(upper).collect()
}

/// Creates the visuals of a bottle standing on `foot`: a grooved body, a label and a screw cap.
pub(in crate::tasks) fn bottle(foot: [f64; 3]) -> Vec<VisualSpec> {
    let radii = [
        0.0, 0.026, 0.029, 0.03, 0.03, 0.0285, 0.03, 0.03, 0.0285, 0.03, 0.03, 0.0285, 0.025, 0.018, 0.0135,
        0.0135, 0.0,
    ];
    let heights = [
        0.0, 0.0, 0.002, 0.006, 0.026, 0.03, 0.034, 0.064, 0.068, 0.072, 0.175, 0.189, 0.203, 0.217, 0.225,
        0.232, 0.232,
    ];
    let [[body_radius, _], _, [cap_radius, top]] = BOTTLE;
    let cap_radii = [0.0, cap_radius, cap_radius, cap_radius - 0.001, 0.0];
    RevolvedVisuals::on(foot)
        .with(radii, heights, glossy([0.62, 0.82, 0.90]))
        .with_drum(body_radius + LABEL_THICKNESS, [0.09, 0.16], AppearanceSpec::plain([0.12, 0.32, 0.66]))
        .with(cap_radii, [0.232, 0.232, top - 0.001, top, top], glossy([0.86, 0.88, 0.90]))
        .visuals
}

/// Thickness of a book's cover, in m.
const COVER: f64 = 0.002;
/// Distance by which a book's pages are recessed from its cover, in m.
const PAGE_INSET: f64 = 0.003;

/// Creates the visuals of a book with half-extents `half` (depth, thickness, height) centred at `centre`. Its
/// spine is at −x and has a title.
pub(in crate::tasks) fn book(half: [f64; 3], centre: [f64; 3], color: [f64; 3]) -> Vec<VisualSpec> {
    let [hx, hy, hz] = half;
    let rounded = |half, [x, y, z]: [f64; 3], edge_radius, color| {
        let position = [centre[0] + x, centre[1] + y, centre[2] + z];
        VisualSpec::at(VisualShape::RoundedBox { half, edge_radius }, position, AppearanceSpec::plain(color))
    };
    let cover = |y| rounded([hx, COVER / 2.0, hz], [0.0, y, 0.0], COVER / 4.0, color);
    vec![
        cover(hy - COVER / 2.0),
        cover(COVER / 2.0 - hy),
        rounded([COVER, hy, hz], [COVER - hx, 0.0, 0.0], COVER / 2.0, color),
        rounded(
            [hx - PAGE_INSET, hy - COVER, hz - PAGE_INSET],
            [0.0; 3],
            LABEL_THICKNESS,
            [0.93, 0.90, 0.80],
        ),
        rounded(
            [LABEL_THICKNESS, 0.7 * hy, 0.17 * hz],
            [-hx, 0.0, 0.5 * hz],
            LABEL_THICKNESS / 2.0,
            [0.85, 0.68, 0.25],
        ),
    ]
}

/// Half-thickness of a bookcase's panels.
const PANEL: f64 = 0.007;

/// A bookcase that is open towards −x.
pub(in crate::tasks) struct Bookcase<const N: usize> {
    /// Half-depth and half-width.
    pub(in crate::tasks) half: [f64; 2],
    /// Overall height, top panel included.
    pub(in crate::tasks) height: f64,
    /// Centre (x, y) in the body's frame.
    pub(in crate::tasks) centre: [f64; 2],
    /// Heights of the shelves' upper faces, the lowest first.
    pub(in crate::tasks) shelves_z: [f64; N],
}

impl<const N: usize> Bookcase<N> {
    /// Creates the sides, back, top, shelves and the plinth under the lowest shelf.
    pub(in crate::tasks) fn parts(&self) -> Vec<PartSpec> {
        let wood = AppearanceSpec::textured(Texture::Wood, [0.50, 0.34, 0.20]);
        let ([hx, hy], [mx, my]) = (self.half, self.centre);
        let panel = |[half_x, half_y]: [f64; 2], [x, y]: [f64; 2], [min_z, max_z]: [f64; 2]| {
            let half = [half_x, half_y, (max_z - min_z) / 2.0];
            box_part(half, [mx + x, my + y, (max_z + min_z) / 2.0], wood)
        };
        let side = |y| panel([hx, PANEL], [0.0, y], [0.0, self.height]);
        let between = |half_x, x, z| panel([half_x, hy - 2.0 * PANEL], [x, 0.0], z);
        let shelf = |top_z| between(hx - PANEL, -PANEL, [top_z - 2.0 * PANEL, top_z]);
        let mut parts = vec![
            side(PANEL - hy),
            side(hy - PANEL),
            between(PANEL, hx - PANEL, [0.0, self.height]),
            shelf(self.height),
            between(PANEL, 2.0 * PANEL - hx, [0.0, self.shelves_z[0] - 2.0 * PANEL]),
        ];
        parts.extend(self.shelves_z.map(shelf));
        parts
    }

    /// Creates five books of the given half-depth, side by side on a shelf starting at the +y side. The first
    /// `rotation` books are moved to the end of the row.
    pub(in crate::tasks) fn row(&self, shelf: usize, half_depth: f64, rotation: usize) -> Vec<PartSpec> {
        let mut y = self.centre[1] + self.half[1] - 2.0 * PANEL;
        let mut books = BOOKS;
        books.rotate_left(rotation);
        let stand = |(thickness, height, color): (f64, f64, [u8; 3])| {
            y -= thickness;
            let half = [half_depth, thickness / 2.0, height / 2.0];
            let position = [self.centre[0], y + thickness / 2.0, self.shelves_z[shelf] + height / 2.0];
            box_part(half, position, AppearanceSpec::plain(rgb(color)))
        };
        books.map(stand).to_vec()
    }
}

/// Thickness, height and colour of the books in a row.
const BOOKS: [(f64, f64, [u8; 3]); 5] = [
    (0.024, 0.150, [150, 44, 38]),
    (0.032, 0.132, [214, 178, 92]),
    (0.018, 0.144, [56, 98, 74]),
    (0.030, 0.156, [92, 58, 98]),
    (0.026, 0.138, [206, 110, 50]),
];
