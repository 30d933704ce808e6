//! Assertions shared by the tests of all mesh generators.

use core::f32::consts::TAU;
use core::fmt::Debug;

use super::Mesh;
use crate::math::affine::{Vec3, add, cross, dot, sub};

/// Returns the directed edges of a mesh, sorted. Their ends are positions rather than vertices, because faces
/// that meet at a sharp edge share no vertices.
fn edges(mesh: &Mesh) -> Vec<[[u32; 3]; 2]> {
    // Adding zero maps −0 to 0.
    let position = |i: u32| mesh.position(i).map(|x| (x + 0.0).to_bits());
    let sides = mesh.triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
    let mut edges: Vec<[[u32; 3]; 2]> = sides.map(|side| side.map(position)).collect();
    edges.sort_unstable();
    edges
}

/// Asserts that every edge has a triangle on either side.
pub(crate) fn assert_closed(name: &dyn Debug, mesh: &Mesh) {
    let forward = edges(mesh);
    let mut backward: Vec<_> = forward.iter().map(|[a, b]| [*b, *a]).collect();
    backward.sort_unstable();
    assert!(forward == backward, "{name:?}: an edge has a triangle on one side only");
}

/// Asserts that all normals have unit length and point to the side from which their triangles are
/// counter-clockwise.
pub(crate) fn assert_normals_follow_faces(name: &dyn Debug, mesh: &Mesh) {
    // A few slivers along rounded creases may deviate.
    let (mut area, mut wrong) = (0.0, 0.0);
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| mesh.position(i));
        let [l, m, n] = corners.map(|i| mesh.normals[i as usize]);
        let face = cross(sub(b, a), sub(c, a));
        let size = dot(face, face).sqrt();
        area += size;
        wrong += if dot(face, add(add(l, m), n)) <= 0.0 { size } else { 0.0 };
    }
    assert!(wrong <= 0.002 * area, "{name:?}: {wrong} of {area}");
    assert!(
        mesh.normals.iter().all(|n| (dot(*n, *n) - 1.0).abs() < 1e-3),
        "{name:?}: a normal does not have unit length"
    );
}

/// Returns the size of the mesh along x, y and z, in m.
pub(crate) fn extents_m(mesh: &Mesh) -> Vec3 {
    core::array::from_fn(|axis| {
        let coordinates = || mesh.positions[axis].iter().copied();
        coordinates().fold(f32::MIN, f32::max) - coordinates().fold(f32::MAX, f32::min)
    })
}

/// Asserts that a mesh is closed, has outward-facing triangles and has about this size and volume.
pub(crate) fn assert_solid(name: &dyn Debug, mesh: &Mesh, extents_m: Vec3, volume_m3: f32) {
    assert_closed(name, mesh);
    assert_normals_follow_faces(name, mesh);
    assert_eq!(mesh.projection_axes.len(), mesh.triangles.len(), "{name:?}");
    let found = self::extents_m(mesh);
    for (size, expected) in found.into_iter().zip(extents_m) {
        assert!((size - expected).abs() < 1e-5 + 4e-5 * expected, "{name:?}: {found:?} for {extents_m:?}");
    }
    // The divergence theorem: negative if the mesh is inside out.
    let sixfold: f32 = mesh
        .triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|i| sub(mesh.position(i), mesh.centre));
            dot(a, cross(b, c))
        })
        .sum();
    assert!(
        (sixfold / 6.0 - volume_m3).abs() < 3e-4 * volume_m3,
        "{name:?}: {} for {volume_m3}",
        sixfold / 6.0
    );
}

/// Returns the area of the regular n-gon inscribed in the unit circle.
pub(crate) fn polygon_area(n: usize) -> f32 {
    0.5 * n as f32 * libm::sinf(TAU / n as f32)
}
