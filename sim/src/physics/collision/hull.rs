//! Convex hulls whose flat faces rest stably.
//!
//! parry takes the contact points of a convex polyhedron from the first four vertices of the touching face.
//! On a face with many vertices, such as the base of a solid of revolution, these lie side by side, and the
//! body rocks and creeps on them. A [`Hull`] offers four vertices around the whole face instead and is a
//! [`ConvexPolyhedron`] in every other respect.

use rapier3d::geometry::{Aabb, Shape, ShapeType, SharedShape, TypedShape};
use rapier3d::math::{Real, Vector};
use rapier3d::parry::bounding_volume::BoundingSphere;
use rapier3d::parry::mass_properties::MassProperties;
use rapier3d::parry::query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection};
use rapier3d::parry::shape::{
    ConvexPolyhedron, FeatureId, PackedFeatureId, PolygonalFeature, PolygonalFeatureMap, SupportMap,
};

/// Maximum number of vertices of a face from which parry makes contact points.
const MAX_VERTICES: usize = 4;

/// A convex polyhedron with contact points around the whole touching face.
#[derive(Clone)]
pub(crate) struct Hull {
    polyhedron: ConvexPolyhedron,
    bounds: Aabb,
}

impl Hull {
    /// Creates the convex hull of points; `None` if they lie in one plane.
    pub(crate) fn shape(points: &[Vector]) -> Option<SharedShape> {
        ConvexPolyhedron::from_convex_hull(points).map(|hull| SharedShape::new(Self::new(hull)))
    }

    fn new(polyhedron: ConvexPolyhedron) -> Self {
        Self { bounds: polyhedron.compute_local_aabb(), polyhedron }
    }
}

impl PolygonalFeatureMap for Hull {
    fn local_support_feature(&self, dir: Vector, feature: &mut PolygonalFeature) {
        self.polyhedron.local_support_feature(dir, feature);
        let face = &self.polyhedron.faces()[feature.fid.unpack().unwrap_face() as usize];
        let (first, n) = (face.first_vertex_or_edge as usize, face.num_vertices_or_edges as usize);
        if n <= MAX_VERTICES {
            return;
        }
        let [vertices, edges] = [self.polyhedron.vertices_adj_to_face(), self.polyhedron.edges_adj_to_face()];
        for i in 0..MAX_VERTICES {
            let at = first + i * n / MAX_VERTICES;
            feature.vertices[i] = self.polyhedron.points()[vertices[at] as usize];
            feature.vids[i] = PackedFeatureId::vertex(vertices[at]);
            feature.eids[i] = PackedFeatureId::edge(edges[at]);
        }
    }

    fn is_convex_polyhedron(&self) -> bool {
        true
    }
}

impl SupportMap for Hull {
    fn local_support_point(&self, dir: Vector) -> Vector {
        self.polyhedron.local_support_point(dir)
    }
}

impl RayCast for Hull {
    fn cast_local_ray_and_get_normal(
        &self,
        ray: &Ray,
        max_time_of_impact: Real,
        solid: bool,
    ) -> Option<RayIntersection> {
        self.polyhedron.cast_local_ray_and_get_normal(ray, max_time_of_impact, solid)
    }
}

impl PointQuery for Hull {
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        self.polyhedron.project_local_point(point, solid)
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        self.polyhedron.project_local_point_and_get_feature(point)
    }
}

impl Shape for Hull {
    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, scale: Vector, _num_subdivisions: u32) -> Option<Box<dyn Shape>> {
        self.polyhedron.clone().scaled(scale).map(|hull| Box::new(Self::new(hull)) as Box<dyn Shape>)
    }

    fn compute_local_aabb(&self) -> Aabb {
        self.bounds
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.polyhedron.compute_local_bounding_sphere()
    }

    fn mass_properties(&self, density: Real) -> MassProperties {
        self.polyhedron.mass_properties(density)
    }

    fn is_convex(&self) -> bool {
        true
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::ConvexPolyhedron
    }

    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::ConvexPolyhedron(&self.polyhedron)
    }

    fn ccd_thickness(&self) -> Real {
        self.polyhedron.ccd_thickness()
    }

    fn ccd_angular_thickness(&self) -> Real {
        self.polyhedron.ccd_angular_thickness()
    }

    fn as_support_map(&self) -> Option<&dyn SupportMap> {
        Some(self)
    }

    fn as_polygonal_feature_map(&self) -> Option<(&dyn PolygonalFeatureMap, Real)> {
        Some((self, 0.0))
    }
}
