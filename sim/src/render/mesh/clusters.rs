//! Clusters: runs of successive triangles that lie close together and look alike, so that a renderer can pass over a
//! whole run that looks away from the eye or lies outside its picture.

use core::cmp::Ordering;

use super::{Mesh, bounding_sphere};
use crate::render::math::affine::{Vec3, add, cross, dot, normalised, scaled};

/// Triangles of a cluster; the last of a mesh may have fewer.
pub(in crate::render) const CLUSTER_SIZE: usize = 16;
/// Added to every cutoff, well above the rounding errors of the test in single precision.
const SLACK: f32 = 1e-4;
/// A cutoff that no eye reaches, for normals that do not fit a half space.
const NEVER: f32 = 2.0;

/// Bounds of a run of triangles in the mesh's frame.
///
/// The cluster is wholly back-facing for an eye E if, with v = `centre` − E and d = |v|,
///
/// > v · `axis` ≥ `cutoff` · d + `radius`.
///
/// This never passes over a triangle that faces the eye. Let θ < 90° be the greatest angle between `axis` and a
/// triangle's unit normal n, `cutoff` = sin θ, and φ the angle between `axis` and v. The condition is
/// cos φ ≥ sin θ + radius / d; so cos φ ≥ sin θ and φ = 90° − θ − δ for a δ ≥ 0. Then
///
/// > radius / d ≤ cos φ − sin θ = sin(θ + δ) − sin θ = sin θ (cos δ − 1) + cos θ sin δ ≤ sin δ.
///
/// The angle between v and n is at most φ + θ = 90° − δ, so v · n ≥ d sin δ ≥ radius. A corner p of the triangle is within
/// `radius` of `centre`, so (p − E) · n ≥ v · n − radius ≥ 0: the eye is not in front of the triangle's plane. ∎
///
/// A greater cutoff culls less and is safe too. ProjectionAxis is kept by every affine map that does not mirror, so an eye may be
/// taken to the frame of a mesh that is drawn stretched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::render) struct Cluster {
    /// Centre of a sphere that holds the vertices.
    pub(in crate::render) centre: Vec3,
    /// Radius of that sphere.
    pub(in crate::render) radius: f32,
    /// Unit axis of a cone that holds the triangles' normals; zero where these cancel out.
    pub(in crate::render) axis: Vec3,
    /// Sine of the cone's half angle and some slack; 2, which no eye reaches, if that is not below a right angle.
    pub(in crate::render) cutoff: f32,
}

/// Reorders the triangles of a finished mesh so that every run of [`CLUSTER_SIZE`] is compact in space and in normal.
pub(super) fn order(mesh: &mut Mesh) {
    let mut items: Vec<Item> = (0..mesh.triangles.len()).map(|index| Item::new(mesh, index)).collect();
    split(&mut items);
    mesh.triangles = items.iter().map(|item| mesh.triangles[item.index]).collect();
    mesh.projection_axes = items.iter().map(|item| mesh.projection_axes[item.index]).collect();
}

/// The cluster of every run of [`CLUSTER_SIZE`] triangles.
pub(super) fn of(mesh: &Mesh) -> Vec<Cluster> {
    mesh.triangles.chunks(CLUSTER_SIZE).map(|run| cluster(mesh, run)).collect()
}

fn cluster(mesh: &Mesh, run: &[[u32; 3]]) -> Cluster {
    let (centre, radius) = bounding_sphere(run.iter().flatten().map(|i| mesh.position(*i)));
    let normals: Vec<Vec3> = run.iter().map(|corners| face_normal(mesh, *corners)).collect();
    let axis = normals.iter().copied().fold([0.0; 3], add);
    // A sum of zero leaves no direction, and no normal agrees with it.
    let axis = if dot(axis, axis) > 0.0 { normalised(axis) } else { axis };
    let fits = normals.iter().all(|n| dot(*n, axis) > 0.0);
    // The sine from the cross product is exact to rounding even for a flat cluster, where that from the cosine is not.
    let sine = normals.iter().map(|n| cross(*n, axis)).map(|s| dot(s, s).sqrt()).fold(0.0, f32::max);
    Cluster { centre, radius, axis, cutoff: if fits { sine + SLACK } else { NEVER } }
}

/// Unit normal of a triangle, computed in double precision: a sliver's would be far off in single.
fn face_normal(mesh: &Mesh, corners: [u32; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|i| mesh.position(i).map(f64::from));
    let normal: [f64; 3] = core::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j])
    });
    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
    normal.map(|x| (x / length) as f32)
}

/// A triangle while it is sorted.
struct Item {
    /// Its place in the mesh, which decides between equals.
    index: usize,
    /// Centroid in units of the mesh's radius, then unit normal.
    key: [f32; 6],
}

impl Item {
    fn new(mesh: &Mesh, index: usize) -> Self {
        let corners = mesh.triangles[index];
        let sum = corners.map(|i| mesh.position(i)).into_iter().fold([0.0; 3], add);
        let [x, y, z] = scaled(sum, 1.0 / (3.0 * mesh.radius));
        let [l, m, n] = face_normal(mesh, corners);
        Self { index, key: [x, y, z, l, m, n] }
    }

    fn along(&self, axis: usize, other: &Self) -> Ordering {
        self.key[axis].total_cmp(&other.key[axis]).then(self.index.cmp(&other.index))
    }
}

/// Halves the items across the axis along which they differ most, and each half in turn, down to single clusters; only these
/// are sorted.
fn split(items: &mut [Item]) {
    if items.len() <= CLUSTER_SIZE {
        return;
    }
    let axis = widest(items);
    // The first half is whole clusters, so that only the last of all can be short.
    let middle = (items.len() / 2 + CLUSTER_SIZE / 2) / CLUSTER_SIZE * CLUSTER_SIZE;
    items.select_nth_unstable_by(middle, |a, b| a.along(axis, b));
    let (low, high) = items.split_at_mut(middle);
    for half in [low, high] {
        if half.len() <= CLUSTER_SIZE {
            half.sort_unstable_by(|a, b| a.along(axis, b));
        } else {
            split(half);
        }
    }
}

/// The axis of the key along which the items' variance is greatest; the first of equals. Their extent would be that of the few
/// at the ends.
fn widest(items: &[Item]) -> usize {
    let variance = |axis: usize| {
        let values = items.iter().map(|item| item.key[axis]);
        let mean = values.clone().sum::<f32>() / items.len() as f32;
        values.map(|value| (value - mean) * (value - mean)).sum::<f32>()
    };
    let variances: [f32; 6] = core::array::from_fn(variance);
    (1..6).fold(0, |best, axis| if variances[axis] > variances[best] { axis } else { best })
}

#[cfg(test)]
mod tests {
    use super::super::{MeshId, MeshLibrary, extrusion, lathe, rounded_box, torus};
    use super::{CLUSTER_SIZE, Cluster, Mesh, NEVER, of, order};
    use crate::render::math::affine::{Vec3, dot, scaled, sub};
    use crate::render::math::trig::on_circle;

    /// A ball of radius 0.1 m with some 3,000 triangles.
    fn ball() -> Mesh {
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
            ("ball", ball()),
            ("bowl", lathe::mesh(&bowl)),
            ("torus", torus::mesh(0.05, 0.01)),
            ("ell", extrusion::mesh(&ell, &[], 0.002)),
            ("rounded", rounded_box::mesh([0.1, 0.06, 0.02], 0.005)),
        ]
    }

    /// Points in the cube of half extent 1 from a linear congruence.
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

    /// Six times the volume between the eye and the triangle, in double precision: positive if it faces the eye.
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
        let clusters = of(mesh);
        clusters.iter().filter(|cluster| is_culled(cluster, eye)).count() as f32 / clusters.len() as f32
    }

    fn assert_nothing_seen_is_culled(name: &str, mesh: &Mesh) {
        let clusters = of(mesh);
        // Eyes at all distances, down to inside the mesh.
        for (i, point) in points(200).enumerate() {
            let eye = scaled(point, mesh.radius * [0.5, 1.0, 1.5, 5.0, 100.0][i % 5]);
            let runs = clusters.iter().zip(mesh.triangles.chunks(CLUSTER_SIZE));
            for (cluster, run) in runs.filter(|(cluster, _)| is_culled(cluster, eye)) {
                let seen = run.iter().find(|corners| faces(mesh, **corners, eye));
                assert!(seen.is_none(), "{name}: {seen:?} of {cluster:?} faces {eye:?}");
            }
        }
    }

    #[test]
    fn no_triangle_of_a_culled_cluster_faces_the_eye() {
        for (name, mut mesh) in meshes() {
            assert_nothing_seen_is_culled(name, &mesh);
            order(&mut mesh);
            assert_nothing_seen_is_culled(name, &mesh);
        }
        let library = MeshLibrary::new();
        assert_nothing_seen_is_culled("link", library.get(MeshId::Link(5)));
    }

    #[test]
    fn about_half_of_a_ball_is_culled_for_a_far_eye() {
        let mesh = ball();
        for point in points(50).filter(|p| dot(*p, *p) > 0.1) {
            let share = culled_share(&mesh, scaled(point, 100.0));
            assert!((0.36..0.5).contains(&share), "{share} from {point:?}");
        }
    }

    #[test]
    fn order_keeps_every_triangle_with_its_facing() {
        for (name, mut mesh) in meshes() {
            let pairs = |mesh: &Mesh| {
                let mut pairs: Vec<_> =
                    mesh.triangles.iter().zip(&mesh.projection_axes).map(|(t, f)| (*t, *f as u8)).collect();
                pairs.sort_unstable();
                pairs
            };
            let before = pairs(&mesh);
            order(&mut mesh);
            assert!(before == pairs(&mesh), "{name}");
            assert_eq!(of(&mesh).len(), mesh.triangles.len().div_ceil(CLUSTER_SIZE), "{name}");
        }
    }

    #[test]
    fn order_is_the_same_every_time() {
        for ((name, mut a), (_, mut b)) in meshes().into_iter().zip(meshes()) {
            order(&mut a);
            order(&mut b);
            assert!(a.triangles == b.triangles && of(&a) == of(&b), "{name}");
        }
    }

    #[test]
    fn clusters_are_as_compact_as_their_area_allows() {
        let mesh = ball();
        let clusters = of(&mesh);
        let mean = clusters.iter().map(|cluster| cluster.radius).sum::<f32>() / clusters.len() as f32;
        // A round patch of the same share of the ball of 0.1 m would have this radius.
        let round = 0.1 * 2.0 / (clusters.len() as f32).sqrt();
        assert!(mean < 1.6 * round, "{mean}, where a disc would have {round}");
    }

    #[test]
    fn normals_all_around_are_never_culled() {
        // A box of twelve triangles is one cluster.
        let mesh = rounded_box::mesh([0.1; 3], 0.0);
        let clusters = of(&mesh);
        assert_eq!((clusters.len(), clusters[0].cutoff), (1, NEVER));
    }
}
