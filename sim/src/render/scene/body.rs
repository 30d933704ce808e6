//! Bodies out of meshes: their visuals or, where there are none, their parts. A primitive is a mesh of the library drawn
//! out to size; any other form has a mesh of the scene's own, and equal forms share one.

use std::sync::Arc;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};

use super::material::Material;
use super::{Anchor, Instance, MeshSource};
use crate::render::mesh::{Mesh, MeshId, extrusion, lathe, rounded_box, torus};
use crate::scene::{Appearance, Body, Primitive, VisualShape};

/// Meshes made for one scene, in m, each with the form it was made of.
#[derive(Default)]
pub(in crate::render) struct OwnMeshes<'a>(Vec<(&'a VisualShape, Arc<Mesh>)>);

/// Adds one body.
pub(in crate::render) fn push<'a>(
    body_idx: usize,
    body: &'a Body,
    own_meshes: &mut OwnMeshes<'a>,
    instances: &mut Vec<Instance>,
) {
    let place =
        |pose: Isometry3<f64>, appearance: Appearance| Place { body_idx, pose, material: appearance.into() };
    if body.visuals.is_empty() {
        for part in &body.parts {
            push_solid(part.shape, &place(part.pose, part.appearance), instances);
        }
    }
    for visual in &body.visuals {
        push_form(&visual.shape, &place(visual.pose, visual.appearance), own_meshes, instances);
    }
}

/// Where on which body something is drawn, looking how.
struct Place {
    body_idx: usize,
    pose: Isometry3<f64>,
    material: Material,
}

impl Place {
    fn instance(&self, mesh: MeshSource, inner: Isometry3<f64>, scale: [f64; 3]) -> Instance {
        Instance {
            mesh,
            anchor: Anchor::Body(self.body_idx),
            pose: (self.pose * inner).cast(),
            scale: scale.map(|s| s as f32),
            material: self.material,
        }
    }
}

fn push_form<'a>(
    form: &'a VisualShape,
    place: &Place,
    own_meshes: &mut OwnMeshes<'a>,
    instances: &mut Vec<Instance>,
) {
    let mesh = match form {
        VisualShape::Primitive(solid) => return push_solid(*solid, place, instances),
        VisualShape::RoundedBox { half, edge_radius } => {
            own_meshes.shared(form, || rounded_box::mesh(half.map(|h| h as f32), *edge_radius as f32))
        }
        VisualShape::Lathe { profile } => own_meshes.shared(form, || lathe::mesh(&points(profile))),
        VisualShape::Torus { major_radius, minor_radius } => {
            own_meshes.shared(form, || torus::mesh(*major_radius as f32, *minor_radius as f32))
        }
        VisualShape::Extrusion { outline, holes, half_height } => own_meshes.shared(form, || {
            let holes: Vec<_> = holes.iter().map(|hole| points(hole)).collect();
            let holes: Vec<_> = holes.iter().map(Vec::as_slice).collect();
            extrusion::mesh(&points(outline), &holes, *half_height as f32)
        }),
    };
    instances.push(place.instance(MeshSource::Own(mesh), Isometry3::identity(), [1.0; 3]));
}

impl<'a> OwnMeshes<'a> {
    /// The form's mesh, made when it is first asked for.
    fn shared(&mut self, form: &'a VisualShape, make: impl FnOnce() -> Mesh) -> Arc<Mesh> {
        if let Some((_, mesh)) = self.0.iter().find(|(known, _)| *known == form) {
            return Arc::clone(mesh);
        }
        let mesh = Arc::new(make());
        self.0.push((form, Arc::clone(&mesh)));
        mesh
    }
}

fn points(points: &[[f64; 2]]) -> Vec<[f32; 2]> {
    points.iter().map(|p| p.map(|x| x as f32)).collect()
}

/// Adds a solid, scaled to exactly its size.
fn push_solid(solid: Primitive, place: &Place, instances: &mut Vec<Instance>) {
    let mut push = |mesh, inner, scale| {
        instances.push(place.instance(MeshSource::Library(mesh), inner, scale));
    };
    let centred = Isometry3::identity();
    match solid {
        Primitive::Box { half } => push(MeshId::Box, centred, half),
        Primitive::Cylinder { radius, half_height } => {
            push(MeshId::Cylinder, centred, [radius, radius, half_height]);
        }
        Primitive::Ball { radius } => push(MeshId::Ball, centred, [radius; 3]),
        Primitive::Capsule { radius, half_height } => {
            let upper = Isometry3::translation(0.0, 0.0, half_height);
            let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
            push(MeshId::Tube, centred, [radius, radius, half_height]);
            push(MeshId::Dome, upper, [radius; 3]);
            push(MeshId::Dome, half_turn * upper, [radius; 3]);
        }
    }
}
