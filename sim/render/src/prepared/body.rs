//! Instances of a body: one per visual or, for a body without visuals, one per collision part.
//!
//! A primitive is a scaled library mesh. Every other shape gets a mesh of its own, which equal shapes of a
//! scene share.

use std::sync::Arc;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};

use super::instance::{Anchor, Instance, MeshSource};
use super::material::Material;
use crate::mesh::{Mesh, MeshId, extrusion, lathe, rounded_box, torus};
use scene::{Appearance, Body, Primitive, VisualShape};

/// Meshes generated for one scene, in m, keyed by shape.
#[derive(Default)]
pub(crate) struct OwnMeshes<'a>(Vec<(&'a VisualShape, Arc<Mesh>)>);

/// Appends the instances of one body.
pub(crate) fn push<'a>(
    body_idx: usize,
    body: &'a Body,
    own_meshes: &mut OwnMeshes<'a>,
    instances: &mut Vec<Instance>,
) {
    let placement = |pose: Isometry3<f64>, stretch: [f64; 3], appearance: Appearance| Placement {
        body_idx,
        pose,
        stretch,
        material: appearance.into(),
    };
    if body.visuals.is_empty() {
        for part in &body.parts {
            push_primitive(&part.shape, &placement(part.pose, [1.0; 3], part.appearance), instances);
        }
    }
    for visual in &body.visuals {
        let placement = placement(visual.pose, visual.stretch, visual.appearance);
        push_shape(&visual.shape, &placement, own_meshes, instances);
    }
}

/// Pose of a shape on a body, factors along the shape's own axes, and its material.
struct Placement {
    body_idx: usize,
    pose: Isometry3<f64>,
    stretch: [f64; 3],
    material: Material,
}

impl Placement {
    /// Creates an instance of a mesh whose axes are parallel to those of the shape.
    fn instance(&self, mesh: MeshSource, mut inner: Isometry3<f64>, scale: [f64; 3]) -> Instance {
        for (x, factor) in inner.translation.vector.iter_mut().zip(self.stretch) {
            *x *= factor;
        }
        Instance {
            mesh,
            anchor: Anchor::Body(self.body_idx),
            pose: (self.pose * inner).cast(),
            scale: core::array::from_fn(|axis| (scale[axis] * self.stretch[axis]) as f32),
            material: self.material,
        }
    }
}

fn push_shape<'a>(
    shape: &'a VisualShape,
    placement: &Placement,
    own_meshes: &mut OwnMeshes<'a>,
    instances: &mut Vec<Instance>,
) {
    let mesh = match shape {
        VisualShape::Primitive(primitive) => return push_primitive(primitive, placement, instances),
        VisualShape::RoundedBox { half, edge_radius } => own_meshes
            .get_or_generate(shape, || rounded_box::mesh(half.map(|h| h as f32), *edge_radius as f32)),
        VisualShape::Lathe { profile } => own_meshes.get_or_generate(shape, || lathe::mesh(&points(profile))),
        VisualShape::Torus { major_radius, minor_radius } => {
            own_meshes.get_or_generate(shape, || torus::mesh(*major_radius as f32, *minor_radius as f32))
        }
        VisualShape::Extrusion { outline, holes, half_height } => own_meshes.get_or_generate(shape, || {
            let holes: Vec<_> = holes.iter().map(|hole| points(hole)).collect();
            let holes: Vec<_> = holes.iter().map(Vec::as_slice).collect();
            extrusion::mesh(&points(outline), &holes, *half_height as f32)
        }),
    };
    instances.push(placement.instance(MeshSource::Own(mesh), Isometry3::identity(), [1.0; 3]));
}

impl<'a> OwnMeshes<'a> {
    /// Returns the mesh of `shape`, generating it with `generate` on the first request.
    fn get_or_generate(&mut self, shape: &'a VisualShape, generate: impl FnOnce() -> Mesh) -> Arc<Mesh> {
        if let Some((_, mesh)) = self.0.iter().find(|(known, _)| *known == shape) {
            return Arc::clone(mesh);
        }
        let mesh = Arc::new(generate());
        self.0.push((shape, Arc::clone(&mesh)));
        mesh
    }
}

fn points(points: &[[f64; 2]]) -> Vec<[f32; 2]> {
    points.iter().map(|p| p.map(|x| x as f32)).collect()
}

/// Appends the instances of a primitive, scaled to its exact size.
fn push_primitive(primitive: &Primitive, placement: &Placement, instances: &mut Vec<Instance>) {
    let mut push = |mesh, inner, scale| {
        instances.push(placement.instance(MeshSource::Library(mesh), inner, scale));
    };
    let centred = Isometry3::identity();
    match *primitive {
        Primitive::Box { half } => push(MeshId::Box, centred, half),
        Primitive::Cylinder { radius, half_height } => {
            push(MeshId::Cylinder, centred, [radius, radius, half_height]);
        }
        Primitive::Ball { radius } => push(MeshId::Sphere, centred, [radius; 3]),
        Primitive::Capsule { radius, half_height } => {
            let upper = Isometry3::translation(0.0, 0.0, half_height);
            let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
            push(MeshId::OpenCylinder, centred, [radius, radius, half_height]);
            push(MeshId::Hemisphere, upper, [radius; 3]);
            push(MeshId::Hemisphere, half_turn * upper, [radius; 3]);
        }
        Primitive::Hull { .. } => unreachable!("a body whose shapes include a hull has visuals"),
    }
}
