//! Surfaces of revolution about z, such as cylinders, cones, cups, bowls and rings.

use core::f32::consts::PI;

use super::contour::{Contour, Point};
use super::unit_solids::band;
use crate::math::trig::on_circle;
use crate::mesh::Mesh;

/// Target sagitta, in m: the largest distance between a circle and the polygon that approximates it.
const SAG_M: f32 = 0.0002;
/// Minimum and maximum number of segments of a circle.
const SEGMENT_LIMITS: [usize; 2] = [16, 64];

/// Returns the number of segments for a circle of this radius. The sagitta of a regular n-gon is r (1 − cos
/// π/n), about r π² / 2n².
pub(crate) fn n_segments(radius_m: f32) -> usize {
    let n = (PI * (radius_m / (2.0 * SAG_M)).sqrt()).ceil() as usize;
    // A multiple of four has corners on both axes, so the polygon has the extents of the circle.
    n.next_multiple_of(4).clamp(SEGMENT_LIMITS[0], SEGMENT_LIMITS[1])
}

/// Returns the surface of revolution of a profile of points (r, z) in m, whose outside lies to the right: the
/// profile runs up the outside and, for a vessel, down the inside. The surface is closed if the profile
/// starts and ends on the axis (r = 0) or ends exactly where it starts.
///
/// # Panics
/// If a radius is negative, or as [`Contour::new`] does.
pub(crate) fn mesh(profile: &[Point]) -> Mesh {
    assert!(profile.iter().all(|p| p[0] >= 0.0), "a lathe profile has a negative radius: {profile:?}");
    let contour = Contour::new(profile, end_neighbours(profile));
    let n = n_segments(profile.iter().fold(0.0, |max, p| max.max(p[0])));
    let mut mesh = Mesh::default();
    let rings: Vec<Vec<u32>> = contour
        .vertices
        .iter()
        .map(|vertex| {
            let ([r, z], [radial, axial]) = (vertex.point, vertex.normal);
            let around = (0..n).map(|i| on_circle(i, n));
            around.map(|(x, y)| mesh.push([r * x, r * y, z], [radial * x, radial * y, axial])).collect()
        })
        .collect();
    for [lower, upper] in contour.segments {
        band(&mut mesh, &rings[lower], &rings[upper]);
    }
    mesh.finish()
}

/// Returns the points before the first and after the last point of a profile: across the seam if it is
/// closed, or mirrored at the axis, so that a pole is smoothed or split like any other corner.
fn end_neighbours(profile: &[Point]) -> [Option<Point>; 2] {
    let ([first, second, ..], [.., before, last]) = (profile, profile) else {
        return [None; 2];
    };
    if first == last {
        return [Some(*before), Some(*second)];
    }
    let mirrored = |end: &Point, next: &Point| (end[0] == 0.0).then_some([-next[0], next[1]]);
    [mirrored(first, second), mirrored(last, before)]
}

#[cfg(test)]
mod tests {
    use super::{Point, mesh, n_segments};
    use crate::math::trig::on_circle;
    use crate::mesh::checks::{assert_solid, polygon_area};

    fn sphere_profile(radius: f32) -> Vec<Point> {
        let quarter = 12;
        let point = |i: usize| {
            let (cos, sin) = on_circle(i + 3 * quarter, 4 * quarter);
            [radius * cos, radius * sin]
        };
        let mut profile: Vec<Point> = (0..=2 * quarter).map(point).collect();
        profile[0][0] = 0.0;
        profile[2 * quarter][0] = 0.0;
        profile
    }

    #[test]
    fn profiles_enclose_expected_volume() {
        // Name, profile, height in m, and volume relative to a cylinder of radius and height 0.1 m.
        let cylinder = vec![[0.0, -0.1], [0.1, -0.1], [0.1, 0.1], [0.0, 0.1]];
        let cone = vec![[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]];
        let frustum = vec![[0.0, 0.0], [0.1, 0.0], [0.05, 0.1], [0.0, 0.1]];
        let cup = vec![[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.09, 0.1], [0.09, 0.01], [0.0, 0.01]];
        let ring = vec![[0.05, 0.0], [0.1, 0.0], [0.1, 0.1], [0.05, 0.1], [0.05, 0.0]];
        let table = [
            ("cylinder", cylinder, 0.2, 2.0),
            ("cone", cone, 0.1, 1.0 / 3.0),
            ("frustum", frustum, 0.1, 1.75 / 3.0),
            ("cup", cup, 0.1, 1.0 - 0.81 * 0.9),
            ("ring", ring, 0.1, 0.75),
        ];
        for (name, profile, height_m, volume) in table {
            let expected = volume * polygon_area(n_segments(0.1)) * 1e-3;
            assert_solid(&name, &mesh(&profile), [0.2, 0.2, height_m], expected);
        }
    }

    #[test]
    fn normals_split_only_at_edges() {
        for (p, n) in points_and_normals(&sphere_profile(0.1)) {
            assert!((0..3).all(|i| (p[i] * 10.0 - n[i]).abs() < 1e-3), "sphere: {n:?} at {p:?}");
        }
        for (_, n) in points_and_normals(&[[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]]) {
            assert!(n[2] == 0.0 || n[2].abs() == 1.0, "cylinder: {n:?}");
        }
    }

    fn points_and_normals(profile: &[Point]) -> Vec<([f32; 3], [f32; 3])> {
        let mesh = mesh(profile);
        (0..mesh.n_vertices() as u32).map(|i| (mesh.position(i), mesh.normals[i as usize])).collect()
    }

    #[test]
    fn segment_count_follows_radius() {
        for (radius_m, n) in [(0.0, 16), (0.01, 16), (0.04, 32), (0.1, 52), (1.0, 64)] {
            assert_eq!(n_segments(radius_m), n, "{radius_m} m");
        }
    }
}
