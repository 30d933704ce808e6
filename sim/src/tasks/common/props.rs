//! Things of every day that tasks handle or use: a can, a bottle, a book and a bookcase. Lengths in m.

use core::f64::consts::{FRAC_PI_4, SQRT_2};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::{box_part, rgb};
use crate::scene::{AppearanceSpec, PartSpec, Primitive, Texture, VisualShape, VisualSpec};

/// Strength of the highlight on what shines.
const GLOSS: f64 = 0.6;

const fn glossy(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: GLOSS, ..AppearanceSpec::plain(color) }
}

/// What turns about a vertical axis.
struct Turned {
    /// Where the heights count from, in the body's frame.
    foot: [f64; 3],
    visuals: Vec<VisualSpec>,
}

impl Turned {
    fn on(foot: [f64; 3]) -> Self {
        Self { foot, visuals: Vec::new() }
    }

    /// With a closed form through points of these radii and heights, the outside to the right of the way.
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

    /// With a drum between two heights.
    fn with_drum(self, radius: f64, [least, greatest]: [f64; 2], appearance: AppearanceSpec) -> Self {
        self.with([0.0, radius, radius, 0.0], [least, least, greatest, greatest], appearance)
    }
}

/// How far a label stands out, in m, so that it hides what is under it.
const LABEL: f64 = 0.0003;

/// A soda can of radius `r` on `foot`: red with a white band; foot, shoulder and rim are aluminium, and so is the lid
/// that is sunk within the rim.
pub(in crate::tasks) fn can(r: f64, height: f64, foot: [f64; 3]) -> Vec<VisualSpec> {
    let aluminium =
        AppearanceSpec { specular: 0.8, ..AppearanceSpec::textured(Texture::BrushedMetal, [0.8; 3]) };
    let [inside, rim] = [0.7 * r, 0.76 * r];
    let radii = [0.0, inside, r - 0.001, r - 0.001, rim, rim, inside, inside, 0.0];
    let heights =
        [0.0, 0.0, 0.011, height - 0.014, height - 0.003, height, height, height - 0.005, height - 0.005];
    Turned::on(foot)
        .with(radii, heights, aluminium)
        .with_drum(r, [0.01, height - 0.013], glossy([0.72, 0.04, 0.07]))
        .with_drum(r + LABEL, [0.4 * height, 0.6 * height], glossy([0.92; 3]))
        .visuals
}

/// Radius and greatest height of a bottle's body, shoulder, and neck with its cap.
const BOTTLE: [[f64; 2]; 3] = [[0.03, 0.175], [0.022, 0.213], [0.0155, 0.25]];
/// How often the boxes of a prism fill it: a body's density is to be divided by this.
pub(in crate::tasks) const PRISM_OVERLAP: f64 = 2.0;

/// A bottle on a foot as it collides. Its body is a prism of eight sides, made of four boxes: two pads hold a cylinder
/// along lines only, and it turns between them when it is carried fast.
pub(in crate::tasks) fn bottle_solids([x, y, z]: [f64; 3]) -> Vec<PartSpec> {
    let [[radius, body_z], [shoulder_radius, shoulder_z], [neck_radius, neck_z]] = BOTTLE;
    let appearance = AppearanceSpec::plain([1.0; 3]);
    // tan 22.5° = √2 − 1.
    let half = [radius, radius * (SQRT_2 - 1.0), body_z / 2.0];
    let side = |eighths: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), eighths * FRAC_PI_4);
        let pose = Isometry3::from_parts(Translation3::new(x, y, z + body_z / 2.0), turn);
        PartSpec { shape: Primitive::Box { half }, pose, appearance }
    };
    let cylinder = |radius, [least_z, greatest_z]: [f64; 2]| {
        let solid = Primitive::Cylinder { radius, half_height: (greatest_z - least_z) / 2.0 };
        PartSpec::at(solid, [x, y, z + (greatest_z + least_z) / 2.0], appearance)
    };
    let upper =
        [cylinder(shoulder_radius, [body_z, shoulder_z]), cylinder(neck_radius, [shoulder_z, neck_z])];
    [0.0, 1.0, 2.0, 3.0].map(side).into_iter().chain(upper).collect()
}

/// A bottle on `foot`: grooves around its body, a label and a screw cap.
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
    Turned::on(foot)
        .with(radii, heights, glossy([0.62, 0.82, 0.90]))
        .with_drum(body_radius + LABEL, [0.09, 0.16], AppearanceSpec::plain([0.12, 0.32, 0.66]))
        .with(cap_radii, [0.232, 0.232, top - 0.001, top, top], glossy([0.86, 0.88, 0.90]))
        .visuals
}

/// Thickness of a book's cover, and how far its pages are set back from it.
const COVER: f64 = 0.002;
const SET_BACK: f64 = 0.003;

/// A book of half extents `half` (depth, thickness, height) around `middle`, its spine at −x with a title on it.
pub(in crate::tasks) fn book(half: [f64; 3], middle: [f64; 3], color: [f64; 3]) -> Vec<VisualSpec> {
    let [hx, hy, hz] = half;
    let rounded = |half, [x, y, z]: [f64; 3], edge_radius, color| {
        let position = [middle[0] + x, middle[1] + y, middle[2] + z];
        VisualSpec::at(VisualShape::RoundedBox { half, edge_radius }, position, AppearanceSpec::plain(color))
    };
    let board = |y| rounded([hx, COVER / 2.0, hz], [0.0, y, 0.0], COVER / 4.0, color);
    vec![
        board(hy - COVER / 2.0),
        board(COVER / 2.0 - hy),
        rounded([COVER, hy, hz], [COVER - hx, 0.0, 0.0], COVER / 2.0, color),
        rounded([hx - SET_BACK, hy - COVER, hz - SET_BACK], [0.0; 3], LABEL, [0.93, 0.90, 0.80]),
        rounded([LABEL, 0.7 * hy, 0.17 * hz], [-hx, 0.0, 0.5 * hz], LABEL / 2.0, [0.85, 0.68, 0.25]),
    ]
}

/// Half the thickness of a bookcase's plates.
const PLATE: f64 = 0.007;

/// A bookcase open towards −x: its half depth and half width, its height, where its middle stands in the body's frame,
/// and the heights of the boards' tops, the lowest first.
pub(in crate::tasks) struct Bookcase<const N: usize> {
    pub(in crate::tasks) half: [f64; 2],
    pub(in crate::tasks) height: f64,
    pub(in crate::tasks) middle: [f64; 2],
    pub(in crate::tasks) boards_z: [f64; N],
}

impl<const N: usize> Bookcase<N> {
    /// Sides, back, top, boards and what is under the lowest one.
    pub(in crate::tasks) fn parts(&self) -> Vec<PartSpec> {
        let wood = AppearanceSpec::textured(Texture::Wood, [0.50, 0.34, 0.20]);
        let ([hx, hy], [mx, my]) = (self.half, self.middle);
        let plate = |[half_x, half_y]: [f64; 2], [x, y]: [f64; 2], [least_z, greatest_z]: [f64; 2]| {
            let half = [half_x, half_y, (greatest_z - least_z) / 2.0];
            box_part(half, [mx + x, my + y, (greatest_z + least_z) / 2.0], wood)
        };
        let side = |y| plate([hx, PLATE], [0.0, y], [0.0, self.height]);
        let between = |half_x, x, z| plate([half_x, hy - 2.0 * PLATE], [x, 0.0], z);
        let board = |top_z| between(hx - PLATE, -PLATE, [top_z - 2.0 * PLATE, top_z]);
        let mut parts = vec![
            side(PLATE - hy),
            side(hy - PLATE),
            between(PLATE, hx - PLATE, [0.0, self.height]),
            board(self.height),
            between(PLATE, 2.0 * PLATE - hx, [0.0, self.boards_z[0] - 2.0 * PLATE]),
        ];
        parts.extend(self.boards_z.map(board));
        parts
    }

    /// Five books of this half depth on a board, side by side from the wall at +y on, of which the first `turn` are moved
    /// to the end of the row.
    pub(in crate::tasks) fn row(&self, board: usize, half_depth: f64, turn: usize) -> Vec<PartSpec> {
        let mut y = self.middle[1] + self.half[1] - 2.0 * PLATE;
        let mut books = BOOKS;
        books.rotate_left(turn);
        let stand = |(thickness, height, color): (f64, f64, [u8; 3])| {
            y -= thickness;
            let half = [half_depth, thickness / 2.0, height / 2.0];
            let position = [self.middle[0], y + thickness / 2.0, self.boards_z[board] + height / 2.0];
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
