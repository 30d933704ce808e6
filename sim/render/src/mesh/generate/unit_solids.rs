//! Solids of half extent 1, which the scale of an instance stretches to size.

use crate::math::affine::{Vec3, cross};
use crate::math::trig::on_circle;
use crate::mesh::Mesh;

/// Segments of a circle.
const N_SEGMENTS: usize = 64;
/// Segments of a hemisphere from equator to pole.
const N_RINGS: usize = 8;

/// Returns quad, box, cylinder, open cylinder, hemisphere and sphere, the order of `MeshLibrary`.
pub(crate) fn all() -> [Mesh; 6] {
    [quad(), cuboid(), cylinder(true), cylinder(false), hemispheres(&[1.0]), hemispheres(&[1.0, -1.0])]
        .map(Mesh::finish)
}

fn quad() -> Mesh {
    let mut mesh = Mesh::default();
    face(&mut mesh, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]);
    mesh
}

fn cuboid() -> Mesh {
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for side in [1.0, -1.0] {
            let unit = |i: usize, length: f32| {
                let mut v = [0.0; 3];
                v[i % 3] = length;
                v
            };
            // The second edge has the sign of the side, so that the face points outwards.
            face(&mut mesh, unit(axis + 1, 1.0), unit(axis + 2, side), unit(axis, side));
        }
    }
    mesh
}

/// Appends the parallelogram around `centre` spanned by ±`a` and ±`b`, which faces along a × b.
fn face(mesh: &mut Mesh, a: Vec3, b: Vec3, centre: Vec3) {
    let normal = cross(a, b);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(s, t)| mesh.push(core::array::from_fn(|i| centre[i] + s * a[i] + t * b[i]), normal));
    mesh.quad(corners);
}

fn cylinder(with_caps: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let ring = |mesh: &mut Mesh, z: f32, normal: &dyn Fn(f32, f32) -> Vec3| -> Vec<u32> {
        (0..N_SEGMENTS)
            .map(|i| on_circle(i, N_SEGMENTS))
            .map(|(x, y)| mesh.push([x, y, z], normal(x, y)))
            .collect()
    };
    let rings = [-1.0, 1.0].map(|z| ring(&mut mesh, z, &|x, y| [x, y, 0.0]));
    band(&mut mesh, &rings[0], &rings[1]);
    if with_caps {
        for z in [-1.0, 1.0] {
            let rim = ring(&mut mesh, z, &|_, _| [0.0, 0.0, z]);
            let centre = mesh.push([0.0, 0.0, z], [0.0, 0.0, z]);
            for i in 0..N_SEGMENTS {
                let (a, b) = (rim[i], rim[(i + 1) % N_SEGMENTS]);
                mesh.triangle(if z > 0.0 { [centre, a, b] } else { [centre, b, a] });
            }
        }
    }
    mesh
}

/// Returns unit hemispheres: the upper one for a sign of 1, the lower one for −1.
fn hemispheres(signs: &[f32]) -> Mesh {
    let mut mesh = Mesh::default();
    for &sign in signs {
        let rings: Vec<Vec<u32>> = (0..=N_RINGS)
            .map(|ring| {
                let (cos, sin) = on_circle(ring, 4 * N_RINGS);
                let point = |i| {
                    let (x, y) = on_circle(i, N_SEGMENTS);
                    [cos * x, cos * y, sign * sin]
                };
                (0..N_SEGMENTS).map(|i| mesh.push(point(i), point(i))).collect()
            })
            .collect();
        for pair in rings.windows(2) {
            let (lower, upper) = if sign > 0.0 { (&pair[0], &pair[1]) } else { (&pair[1], &pair[0]) };
            band(&mut mesh, lower, upper);
        }
    }
    mesh
}

/// Connects two rings with the same number of vertices, counter-clockwise seen from above.
pub(crate) fn band(mesh: &mut Mesh, lower: &[u32], upper: &[u32]) {
    for i in 0..lower.len() {
        let j = (i + 1) % lower.len();
        mesh.quad([lower[i], lower[j], upper[j], upper[i]]);
    }
}
