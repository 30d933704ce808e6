//! Tori about z: the surface of revolution of a circle.

use super::lathe::{self, n_segments};
use crate::math::trig::on_circle;
use crate::mesh::Mesh;

/// Returns the torus with minor radius `minor_m` around the circle of radius `major_m` at z = 0.
///
/// # Panics
/// If `minor_m` exceeds `major_m`.
pub(crate) fn mesh(major_m: f32, minor_m: f32) -> Mesh {
    assert!(
        minor_m <= major_m,
        "the minor radius of a torus ({minor_m} m) exceeds its major radius ({major_m} m)"
    );
    let n = n_segments(minor_m);
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
    use super::super::lathe::n_segments;
    use super::mesh;
    use crate::mesh::checks::{assert_solid, polygon_area};

    #[test]
    fn tori_match_pappus_theorem() {
        for (major, minor) in [(0.05, 0.01), (0.02, 0.002), (0.2, 0.15)] {
            let wide = 2.0 * (major + minor);
            let turn = 2.0 * polygon_area(n_segments(major + minor)) * major;
            let volume = turn * polygon_area(n_segments(minor)) * minor * minor;
            assert_solid(&(major, minor), &mesh(major, minor), [wide, wide, 2.0 * minor], volume);
        }
    }

    #[test]
    fn torus_normals_are_smooth() {
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
