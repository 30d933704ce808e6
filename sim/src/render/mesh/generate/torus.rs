//! The torus about z: a lathe's turn of a circle.

use super::lathe::{self, n_around};
use crate::render::math::trig::on_circle;
use crate::render::mesh::Mesh;

/// A tube of radius `minor_m` around the circle of radius `major_m` at z 0.
///
/// # Panics
/// If the tube is wider than the hole leaves room for.
pub(in crate::render) fn mesh(major_m: f32, minor_m: f32) -> Mesh {
    assert!(minor_m <= major_m, "a tube of radius {minor_m} m cannot go around a circle of {major_m} m");
    let n = n_around(minor_m);
    let profile: Vec<_> = (0..=n)
        .map(|i| {
            let (cos, sin) = on_circle(i, n);
            [major_m + minor_m * cos, minor_m * sin]
        })
        .collect();
    lathe::mesh(&profile)
}

#[cfg(test)]
mod tests {
    use super::super::lathe::n_around;
    use super::mesh;
    use crate::render::mesh::checks::{assert_solid, polygon_area};

    #[test]
    fn tori_have_the_size_and_volume_of_pappus() {
        for (major, minor) in [(0.05, 0.01), (0.02, 0.002), (0.2, 0.15)] {
            let wide = 2.0 * (major + minor);
            let turn = 2.0 * polygon_area(n_around(major + minor)) * major;
            let volume = turn * polygon_area(n_around(minor)) * minor * minor;
            assert_solid(&(major, minor), &mesh(major, minor), [wide, wide, 2.0 * minor], volume);
        }
    }

    #[test]
    fn no_edge_of_a_torus_is_sharp() {
        let (major, minor) = (0.05, 0.01);
        let torus = mesh(major, minor);
        for i in 0..torus.n_vertices() {
            let [x, y, z] = torus.position(i as u32);
            let out = (x * x + y * y).sqrt() - major;
            let [l, m, n] = torus.normals[i];
            let radial = (l * x + m * y) / (x * x + y * y).sqrt();
            assert!((radial * minor - out).abs() < 1e-5 && (n * minor - z).abs() < 1e-5, "vertex {i}");
        }
    }
}
