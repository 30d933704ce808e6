//! Clusters of triangles with a bounding sphere and a normal cone, so that a renderer can cull all triangles
//! of a cluster at once if they face away from the eye or lie outside the image.

use core::cmp::Ordering;

use super::triangle_mesh::{Mesh, bounding_sphere};
use crate::math::affine::{Vec3, add, cross, dot, normalised, scaled};

/// Triangles per cluster. The last cluster of a mesh may have fewer.
pub(crate) const CLUSTER_SIZE: usize = 16;
/// Margin added to every cutoff, well above the rounding error of the culling test in single precision.
const SLACK: f32 = 1e-4;
/// Cutoff of a cluster that is never culled because its normals do not fit into a half space.
const NEVER_CULLED: f32 = 2.0;

/// Bounds of a cluster, in the mesh frame.
///
/// Every triangle of the cluster is back-facing for an eye E if, with v = `centre` − E and d = |v|,
///
/// > v · `axis` ≥ `cutoff` · d + `radius`.
///
/// The test never culls a triangle that faces the eye. Proof: let θ < 90° be the largest angle between `axis`
/// and the unit normal n of a triangle, `cutoff` = sin θ, and φ the angle between `axis` and v. The condition
/// is cos φ ≥ sin θ + radius / d, hence cos φ ≥ sin θ and φ = 90° − θ − δ for some δ ≥ 0. Then
///
/// > radius / d ≤ cos φ − sin θ = sin(θ + δ) − sin θ = sin θ (cos δ − 1) + cos θ sin δ ≤ sin δ.
///
/// The angle between v and n is at most φ + θ = 90° − δ, so v · n ≥ d sin δ ≥ radius. A corner p of the
/// triangle lies within `radius` of `centre`, so (p − E) · n ≥ v · n − radius ≥ 0: the eye is not in front of
/// the triangle's plane. ∎
///
/// A larger cutoff culls less and is therefore also safe. An affine transform that does not mirror preserves
/// facing, so the test works in the mesh frame of an instance with nonuniform scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cluster {
    /// Centre of the bounding sphere.
    pub(crate) centre: Vec3,
    /// Radius of the bounding sphere.
    pub(crate) radius: f32,
    /// Unit axis of the normal cone; zero if the normals cancel out.
    pub(crate) axis: Vec3,
    /// Sine of the half angle of the normal cone plus a margin, or 2 (never culled) if the half angle is not
    /// below 90°.
    pub(crate) cutoff: f32,
}

/// Sorts the triangles of a mesh so that every chunk of [`CLUSTER_SIZE`] is compact in position and normal.
pub(crate) fn sort_triangles(mesh: &mut Mesh) {
    let mut keys: Vec<TriangleKey> =
        (0..mesh.triangles.len()).map(|index| TriangleKey::new(mesh, index)).collect();
    partition(&mut keys);
    mesh.triangles = keys.iter().map(|key| mesh.triangles[key.index]).collect();
    mesh.projection_axes = keys.iter().map(|key| mesh.projection_axes[key.index]).collect();
}

/// Computes the bounds of every chunk of [`CLUSTER_SIZE`] triangles.
pub(crate) fn compute(mesh: &Mesh) -> Vec<Cluster> {
    mesh.triangles.chunks(CLUSTER_SIZE).map(|triangles| cluster(mesh, triangles)).collect()
}

fn cluster(mesh: &Mesh, triangles: &[[u32; 3]]) -> Cluster {
    let (centre, radius) = bounding_sphere(triangles.iter().flatten().map(|i| mesh.position(*i)));
    let normals: Vec<Vec3> = triangles.iter().map(|corners| face_normal(mesh, *corners)).collect();
    let axis = normals.iter().copied().fold([0.0; 3], add);
    // A sum of zero has no direction, and then no normal passes the check below.
    let axis = if dot(axis, axis) > 0.0 { normalised(axis) } else { axis };
    let fits = normals.iter().all(|n| dot(*n, axis) > 0.0);
    // Computed by a cross product: unlike √(1 − cos²), it is accurate for flat clusters too.
    let sine = normals.iter().map(|n| cross(*n, axis)).map(|s| dot(s, s).sqrt()).fold(0.0, f32::max);
    Cluster { centre, radius, axis, cutoff: if fits { sine + SLACK } else { NEVER_CULLED } }
}

/// Returns the unit normal of a triangle, computed in double precision: single precision fails for slivers.
fn face_normal(mesh: &Mesh, corners: [u32; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|i| mesh.position(i).map(f64::from));
    let normal: [f64; 3] = core::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j])
    });
    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
    normal.map(|x| (x / length) as f32)
}

/// Sort key of a triangle.
struct TriangleKey {
    /// Index in the mesh; breaks ties.
    index: usize,
    /// Centroid in units of the mesh radius, then unit normal.
    coordinates: [f32; 6],
}

impl TriangleKey {
    fn new(mesh: &Mesh, index: usize) -> Self {
        let corners = mesh.triangles[index];
        let sum = corners.map(|i| mesh.position(i)).into_iter().fold([0.0; 3], add);
        let [x, y, z] = scaled(sum, 1.0 / (3.0 * mesh.radius));
        let [l, m, n] = face_normal(mesh, corners);
        Self { index, coordinates: [x, y, z, l, m, n] }
    }

    fn cmp_along(&self, axis: usize, other: &Self) -> Ordering {
        self.coordinates[axis].total_cmp(&other.coordinates[axis]).then(self.index.cmp(&other.index))
    }
}

/// Splits the keys recursively at the median of the axis of greatest variance, down to single clusters. Only
/// these are sorted.
fn partition(keys: &mut [TriangleKey]) {
    if keys.len() <= CLUSTER_SIZE {
        return;
    }
    let axis = max_variance_axis(keys);
    // The first half consists of whole clusters, so only the last cluster of the mesh can be short.
    let middle = (keys.len() / 2 + CLUSTER_SIZE / 2) / CLUSTER_SIZE * CLUSTER_SIZE;
    keys.select_nth_unstable_by(middle, |a, b| a.cmp_along(axis, b));
    let (low, high) = keys.split_at_mut(middle);
    for half in [low, high] {
        if half.len() <= CLUSTER_SIZE {
            half.sort_unstable_by(|a, b| a.cmp_along(axis, b));
        } else {
            partition(half);
        }
    }
}

/// Returns the coordinate of greatest variance, the first of equals. Variance is used instead of extent
/// because the extent depends on outliers alone.
fn max_variance_axis(keys: &[TriangleKey]) -> usize {
    let variance = |axis: usize| {
        let values = keys.iter().map(|key| key.coordinates[axis]);
        let mean = values.clone().sum::<f32>() / keys.len() as f32;
        values.map(|value| (value - mean) * (value - mean)).sum::<f32>()
    };
    let variances: [f32; 6] = core::array::from_fn(variance);
    (1..6).fold(0, |best, axis| if variances[axis] > variances[best] { axis } else { best })
}

#[cfg(test)]
mod tests {
    use super::super::{MeshId, MeshLibrary, extrusion, lathe, rounded_box, torus};
    use super::{CLUSTER_SIZE, Cluster, Mesh, NEVER_CULLED, compute, sort_triangles};
    use crate::math::affine::{Vec3, dot, scaled, sub};
    use crate::math::trig::on_circle;

    /// Returns a sphere of radius 0.1 m with about 3,000 triangles.
    fn sphere() -> Mesh {
        let half = 32;
        let arc =
            (1..half).map(|i| on_circle(i + 3 * half / 2, 2 * half)).map(|(cos, sin)| [0.1 * cos, 0.1 * sin]);
        let profile: Vec<[f32; 2]> = core::iter::once([0.0, -0.1]).chain(arc).chain([[0.0, 0.1]]).collect();
        lathe::mesh(&profile)
    }

    fn meshes() -> Vec<(&'static str, Mesh)> {
        let bowl = [[0.0, 0.0], [0.03, 0.0], [0.08, 0.06], [0.075, 0.06], [0.03, 0.005], [0.0, 0.005]];
        let ell = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.03], [0.04, 0.03], [0.04, 0.1], [0.0, 0.1]];
        vec![
            ("sphere", sphere()),
            ("bowl", lathe::mesh(&bowl)),
            ("torus", torus::mesh(0.05, 0.01)),
            ("ell", extrusion::mesh(&ell, &[], 0.002)),
            ("rounded", rounded_box::mesh([0.1, 0.06, 0.02], 0.005)),
        ]
    }

    /// Returns pseudo-random points in the cube of half extent 1, from a linear congruential generator.
    fn points(n: usize) -> impl Iterator<Item = Vec3> {
        let mut state = 1_u64;
        let mut draw = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 23) as f32 - 1.0
        };
        (0..n).map(move |_| core::array::from_fn(|_| draw()))
    }

    fn is_culled(cluster: &Cluster, eye: Vec3) -> bool {
        let v = sub(cluster.centre, eye);
        dot(v, cluster.axis) >= cluster.cutoff * dot(v, v).sqrt() + cluster.radius
    }

    /// Returns `true` if a triangle faces the eye, by the sign of the volume that they span, in double
    /// precision.
    fn faces(mesh: &Mesh, corners: [u32; 3], eye: Vec3) -> bool {
        let off = |i: u32| -> [f64; 3] {
            let p = mesh.position(i);
            core::array::from_fn(|axis| f64::from(p[axis]) - f64::from(eye[axis]))
        };
        let [a, b, c] = corners.map(off);
        let minor = |j: usize, k: usize| b[j] * c[k] - b[k] * c[j];
        a[0] * minor(1, 2) + a[1] * minor(2, 0) + a[2] * minor(0, 1) < 0.0
    }

    fn culled_share(mesh: &Mesh, eye: Vec3) -> f32 {
        let clusters = compute(mesh);
        clusters.iter().filter(|cluster| is_culled(cluster, eye)).count() as f32 / clusters.len() as f32
    }

    fn assert_no_visible_triangle_culled(name: &str, mesh: &Mesh) {
        let clusters = compute(mesh);
        // Eyes at various distances, some of them inside the mesh.
        for (i, point) in points(200).enumerate() {
            let eye = scaled(point, mesh.radius * [0.5, 1.0, 1.5, 5.0, 100.0][i % 5]);
            let chunks = clusters.iter().zip(mesh.triangles.chunks(CLUSTER_SIZE));
            for (cluster, chunk) in chunks.filter(|(cluster, _)| is_culled(cluster, eye)) {
                let visible = chunk.iter().find(|corners| faces(mesh, **corners, eye));
                assert!(visible.is_none(), "{name}: {visible:?} of {cluster:?} faces {eye:?}");
            }
        }
    }

    #[test]
    fn culled_clusters_contain_no_visible_triangle() {
        for (name, mut mesh) in meshes() {
            assert_no_visible_triangle_culled(name, &mesh);
            sort_triangles(&mut mesh);
            assert_no_visible_triangle_culled(name, &mesh);
        }
        let library = MeshLibrary::new();
        assert_no_visible_triangle_culled("link", library.get(MeshId::Link(5)));
    }

    #[test]
    fn distant_eye_culls_about_half_of_sphere() {
        let mesh = sphere();
        for point in points(50).filter(|p| dot(*p, *p) > 0.1) {
            let share = culled_share(&mesh, scaled(point, 100.0));
            assert!((0.36..0.5).contains(&share), "{share} from {point:?}");
        }
    }

    #[test]
    fn sorting_preserves_triangles_and_projection_axes() {
        for (name, mut mesh) in meshes() {
            let pairs = |mesh: &Mesh| {
                let mut pairs: Vec<_> =
                    mesh.triangles.iter().zip(&mesh.projection_axes).map(|(t, f)| (*t, *f as u8)).collect();
                pairs.sort_unstable();
                pairs
            };
            let before = pairs(&mesh);
            sort_triangles(&mut mesh);
            assert!(before == pairs(&mesh), "{name}");
            assert_eq!(compute(&mesh).len(), mesh.triangles.len().div_ceil(CLUSTER_SIZE), "{name}");
        }
    }

    #[test]
    fn sorting_is_deterministic() {
        for ((name, mut a), (_, mut b)) in meshes().into_iter().zip(meshes()) {
            sort_triangles(&mut a);
            sort_triangles(&mut b);
            assert!(a.triangles == b.triangles && compute(&a) == compute(&b), "{name}");
        }
    }

    #[test]
    fn clusters_are_compact() {
        let mesh = sphere();
        let clusters = compute(&mesh);
        let mean = clusters.iter().map(|cluster| cluster.radius).sum::<f32>() / clusters.len() as f32;
        // Radius of a disc that covers the same share of the sphere of radius 0.1 m.
        let disc = 0.1 * 2.0 / (clusters.len() as f32).sqrt();
        assert!(mean < 1.6 * disc, "mean radius {mean}, a disc has {disc}");
    }

    #[test]
    fn clusters_with_opposing_normals_are_never_culled() {
        // The twelve triangles of a box form one cluster.
        let mesh = rounded_box::mesh([0.1; 3], 0.0);
        let clusters = compute(&mesh);
        assert_eq!((clusters.len(), clusters[0].cutoff), (1, NEVER_CULLED));
    }
}
