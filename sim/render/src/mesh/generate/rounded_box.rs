//! Boxes with rounded edges.

use super::unit_solids::band;
use crate::math::affine::Vec3;
use crate::math::trig::on_circle;
use crate::mesh::Mesh;

/// Segments per quarter circle.
const SEGMENTS: usize = 3;
/// Vertices of a ring. Each quarter circle has both of its ends; the flat sides lie between neighbouring
/// quarters.
const RING_SIZE: usize = 4 * (SEGMENTS + 1);

/// Returns the box |x|, |y|, |z| ≤ `half_m` whose edges are rounded with radius `radius_m`: the octants of a
/// sphere moved apart to the corners, as rings from bottom to top.
///
/// # Panics
/// If the radius is negative or exceeds a half extent.
pub(crate) fn mesh(half_m: Vec3, radius_m: f32) -> Mesh {
    let fits = radius_m >= 0.0 && half_m.iter().all(|half| radius_m <= *half);
    assert!(fits, "edges of radius {radius_m} m do not fit a box of half extents {half_m:?} m");
    let mut mesh = Mesh::default();
    let lower = (0..=SEGMENTS).rev().map(|step| (step, -1.0));
    let upper = (0..=SEGMENTS).map(|step| (step, 1.0));
    let rings: Vec<[u32; RING_SIZE]> =
        lower.chain(upper).map(|(step, side)| ring(&mut mesh, half_m, radius_m, step, side)).collect();
    for pair in rings.windows(2) {
        band(&mut mesh, &pair[0], &pair[1]);
    }
    // At a pole each quarter circle collapses to one point, a corner of the flat top or bottom.
    let corners = |pole: &[u32; RING_SIZE]| core::array::from_fn(|quarter| pole[quarter * (SEGMENTS + 1)]);
    let [a, b, c, d] = corners(&rings[0]);
    mesh.quad([d, c, b, a]);
    mesh.quad(corners(&rings[rings.len() - 1]));
    mesh.finish()
}

/// Appends the ring that lies `step` segments above the equator of the upper half (`side` = 1) or below that
/// of the lower half (−1), and returns its vertices.
fn ring(mesh: &mut Mesh, half_m: Vec3, radius_m: f32, step: usize, side: f32) -> [u32; RING_SIZE] {
    let (level, height) = on_circle(step, 4 * SEGMENTS);
    core::array::from_fn(|i| {
        let quarter = i / (SEGMENTS + 1);
        // The end of one quarter and the start of the next have the same direction but different centres.
        let (x, y) = on_circle(i - quarter, 4 * SEGMENTS);
        let signs = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]][quarter];
        let normal = [level * x, level * y, side * height];
        let centre = [signs[0], signs[1], side];
        let position = |axis: usize| centre[axis] * (half_m[axis] - radius_m) + radius_m * normal[axis];
        mesh.push(core::array::from_fn(position), normal)
    })
}

#[cfg(test)]
mod tests {
    use super::mesh;
    use crate::math::affine::{dot, sub};
    use crate::mesh::checks::assert_solid;

    #[test]
    fn boxes_are_closed_with_expected_volume() {
        let table: [([f32; 3], f32); 5] = [
            ([0.1, 0.06, 0.02], 0.005),
            ([0.1, 0.06, 0.02], 0.02),
            ([0.05, 0.05, 0.05], 0.05),
            ([0.003, 0.2, 0.3], 0.0001),
            ([0.1, 0.06, 0.02], 0.0),
        ];
        // Area of a quarter disc of three segments and volume of a sphere octant made of the same rings.
        let quarter = 1.5 * 0.5;
        let rings = [1.0, 0.75_f32.sqrt(), 0.5, 0.0];
        let heights = [0.0, 0.5, 0.75_f32.sqrt(), 1.0];
        let slice = |i: usize| {
            let (a, b) = (rings[i], rings[i + 1]);
            quarter * (heights[i + 1] - heights[i]) * (a * a + a * b + b * b) / 3.0
        };
        let eighth: f32 = (0..3).map(slice).sum();
        for (half, r) in table {
            let [x, y, z] = half.map(|half| half - r);
            let flats = x * y * z + r * (x * y + y * z + z * x);
            let volume = 8.0 * (flats + r * r * quarter * (x + y + z) + r * r * r * eighth);
            assert_solid(&(half, r), &mesh(half, r), half.map(|half| 2.0 * half), volume);
        }
    }

    #[test]
    fn surface_is_edge_radius_from_inner_box() {
        let (half, r) = ([0.1, 0.06, 0.02], 0.005);
        let rounded = mesh(half, r);
        for i in 0..rounded.n_vertices() as u32 {
            let p = rounded.position(i);
            let nearest = core::array::from_fn(|axis| p[axis].clamp(r - half[axis], half[axis] - r));
            let off = sub(p, nearest);
            assert!((dot(off, off).sqrt() - r).abs() < 4e-6, "{p:?}");
            assert!((dot(off, rounded.normals[i as usize]) - r).abs() < 4e-6, "{p:?}");
        }
    }
}
