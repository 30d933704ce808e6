//! Plane polygons with holes, cut into triangles by ear clipping (Meisters, "Polygons have ears", 1975) once bridges join
//! the holes to the outline (Eberly, "Triangulation by ear clipping", 2002). Signs of areas come from double precision,
//! which is all but exact for coordinates of single precision, so no tolerance is needed.

use super::contour::Point;

/// Triangles, counter-clockwise, as indices into the concatenated loops: first the outline, counter-clockwise, then its
/// holes, clockwise. No triangle has a loop's point on a side, so walls may rise from the loops without a gap.
///
/// # Panics
/// If a loop crosses or touches itself or another, or has fewer than three points.
pub(super) fn triangles(loops: &[Vec<Point>]) -> Vec<[usize; 3]> {
    let points = loops.concat();
    let mut start = 0;
    let mut rings: Vec<Vec<usize>> = Vec::with_capacity(loops.len());
    for points in loops {
        assert!(points.len() >= 3, "a loop needs three points, found {points:?}");
        rings.push((start..start + points.len()).collect());
        start += points.len();
    }
    let mut polygon = Polygon { ring: rings.remove(0), points, holes: rings };
    polygon.join_holes();
    polygon.clipped()
}

/// Twice the area of a loop, negative if it is clockwise.
pub(super) fn double_area(points: &[Point]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| turn([0.0; 2], *a, *b)).sum()
}

struct Polygon {
    points: Vec<Point>,
    /// Indices of the points around the polygon; a bridge is passed once in each direction.
    ring: Vec<usize>,
    /// Indices around each hole not yet joined to the ring.
    holes: Vec<Vec<usize>>,
}

impl Polygon {
    /// Joins every hole, the rightmost first: what lies to the right of a hole's rightmost point is then the ring alone,
    /// so the point sees one of the ring's.
    fn join_holes(&mut self) {
        for hole in &mut self.holes {
            let right = |i: &usize| self.points[hole[*i]][0];
            let rightmost = (0..hole.len()).max_by(|a, b| right(a).total_cmp(&right(b)));
            hole.rotate_left(rightmost.expect("a loop has points"));
        }
        self.holes.sort_by(|a, b| self.points[a[0]][0].total_cmp(&self.points[b[0]][0]));
        while let Some(hole) = self.holes.last() {
            let at = self.bridgehead(hole[0]);
            let back = [hole[0], self.ring[at]];
            let detour: Vec<usize> = hole.iter().copied().chain(back).collect();
            self.ring.splice(at + 1..at + 1, detour);
            self.holes.pop();
        }
    }

    /// Place in the ring of the point nearest to a hole's point among those that see it.
    fn bridgehead(&self, from: usize) -> usize {
        let distance = |at: &usize| squared_distance(self.points[self.ring[*at]], self.points[from]);
        let mut places: Vec<usize> = (0..self.ring.len()).collect();
        places.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        let seen = places.into_iter().find(|at| self.sees(*at, self.points[from]));
        seen.expect("a hole inside an outline sees it")
    }

    /// Whether the segment from the ring's place to the target runs inside the polygon and meets no loop on its way.
    fn sees(&self, at: usize, target: Point) -> bool {
        let [before, eye, after] = self.corner(at);
        let left = |a, b, c| turn(a, b, c) > 0.0;
        let sets_out_inside = if left(before, eye, after) {
            left(eye, target, before) && left(target, eye, after)
        } else {
            turn(eye, target, after) < 0.0 || turn(target, eye, before) < 0.0
        };
        let loops = || core::iter::once(&self.ring).chain(&self.holes);
        let mut sides = loops().flat_map(|ring| {
            let ends = ring.iter().zip(ring.iter().cycle().skip(1));
            ends.map(|(a, b)| [self.points[*a], self.points[*b]])
        });
        sets_out_inside && !sides.any(|side| meets([eye, target], side))
    }

    /// Cuts off ears until a triangle is left. Of all ears the one with the shortest new side goes first, which avoids
    /// slivers.
    fn clipped(mut self) -> Vec<[usize; 3]> {
        let mut triangles = Vec::with_capacity(self.ring.len() - 2);
        while self.ring.len() >= 3 {
            let side = |at: &usize| {
                let [before, _, after] = self.corner(*at);
                squared_distance(before, after)
            };
            let mut places: Vec<usize> = (0..self.ring.len()).collect();
            // The bits of numbers that are not negative are in their order.
            places.sort_by_cached_key(|at| side(at).to_bits());
            let ear = places.into_iter().find(|at| self.is_ear(*at));
            let ear = ear.expect("an outline that neither crosses nor touches itself has an ear");
            triangles.push(self.around(ear).map(|at| self.ring[at]));
            self.ring.remove(ear);
        }
        triangles
    }

    /// Whether the corner is convex and no other point lies in its triangle or on a side of it. Copies of its corners at
    /// the far ends of bridges do not count.
    fn is_ear(&self, at: usize) -> bool {
        let [a, b, c] = self.corner(at);
        let covers = |p: Point| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
        let points = || self.ring.iter().map(|i| self.points[*i]);
        turn(a, b, c) > 0.0 && !points().any(|p| ![a, b, c].contains(&p) && covers(p))
    }

    /// The place before, the place itself and the one after.
    fn around(&self, at: usize) -> [usize; 3] {
        let n = self.ring.len();
        [(at + n - 1) % n, at, (at + 1) % n]
    }

    fn corner(&self, at: usize) -> [Point; 3] {
        self.around(at).map(|at| self.points[self.ring[at]])
    }
}

/// Twice the area of the triangle, positive if a → b → c turns left.
fn turn(a: Point, b: Point, c: Point) -> f64 {
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

/// Whether the segment crosses the side or passes through an end of it. Ends that the two share do not count.
fn meets([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let passes = |p: Point| {
        let ([ux, uy], [vx, vy]) = (difference(a, p), difference(b, p));
        p != a && p != b && turn(a, b, p) == 0.0 && ux * vx + uy * vy < 0.0
    };
    let parted = |s: f64, t: f64| s < 0.0 && t > 0.0 || s > 0.0 && t < 0.0;
    let crosses = parted(turn(a, b, c), turn(a, b, d)) && parted(turn(c, d, a), turn(c, d, b));
    crosses || passes(c) || passes(d)
}
