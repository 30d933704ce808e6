//! A polyline in a plane with normals to its right, smooth where it bends gently and broken where it bends sharply: what
//! a lathe turns and an extrusion lifts.

/// Coordinates in the contour's plane, in m.
pub(super) type Point = [f32; 2];

/// Cosine of the bend of 40° above which a corner is an edge.
const SHARP_COS: f32 = 0.766_044_4;

/// A place on the contour and the unit normal there.
#[derive(Clone, Copy)]
pub(super) struct Station {
    pub(super) point: Point,
    pub(super) normal: Point,
}

/// The sides of a polyline between stations; a sharp corner has two stations, any other has one.
#[derive(Default)]
pub(super) struct Contour {
    pub(super) stations: Vec<Station>,
    /// First and last station of each side.
    pub(super) sides: Vec<[usize; 2]>,
}

impl Contour {
    /// The contour through `points`, where the line would go on to `beyond`: what precedes the first and follows the
    /// last point decides how smooth these are, and is no side itself.
    ///
    /// # Panics
    /// If there are fewer than two points or two in succession coincide.
    pub(super) fn new(points: &[Point], beyond: [Option<Point>; 2]) -> Self {
        assert!(points.len() >= 2, "a contour needs two points, found {points:?}");
        let last = points.len() - 1;
        let mut contour = Self::default();
        let mut from = 0;
        for (i, &point) in points.iter().enumerate() {
            let before = if i > 0 { Some(points[i - 1]) } else { beyond[0] };
            let after = if i < last { Some(points[i + 1]) } else { beyond[1] };
            let [mut arriving, mut leaving] = corner(before, point, after);
            if i == 0 {
                arriving = leaving;
            } else if i == last {
                leaving = arriving;
            }
            let to = contour.station(point, arriving);
            if i > 0 {
                contour.sides.push([from, to]);
            }
            from = if leaving == arriving { to } else { contour.station(point, leaving) };
        }
        contour
    }

    fn station(&mut self, point: Point, [x, y]: Point) -> usize {
        let length = (x * x + y * y).sqrt();
        self.stations.push(Station { point, normal: [x / length, y / length] });
        self.stations.len() - 1
    }
}

/// Normals at a corner, of any length: of the side that arrives and of the one that leaves. Where they share one, each
/// side counts by its length, so that a long flat stays flat beside a small rounding.
fn corner(before: Option<Point>, point: Point, after: Option<Point>) -> [Point; 2] {
    let arriving = before.map(|before| across(before, point));
    let leaving = after.map(|after| across(point, after));
    match (arriving, leaving) {
        (Some(a), Some(b)) if is_sharp(a, b) => [a, b],
        (Some(a), Some(b)) => [[a[0] + b[0], a[1] + b[1]]; 2],
        (Some(a), None) | (None, Some(a)) => [a; 2],
        (None, None) => unreachable!("one of two points has a neighbour"),
    }
}

/// The side turned to its right.
fn across(from: Point, to: Point) -> Point {
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
    fn corners_above_forty_degrees_are_edges() {
        // A second side of 38 and of 42 degrees to the first, which lies along x.
        for (end, n_stations) in [([1.788, 0.616], 3), ([1.743, 0.669], 4)] {
            let contour = Contour::new(&[[0.0, 0.0], [1.0, 0.0], end], [None; 2]);
            assert_eq!(contour.stations.len(), n_stations);
            assert_eq!(contour.sides.len(), 2);
            assert_eq!(contour.stations[0].normal, [0.0, -1.0]);
        }
    }

    #[test]
    fn what_lies_beyond_the_ends_smooths_them() {
        let bent = Contour::new(&[[0.0, 0.0], [1.0, 0.0]], [Some([-1.0, 0.3]), Some([1.0, 1.0])]);
        let [first, last] = [bent.stations[0].normal, bent.stations[1].normal];
        assert!(first[0] < -0.1 && first[1] < -0.9, "a gentle bend is shared: {first:?}");
        assert_eq!(last, [0.0, -1.0], "a sharp bend is not");
    }
}
