//! Planar polylines with normals: the profile of a lathe and the outline of an extrusion.
//!
//! Normals point to the right of the polyline. They are shared at gentle bends and split at sharp corners.

/// A point in the plane of the contour, in m.
pub(crate) type Point = [f32; 2];

/// Cosine of 40°, the bend above which a corner counts as sharp.
const SHARP_COS: f32 = 0.766_044_4;

/// A vertex of a contour with its unit normal.
#[derive(Clone, Copy)]
pub(crate) struct ContourVertex {
    pub(crate) point: Point,
    pub(crate) normal: Point,
}

/// A polyline as segments between vertices. A sharp corner has two vertices, every other point has one.
#[derive(Default)]
pub(crate) struct Contour {
    pub(crate) vertices: Vec<ContourVertex>,
    /// Indices of the first and last vertex of each segment.
    pub(crate) segments: Vec<[usize; 2]>,
}

impl Contour {
    /// Creates the contour through `points`. The points in `neighbours` precede the first and follow the last
    /// one: they affect the normals at the ends but add no segments.
    ///
    /// # Panics
    /// If there are fewer than two points or if two successive points coincide.
    pub(crate) fn new(points: &[Point], neighbours: [Option<Point>; 2]) -> Self {
        assert!(points.len() >= 2, "a contour needs two points, found {points:?}");
        let last = points.len() - 1;
        let mut contour = Self::default();
        let mut from = 0;
        for (i, &point) in points.iter().enumerate() {
            let before = if i > 0 { Some(points[i - 1]) } else { neighbours[0] };
            let after = if i < last { Some(points[i + 1]) } else { neighbours[1] };
            let [mut arriving, mut leaving] = corner(before, point, after);
            if i == 0 {
                arriving = leaving;
            } else if i == last {
                leaving = arriving;
            }
            let to = contour.add_vertex(point, arriving);
            if i > 0 {
                contour.segments.push([from, to]);
            }
            from = if leaving == arriving { to } else { contour.add_vertex(point, leaving) };
        }
        contour
    }

    fn add_vertex(&mut self, point: Point, [x, y]: Point) -> usize {
        let length = (x * x + y * y).sqrt();
        self.vertices.push(ContourVertex { point, normal: [x / length, y / length] });
        self.vertices.len() - 1
    }
}

/// Returns the unnormalised normals of the segments that arrive at and leave a corner. At a gentle bend both
/// get the sum, which weights each segment by its length: a long flat segment stays flat next to a small
/// rounding.
fn corner(before: Option<Point>, point: Point, after: Option<Point>) -> [Point; 2] {
    let arriving = before.map(|before| right_normal(before, point));
    let leaving = after.map(|after| right_normal(point, after));
    match (arriving, leaving) {
        (Some(a), Some(b)) if is_sharp(a, b) => [a, b],
        (Some(a), Some(b)) => [[a[0] + b[0], a[1] + b[1]]; 2],
        (Some(a), None) | (None, Some(a)) => [a; 2],
        (None, None) => unreachable!("one of two points has a neighbour"),
    }
}

/// Returns the segment rotated 90° clockwise: its normal, as long as the segment.
fn right_normal(from: Point, to: Point) -> Point {
    assert!(from != to, "two points of a contour coincide at {from:?}");
    [to[1] - from[1], from[0] - to[0]]
}

fn is_sharp(a: Point, b: Point) -> bool {
    let dot = |a: Point, b: Point| a[0] * b[0] + a[1] * b[1];
    dot(a, b) < SHARP_COS * (dot(a, a) * dot(b, b)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::Contour;

    #[test]
    fn bends_above_forty_degrees_split_normals() {
        // The first segment lies along x, the second at 38° or 42° to it.
        for (end, n_vertices) in [([1.788, 0.616], 3), ([1.743, 0.669], 4)] {
            let contour = Contour::new(&[[0.0, 0.0], [1.0, 0.0], end], [None; 2]);
            assert_eq!(contour.vertices.len(), n_vertices);
            assert_eq!(contour.segments.len(), 2);
            assert_eq!(contour.vertices[0].normal, [0.0, -1.0]);
        }
    }

    #[test]
    fn neighbours_smooth_end_normals() {
        let bent = Contour::new(&[[0.0, 0.0], [1.0, 0.0]], [Some([-1.0, 0.3]), Some([1.0, 1.0])]);
        let [first, last] = [bent.vertices[0].normal, bent.vertices[1].normal];
        assert!(first[0] < -0.1 && first[1] < -0.9, "a gentle bend is shared: {first:?}");
        assert_eq!(last, [0.0, -1.0], "a sharp bend is not");
    }
}
