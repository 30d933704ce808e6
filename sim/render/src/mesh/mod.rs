//! Triangle meshes, all generated from formulas. Every rendered instance is one of them under an affine
//! transform.
//!
//! `generate` covers solids with a closed-form boundary and `sdf` the Panda's housings. No mesh is read from
//! a file.

#[cfg(test)]
mod checks;
mod clusters;
mod finish;
mod generate;
mod library;
mod packed;
mod packing;
mod sdf;
mod triangle_mesh;

pub(crate) use generate::{extrusion, lathe, rounded_box, torus};
pub(crate) use library::{FIRST_TRIMMED_LINK, MeshId, MeshLibrary};
pub(crate) use packed::{ClusterBounds, ClusterCorners, PackedMesh, TriangleRecord, Vec3x16};
pub(crate) use triangle_mesh::{Mesh, ProjectionAxis};

#[cfg(test)]
mod tests {
    use super::{Mesh, MeshId, MeshLibrary, ProjectionAxis, checks, packing, torus};
    use crate::math::affine::{dot, scaled, sub};

    #[test]
    fn fingerprint_depends_on_everything_visible() {
        let mut mesh = torus::mesh(0.05, 0.01);
        let first = mesh.fingerprint;
        assert_eq!(first, torus::mesh(0.05, 0.01).fingerprint);
        assert_ne!(first, torus::mesh(0.05, 0.011).fingerprint);
        mesh.normals[7] = scaled(mesh.normals[7], -1.0);
        let (second, facing) = (mesh.rehash(), mesh.projection_axes[3]);
        assert_ne!(second, first);
        mesh.projection_axes[3] =
            if facing == ProjectionAxis::X { ProjectionAxis::Y } else { ProjectionAxis::X };
        assert_ne!(mesh.rehash(), second);
    }

    impl Mesh {
        fn rehash(&mut self) -> u64 {
            self.packed = packing::pack(self);
            self.content_hash()
        }
    }

    const CLOSED: [MeshId; 12] = [
        MeshId::Box,
        MeshId::Cylinder,
        MeshId::Sphere,
        MeshId::Link(0),
        MeshId::Link(1),
        MeshId::Link(2),
        MeshId::Link(3),
        MeshId::Link(4),
        MeshId::Link(5),
        MeshId::Link(6),
        MeshId::Link(7),
        MeshId::Hand,
    ];

    #[test]
    fn closed_meshes_have_no_holes() {
        let library = MeshLibrary::new();
        for id in CLOSED {
            checks::assert_closed(&id, library.get(id));
        }
    }

    #[test]
    fn winding_agrees_with_normals() {
        let library = MeshLibrary::new();
        for id in CLOSED.into_iter().chain([MeshId::Quad, MeshId::OpenCylinder, MeshId::Hemisphere]) {
            checks::assert_normals_follow_faces(&id, library.get(id));
        }
    }

    #[test]
    fn links_match_extents_of_collision_hulls() {
        // Extents of the collision hulls of links 0 to 7, in m (docs/benchmark.md, "Robot and control").
        let hulls = [
            [0.226, 0.189, 0.140],
            [0.110, 0.185, 0.247],
            [0.110, 0.249, 0.185],
            [0.192, 0.166, 0.176],
            [0.193, 0.179, 0.166],
            [0.110, 0.185, 0.317],
            [0.180, 0.133, 0.100],
            [0.125, 0.125, 0.055],
        ];
        let library = MeshLibrary::new();
        for (link, hull) in hulls.into_iter().enumerate() {
            for (size, extent) in checks::extents_m(library.get(MeshId::Link(link))).into_iter().zip(hull) {
                assert!((size - extent).abs() < 0.016, "link {link}: {size} for {extent}");
            }
        }
    }

    #[test]
    fn bounding_sphere_contains_mesh() {
        let library = MeshLibrary::new();
        for id in CLOSED {
            let mesh = library.get(id);
            for i in 0..mesh.n_vertices() as u32 {
                let off = sub(mesh.position(i), mesh.centre);
                assert!(dot(off, off).sqrt() <= mesh.radius * 1.000_01, "{id:?}");
            }
        }
    }
}
