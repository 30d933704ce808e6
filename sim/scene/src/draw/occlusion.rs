//! Occlusion of manipulated objects by distractors, as the external cameras see it.

use nalgebra::{Point3, Vector3};

use crate::drawn::Body;
use crate::shape::Aabb;
use crate::spec::{CameraMount, CameraSpec, Role};

/// A line of sight from a camera to a point of an object, in world coordinates.
struct SightLine {
    from: Point3<f64>,
    to: Point3<f64>,
}

/// The lines of sight from each external camera to each manipulated object.
pub(crate) struct LinesOfSight(Vec<Vec<SightLine>>);

impl LinesOfSight {
    /// Collects the lines to the centre and the corners of the bounding boxes of the resting objects. Cameras
    /// are where they nominally are, so that their pose error does not influence what is drawn.
    pub(crate) fn new(cameras: &[CameraSpec], bodies: &[Body]) -> Self {
        let eyes = cameras.iter().filter_map(|camera| match camera.mount {
            CameraMount::World { eye, .. } => Some(Point3::from(eye)),
            CameraMount::Hand { .. } => None,
        });
        let manipulated = bodies.iter().filter(|body| body.role == Role::ManipulationObject);
        let targets: Vec<Aabb> = manipulated.map(|body| body.aabb(&body.resting_pose())).collect();
        let lines = |from: Point3<f64>| {
            let to_points =
                move |target: &Aabb| points_of(target).map(|to| SightLine { from, to }).into_iter().collect();
            targets.iter().map(to_points).collect::<Vec<_>>()
        };
        Self(eyes.flat_map(lines).collect())
    }

    /// Returns `true` if a box blocks more than half of the lines from one camera to one object.
    pub(crate) fn are_blocked_by(&self, obstacle: &Aabb) -> bool {
        self.0.iter().any(|lines| {
            let n_blocked = lines.iter().filter(|line| line.intersects(obstacle)).count();
            2 * n_blocked > lines.len()
        })
    }
}

/// Returns the centre and the corners of a box.
fn points_of(aabb: &Aabb) -> [Point3<f64>; 9] {
    let corner = |i: usize| {
        Vector3::from_fn(|axis, _| if i >> axis & 1 == 0 { aabb.min[axis] } else { aabb.max[axis] })
    };
    core::array::from_fn(|i| if i < 8 { corner(i).into() } else { ((aabb.min + aabb.max) / 2.0).into() })
}

impl SightLine {
    /// Returns `true` if any point of the segment is in the box, by clipping it against the three slabs.
    fn intersects(&self, aabb: &Aabb) -> bool {
        let along = self.to - self.from;
        let mut inside = [0.0_f64, 1.0];
        for axis in 0..3 {
            let [low, high] =
                [aabb.min[axis], aabb.max[axis]].map(|plane| (plane - self.from[axis]) / along[axis]);
            inside = [inside[0].max(low.min(high)), inside[1].min(low.max(high))];
        }
        inside[0] <= inside[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_blocks_only_lines_through_it() {
        let line = |to: [f64; 3]| SightLine { from: Point3::new(1.0, 0.0, 1.0), to: Point3::from(to) };
        let aabb = Aabb { min: Vector3::new(0.3, -0.1, 0.0), max: Vector3::new(0.6, 0.1, 0.5) };
        assert!(line([0.0, 0.0, 0.0]).intersects(&aabb));
        assert!(!line([0.0, 1.0, 0.0]).intersects(&aabb), "beside the box");
        assert!(!line([0.9, 0.0, 0.9]).intersects(&aabb), "the box is behind the target");
        assert!(!line([0.0, 0.0, 0.95]).intersects(&aabb), "above the box");
    }
}
