//! Extrusions along z of an outline with holes.

use super::contour::{Contour, Point};
use super::polygon;
use crate::mesh::Mesh;

/// Returns the prism with an outline of points (x, y) in m, minus its holes, from z = −`half_height_m` to
/// `half_height_m`. Loops may have either orientation and do not repeat their first point.
///
/// # Panics
/// If a loop intersects or touches itself or another loop, or repeats a point.
pub(crate) fn mesh(outline: &[Point], holes: &[&[Point]], half_height_m: f32) -> Mesh {
    let mut loops = vec![oriented(outline, 1.0)];
    loops.extend(holes.iter().map(|hole| oriented(hole, -1.0)));
    let mut mesh = Mesh::default();
    for points in &loops {
        wall(&mut mesh, points, half_height_m);
    }
    let triangles = polygon::triangles(&loops);
    for side in [1.0, -1.0] {
        let cap = loops
            .concat()
            .into_iter()
            .map(|[x, y]| mesh.push([x, y, side * half_height_m], [0.0, 0.0, side]));
        let cap: Vec<u32> = cap.collect();
        for corners in &triangles {
            let [a, b, c] = corners.map(|i| cap[i]);
            mesh.triangle(if side > 0.0 { [a, b, c] } else { [c, b, a] });
        }
    }
    mesh.finish()
}

/// Returns the loop in the orientation in which its area has the given sign. With positive outline and
/// negative holes the solid lies to the left of every loop.
fn oriented(points: &[Point], sign: f64) -> Vec<Point> {
    let mut points = points.to_vec();
    if sign * polygon::double_area(&points) < 0.0 {
        points.reverse();
    }
    points
}

/// Appends the side faces along a loop, which face to its right.
fn wall(mesh: &mut Mesh, points: &[Point], half_height_m: f32) {
    let (first, last) = (points[0], points[points.len() - 1]);
    let around: Vec<Point> = points.iter().copied().chain([first]).collect();
    let contour = Contour::new(&around, [Some(last), Some(points[1])]);
    let columns: Vec<[u32; 2]> = contour
        .vertices
        .iter()
        .map(|vertex| {
            let ([x, y], [nx, ny]) = (vertex.point, vertex.normal);
            [-half_height_m, half_height_m].map(|z| mesh.push([x, y, z], [nx, ny, 0.0]))
        })
        .collect();
    for [from, to] in contour.segments {
        let ([a, d], [b, c]) = (columns[from], columns[to]);
        mesh.quad([a, b, c, d]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::polygon::double_area;
    use super::{Point, mesh};
    use crate::math::trig::on_circle;
    use crate::mesh::checks::assert_solid;

    type Loop = Vec<Point>;

    const HALF_HEIGHT_M: f32 = 0.01;

    fn circle(centre: Point, radius: f32, n: usize) -> Vec<Point> {
        let corner = |i| on_circle(i, n);
        (0..n).map(corner).map(|(x, y)| [centre[0] + radius * x, centre[1] + radius * y]).collect()
    }

    fn square(centre: Point, half: f32) -> Vec<Point> {
        [(-half, -half), (half, -half), (half, half), (-half, half)]
            .map(|(x, y)| [centre[0] + x, centre[1] + y])
            .to_vec()
    }

    /// Returns a star around the origin with pseudo-random radii from a linear congruential generator.
    fn star(seed: &mut u32, n: usize) -> Vec<Point> {
        let mut radius = || {
            *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.03 + 0.07 * (*seed >> 8) as f32 / (1 << 24) as f32
        };
        let points = (0..n).map(|i| on_circle(i, n));
        points.map(|(x, y)| (x, y, radius())).map(|(x, y, r)| [r * x, r * y]).collect()
    }

    /// Asserts that the prism is closed, faces outwards, and has the extents and volume of its loops.
    fn assert_prism(name: &str, outline: &[Point], holes: &[&[Point]]) {
        let plate = mesh(outline, holes, HALF_HEIGHT_M);
        let area = |points: &[Point]| 0.5 * double_area(points).abs() as f32;
        let solid = area(outline) - holes.iter().map(|hole| area(hole)).sum::<f32>();
        let size = |axis: usize| {
            let coordinates = || outline.iter().map(|p| p[axis]);
            coordinates().fold(f32::MIN, f32::max) - coordinates().fold(f32::MAX, f32::min)
        };
        let extents = [size(0), size(1), 2.0 * HALF_HEIGHT_M];
        assert_solid(&name, &plate, extents, 2.0 * HALF_HEIGHT_M * solid);
        let n_points = outline.len() + holes.iter().map(|hole| hole.len()).sum::<usize>();
        // Two caps of n + 2h − 2 triangles each and two triangles per segment.
        assert_eq!(plate.triangles.len(), 4 * (n_points + holes.len()) - 4, "{name}");
    }

    #[test]
    fn prisms_are_closed_with_expected_volume() {
        let ell = vec![[0.0, 0.0], [0.1, 0.0], [0.1, 0.03], [0.04, 0.03], [0.04, 0.1], [0.0, 0.1]];
        let flat =
            vec![[0.0, 0.0], [0.05, 0.0], [0.1, 0.0], [0.1, 0.05], [0.1, 0.1], [0.0, 0.1], [0.0, 0.05]];
        let comb: Vec<Point> = (0..16)
            .map(|i| [0.01 * i as f32, if i % 2 == 0 { 0.0 } else { 0.09 }])
            .chain([[0.15, 0.1], [0.0, 0.1]])
            .collect();
        let small = |x, y| square([x, y], 0.01);
        let table: [(&str, Loop, Vec<Loop>); 9] = [
            ("square", square([0.0; 2], 0.1), vec![]),
            ("L shape", ell.clone(), vec![]),
            ("L shape with a hole", ell, vec![small(0.02, 0.015)]),
            ("points along straight segments", flat, vec![small(0.05, 0.05)]),
            ("comb", comb, vec![]),
            ("washer", circle([0.0; 2], 0.1, 48), vec![circle([0.0; 2], 0.05, 32)]),
            ("two holes in a column", square([0.0; 2], 0.1), vec![small(0.0, 0.05), small(0.0, -0.05)]),
            (
                "row of holes",
                square([0.0; 2], 0.1),
                [-0.06, -0.02, 0.02, 0.06].map(|x| small(x, 0.0)).to_vec(),
            ),
            (
                "hole surrounded by an arc of holes",
                square([0.0; 2], 0.1),
                vec![
                    small(0.0, 0.0),
                    square([0.05, 0.0], 0.02),
                    square([0.015, 0.05], 0.02),
                    square([0.015, -0.05], 0.02),
                ],
            ),
        ];
        for (name, outline, holes) in table {
            let holes: Vec<&[Point]> = holes.iter().map(Vec::as_slice).collect();
            assert_prism(name, &outline, &holes);
        }
    }

    #[test]
    fn random_stars_with_holes_triangulate() {
        let mut seed = 7;
        for round in 0..200 {
            let outline = star(&mut seed, 8 + round % 30);
            let inner: Vec<Point> =
                star(&mut seed, 5 + round % 7).iter().map(|p| p.map(|x| 0.1 * x)).collect();
            let neighbour = circle([-0.0145, 0.003], 0.004, 5 + round % 9);
            assert_prism("star", &outline, &[&inner, &neighbour]);
        }
    }

    #[test]
    fn wall_normals_split_only_at_corners() {
        let radial = |p: [f32; 3], n: [f32; 3]| 10.0 * (p[0] * n[0] + p[1] * n[1]);
        for (outline, cosine) in
            [(circle([0.0; 2], 0.1, 24), 1.0), (circle([0.0; 2], 0.1, 4), 0.5_f32.sqrt())]
        {
            let bar = mesh(&outline, &[], HALF_HEIGHT_M);
            let sides = (0..bar.n_vertices()).filter(|i| bar.normals[*i][2] == 0.0);
            for i in sides {
                let found = radial(bar.position(i as u32), bar.normals[i]);
                assert!((found - cosine).abs() < 1e-4, "{found} for {cosine}");
            }
        }
    }
}
