//! Rejection of pairs of shapes whose bounding boxes are apart, before their contacts are computed.
//!
//! rapier's broad phase reports pairs whose boxes are several centimetres apart, and its narrow phase looks
//! for the contacts of all of them. A hand at a pot that consists of dozens of hulls has hundreds of such
//! pairs, few of which touch.

use rapier3d::geometry::{ContactData, ContactManifold, ContactManifoldData, Shape};
use rapier3d::math::{Matrix, Pose, Real, Vector};
use rapier3d::parry::query::details::NormalConstraints;
use rapier3d::parry::query::{
    ClosestPoints, Contact, ContactManifoldsWorkspace, NonlinearRigidMotion, PersistentQueryDispatcher,
    QueryDispatcher, ShapeCastHit, ShapeCastOptions, ShapeDistance, ShapeIntersection, Unsupported,
};

/// A dispatcher that reports no contacts for pairs whose boxes are apart, and leaves every other query to the
/// next dispatcher of its chain.
pub(crate) struct SeparatedBoxes;

impl PersistentQueryDispatcher<ContactManifoldData, ContactData> for SeparatedBoxes {
    fn contact_manifolds(
        &self,
        pose: &Pose,
        a: &dyn Shape,
        b: &dyn Shape,
        prediction: Real,
        manifolds: &mut Vec<ContactManifold>,
        _: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        if !are_separated(pose, [a, b], prediction) {
            return Err(Unsupported);
        }
        manifolds.iter_mut().for_each(ContactManifold::clear);
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        _: &Pose,
        _: &dyn Shape,
        _: &dyn Shape,
        _: Option<&dyn NormalConstraints>,
        _: Option<&dyn NormalConstraints>,
        _: Real,
        _: &mut ContactManifold,
    ) -> Result<(), Unsupported> {
        Err(Unsupported)
    }
}

/// Returns `true` if an axis of either shape's own bounding box separates them by more than `distance`.
/// `pose` is that of the second shape in the frame of the first.
fn are_separated(pose: &Pose, shapes: [&dyn Shape; 2], distance: Real) -> bool {
    let [a, b] = shapes.map(Shape::compute_local_aabb);
    let axes = Matrix::from_quat(pose.rotation);
    let sizes = Matrix::from_cols(axes.x_axis.abs(), axes.y_axis.abs(), axes.z_axis.abs());
    let [half_a, half_b] = [a.half_extents(), b.half_extents()];
    let between = *pose * b.center() - a.center();
    let gap_a = between.abs() - half_a - sizes * half_b;
    let gap_b = (axes.transpose() * between).abs() - half_b - sizes.transpose() * half_a;
    gap_a.max(gap_b).max_element() > distance
}

impl QueryDispatcher for SeparatedBoxes {
    fn intersection_test(
        &self,
        _: &Pose,
        _: &dyn Shape,
        _: &dyn Shape,
    ) -> Result<ShapeIntersection, Unsupported> {
        Err(Unsupported)
    }

    fn distance(&self, _: &Pose, _: &dyn Shape, _: &dyn Shape) -> Result<ShapeDistance, Unsupported> {
        Err(Unsupported)
    }

    fn contact(
        &self,
        _: &Pose,
        _: &dyn Shape,
        _: &dyn Shape,
        _: Real,
    ) -> Result<Option<Contact>, Unsupported> {
        Err(Unsupported)
    }

    fn closest_points(
        &self,
        _: &Pose,
        _: &dyn Shape,
        _: &dyn Shape,
        _: Real,
    ) -> Result<ClosestPoints, Unsupported> {
        Err(Unsupported)
    }

    fn cast_shapes(
        &self,
        _: &Pose,
        _: Vector,
        _: &dyn Shape,
        _: &dyn Shape,
        _: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        Err(Unsupported)
    }

    fn cast_shapes_nonlinear(
        &self,
        _: &NonlinearRigidMotion,
        _: &dyn Shape,
        _: &NonlinearRigidMotion,
        _: &dyn Shape,
        _: Real,
        _: Real,
        _: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        Err(Unsupported)
    }
}

#[cfg(test)]
mod tests {
    use rapier3d::geometry::SharedShape;
    use rapier3d::math::Rotation;
    use rapier3d::parry::query::DefaultQueryDispatcher;

    use super::super::hull::Hull;
    use super::*;
    use crate::scene::stream::Stream;

    #[test]
    fn separated_shapes_are_farther_apart_than_asked() {
        let mut stream = Stream::new(1, "poses");
        let mut between = |low: f64, high: f64| (low + (high - low) * stream.unit()) as f32;
        let shapes = [
            SharedShape::cuboid(0.02, 0.05, 0.03),
            SharedShape::ball(0.04),
            SharedShape::cylinder(0.06, 0.02),
            SharedShape::capsule(Vector::new(0.0, 0.0, -0.05), Vector::new(0.01, 0.0, 0.05), 0.02),
            Hull::shape(&core::array::from_fn::<_, 12, _>(|_| {
                Vector::new(between(-0.03, 0.05), between(-0.05, 0.05), between(-0.01, 0.04))
            }))
            .unwrap(),
        ];
        let (mut n_far, mut n_found) = (0, 0);
        for i in 0..20_000 {
            let pair = [&*shapes[i % 5], &*shapes[i / 5 % 5]];
            let place = Vector::new(between(-0.2, 0.2), between(-0.2, 0.2), between(-0.2, 0.2));
            let turn = Vector::new(between(-3.0, 3.0), between(-3.0, 3.0), between(-3.0, 3.0));
            let pose = Pose::from_parts(place, Rotation::from_scaled_axis(turn));
            let distance = DefaultQueryDispatcher.distance(&pose, pair[0], pair[1]).unwrap().distance;
            let found = are_separated(&pose, pair, 0.015);
            assert!(!found || distance > 0.015 - 1e-5, "{i}: {distance} m");
            n_far += usize::from(distance > 0.015);
            n_found += usize::from(found);
        }
        assert!(n_far > 5_000 && n_found * 10 > n_far * 8, "{n_found} of {n_far}");
    }
}
