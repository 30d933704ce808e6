//! Triangulation of polygons with holes by ear clipping (Meisters, "Polygons have ears", 1975). Bridges first
//! connect the holes to the outline (Eberly, "Triangulation by ear clipping", 2002).
//!
//! Orientation tests use double precision, which is nearly exact for single-precision coordinates, so they
//! need no tolerance. The crate `earcutr` takes ears in another order: it returns other triangles, so images
//! with other bits, and flatter ones (for the outline of a wrench, height over longest side 0.02, not 0.11).

use super::contour::Point;

/// Triangulates a polygon whose first loop is the outline, counter-clockwise, and whose other loops are its
/// holes, clockwise. The result has counter-clockwise triangles of indices into the concatenated loops. No
/// point of a loop lies in the interior of a triangle's edge, so walls along the loops leave no gaps.
///
/// # Panics
/// If a loop intersects or touches itself or another loop, or has fewer than three points.
pub(crate) fn triangles(loops: &[Vec<Point>]) -> Vec<[usize; 3]> {
    let points = loops.concat();
    let mut start = 0;
    let mut rings: Vec<Vec<usize>> = Vec::with_capacity(loops.len());
    for points in loops {
        assert!(points.len() >= 3, "a loop needs three points, found {points:?}");
        rings.push((start..start + points.len()).collect());
        start += points.len();
    }
    let mut polygon = PolygonWithHoles { ring: rings.remove(0), points, holes: rings };
    polygon.join_holes();
    polygon.clip_ears()
}

/// Returns twice the signed area of a loop, which is negative if it is clockwise.
pub(crate) fn double_area(points: &[Point]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| orientation([0.0; 2], *a, *b)).sum()
}

struct PolygonWithHoles {
    points: Vec<Point>,
    /// Point indices around the polygon. Each bridge occurs twice, once per direction.
    ring: Vec<usize>,
    /// Point indices around each hole that is not yet connected to the ring.
    holes: Vec<Vec<usize>>,
}

impl PolygonWithHoles {
    /// Connects all holes to the ring, the rightmost first: then only the ring lies to the right of a hole's
    /// rightmost point, so at least one point of the ring is visible from there.
    fn join_holes(&mut self) {
        for hole in &mut self.holes {
            let right = |i: &usize| self.points[hole[*i]][0];
            let rightmost = (0..hole.len()).max_by(|a, b| right(a).total_cmp(&right(b)));
            hole.rotate_left(rightmost.expect("a loop has points"));
        }
        self.holes.sort_by(|a, b| self.points[a[0]][0].total_cmp(&self.points[b[0]][0]));
        while let Some(hole) = self.holes.last() {
            let at = self.bridge_position(hole[0]);
            let back = [hole[0], self.ring[at]];
            let detour: Vec<usize> = hole.iter().copied().chain(back).collect();
            self.ring.splice(at + 1..at + 1, detour);
            self.holes.pop();
        }
    }

    /// Returns the position in the ring of the closest point that is visible from a point of a hole.
    fn bridge_position(&self, from: usize) -> usize {
        let distance = |at: &usize| squared_distance(self.points[self.ring[*at]], self.points[from]);
        let mut positions: Vec<usize> = (0..self.ring.len()).collect();
        positions.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let visible = positions.into_iter().find(|at| self.is_visible(*at, self.points[from]));
        visible.expect("a hole inside its outline has a visible point")
    }

    /// Returns `true` if the segment from a ring position to `target` lies inside the polygon and intersects
    /// no loop.
    fn is_visible(&self, at: usize, target: Point) -> bool {
        let [before, start, after] = self.corner(at);
        let left = |a, b, c| orientation(a, b, c) > 0.0;
        let starts_inside = if left(before, start, after) {
            left(start, target, before) && left(target, start, after)
        } else {
            orientation(start, target, after) < 0.0 || orientation(target, start, before) < 0.0
        };
        let loops = || core::iter::once(&self.ring).chain(&self.holes);
        let mut edges = loops().flat_map(|ring| {
            let ends = ring.iter().zip(ring.iter().cycle().skip(1));
            ends.map(|(a, b)| [self.points[*a], self.points[*b]])
        });
        starts_inside && !edges.any(|edge| intersects([start, target], edge))
    }

    /// Clips ears until one triangle remains, always the ear with the shortest new edge, which avoids
    /// slivers.
    fn clip_ears(mut self) -> Vec<[usize; 3]> {
        let mut triangles = Vec::with_capacity(self.ring.len() - 2);
        while self.ring.len() >= 3 {
            let new_edge = |at: &usize| {
                let [before, _, after] = self.corner(*at);
                squared_distance(before, after)
            };
            let mut positions: Vec<usize> = (0..self.ring.len()).collect();
            // The bit patterns of nonnegative floats sort like the floats.
            positions.sort_by_cached_key(|at| new_edge(at).to_bits());
            let ear = positions.into_iter().find(|at| self.is_ear(*at));
            let ear = ear.expect("a simple polygon has an ear");
            triangles.push(self.neighbourhood(ear).map(|at| self.ring[at]));
            self.ring.remove(ear);
        }
        triangles
    }

    /// Returns `true` if the corner is convex and its triangle contains no other point, not even on its
    /// boundary. Copies of its own corners, which bridges create, do not count.
    fn is_ear(&self, at: usize) -> bool {
        let [a, b, c] = self.corner(at);
        let covers = |p: Point| {
            orientation(a, b, p) >= 0.0 && orientation(b, c, p) >= 0.0 && orientation(c, a, p) >= 0.0
        };
        let points = || self.ring.iter().map(|i| self.points[*i]);
        orientation(a, b, c) > 0.0 && !points().any(|p| ![a, b, c].contains(&p) && covers(p))
    }

    /// Returns the preceding, the given and the following position in the ring.
    fn neighbourhood(&self, at: usize) -> [usize; 3] {
        let n = self.ring.len();
        [(at + n - 1) % n, at, (at + 1) % n]
    }

    fn corner(&self, at: usize) -> [Point; 3] {
        self.neighbourhood(at).map(|at| self.points[self.ring[at]])
    }
}

/// Returns twice the signed area of a triangle, which is positive if a → b → c turns left.
fn orientation(a: Point, b: Point, c: Point) -> f64 {
    let [ux, uy] = difference(b, a);
    let [vx, vy] = difference(c, a);
    ux * vy - uy * vx
}

fn squared_distance(a: Point, b: Point) -> f64 {
    let [x, y] = difference(a, b);
    x * x + y * y
}

fn difference(a: Point, b: Point) -> [f64; 2] {
    core::array::from_fn(|i| f64::from(a[i]) - f64::from(b[i]))
}

/// Returns `true` if segment ab crosses segment cd or passes through one of its ends. Shared endpoints do not
/// count.
fn intersects([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let passes = |p: Point| {
        let ([ux, uy], [vx, vy]) = (difference(a, p), difference(b, p));
        p != a && p != b && orientation(a, b, p) == 0.0 && ux * vx + uy * vy < 0.0
    };
    let opposite = |s: f64, t: f64| s < 0.0 && t > 0.0 || s > 0.0 && t < 0.0;
    let crosses = opposite(orientation(a, b, c), orientation(a, b, d))
        && opposite(orientation(c, d, a), orientation(c, d, b));
    crosses || passes(c) || passes(d)
}
