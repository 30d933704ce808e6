//! The arrow that is turned on the table. See docs/benchmark.md, "Objects".

use crate::tasks::common::objects::tools::mirrored_hull;
use crate::tasks::common::{SINGLE_TABLE_Z, movable};
use scene::{
    AppearanceSpec, BodySpec, Mass, PartSpec, Range, RenderParts, ScaleAxes, VisualShape, VisualSpec,
};

/// Sections of the shaft and of the head as they collide, each given by x, half-width and z of its bottom and
/// top, in m. Both are split in the middle: the engine adds up friction per pair of shapes, and a single
/// shape would resist being turned too much.
pub(crate) const SECTIONS: [[[f64; 4]; 3]; 2] = [
    [
        [-0.0744, 0.0165, -0.0117, 0.0116],
        [-0.0044, 0.0179, -0.0117, 0.0116],
        [0.0656, 0.0192, -0.0117, 0.0116],
    ],
    [[0.0656, 0.0315, -0.0117, 0.0121], [0.110, 0.0189, -0.0117, 0.0121], [0.173, 0.001, -0.0117, 0.0121]],
];
/// Half of the arrow's outline as it is seen, in m, and half of its thickness there.
const OUTLINE: [[f64; 2]; 4] = [[-0.0726, -0.016], [0.0714, -0.016], [0.0714, -0.030], [0.1723, 0.0]];
const HALF_THICKNESS: f64 = 0.0197 / 2.0;

/// Creates an arrow that lies on the table and points along x. Its y and z axes are −z and y of the
/// benchmark's.
pub(crate) fn arrow(region: usize) -> BodySpec {
    let white = AppearanceSpec::plain([0.8; 3]);
    let left = OUTLINE[..3].iter().rev().map(|[x, y]| [*x, -y]);
    let outline = OUTLINE.into_iter().chain(left).collect();
    let seen = VisualShape::Extrusion { outline, holes: Vec::new(), half_height: HALF_THICKNESS };
    let hull = |sections: &[[f64; 4]]| {
        let corners = |&[x, half_y, low, high]: &[f64; 4]| [[x, half_y, low], [x, half_y, high]];
        let points: Vec<[f64; 3]> = sections.iter().flat_map(corners).collect();
        PartSpec::at(mirrored_hull(&points), [0.0; 3], white)
    };
    BodySpec {
        visuals: vec![VisualSpec::at(seen, [0.0; 3], white)],
        render_parts: RenderParts::Single,
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured {
            kg: 0.1942,
            centre: [0.0419, 0.0, 0.0001],
            inertia: [3.41e-5, 7.85e-4, 8.03e-4],
        },
        ..movable(
            "arrow",
            SECTIONS.iter().flat_map(|part| part.windows(2)).map(hull).collect(),
            region,
            SINGLE_TABLE_Z,
        )
        .with_yaw(Range::symmetric(15.0_f64.to_radians()))
        .with_origin_z(SINGLE_TABLE_Z + 0.0119)
    }
}
