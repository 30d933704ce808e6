//! Sampling of scenes: sizes, and placement in regions and relative to other bodies.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use sim::scene::{BodySpec, PlacementSpec, Primitive, Range, Scene, SceneSpec, SizesSpec};
use sim::{Profile, TaskId};

const LENGTH: Range = Range::new(0.05, 0.1);

fn raise_cube() -> SceneSpec {
    (TaskId::RaiseCube.task().nominal)(Profile::Strict)
}

/// Replaces the cube by a bar of the sampled length.
fn stretch(drawn: &[f64], bodies: &mut [BodySpec]) {
    bodies[0].parts[0].shape = Primitive::Box { half: [drawn[0], 0.02, 0.02] };
}

fn half_length(scene: &Scene) -> f64 {
    let Primitive::Box { half } = scene.bodies[0].parts[0].shape else { panic!("a box") };
    half[0]
}

#[test]
fn sizes_have_their_own_random_stream() {
    let spec = SceneSpec {
        sizes: Some(SizesSpec { ranges: &[("length", LENGTH)], apply: stretch }),
        ..raise_cube()
    };
    let lengths: Vec<f64> = (0..40).map(|seed| half_length(&spec.draw(seed))).collect();
    assert!(lengths.iter().all(|length| LENGTH.contains(*length)));
    let spread = lengths.iter().fold(0.0_f64, |a, b| a.max((b - lengths[0]).abs()));
    assert!(spread > 0.01, "lengths differ: {lengths:?}");
    for seed in 0..5 {
        let (cube, bar) = (raise_cube().draw(seed), spec.draw(seed));
        assert_eq!(cube.bodies[0].pose, bar.bodies[0].pose, "placement has its own stream");
        assert_eq!(half_length(&bar), half_length(&spec.draw(seed)));
    }
}

#[test]
fn relative_placement_follows_pose_and_scale() {
    let mut spec = raise_cube();
    let offset = Isometry3::from_parts(Translation3::new(0.1, 0.0, 0.2), UnitQuaternion::identity());
    spec.bodies[0] = spec.bodies[0].clone().with_yaw(Range::new(1.0, 2.0));
    spec.bodies[0].scale = Range::new(1.5, 2.0);
    let placement = PlacementSpec::RelativeTo { body: 0, pose: offset };
    spec.bodies.push(BodySpec { name: "rider", placement, ..raise_cube().bodies.remove(0) });
    for seed in 0..5 {
        let scene = spec.draw(seed);
        let [carrier, rider] = [0, 1].map(|body| scene.bodies[body].pose);
        let expected = carrier * Translation3::from(offset.translation.vector * scene.bodies[0].scale.x);
        assert!((rider.translation.vector - expected.translation.vector).norm() < 1e-12);
        assert!(rider.rotation.angle_to(&carrier.rotation) < 1e-9);
        let turned = rider.rotation * Vector3::x();
        assert!(turned.x < 0.55, "the carrier has a yaw of at least 1 rad: {turned}");
    }
}
