//! Where things appear. The camera looks along −x from (1, 0, 0.5), so right is +y; its 224 pixels span 90°, which is
//! 112 pixels per metre at 1 m.

use nalgebra::{Translation3, Vector3};
use sim::scene::{CameraMount, Primitive, Scene};

use crate::common::{BLUE, RED, as_placed, body, bounds, empty_room, image, is_blue, is_red, pixels};

const SIDE: usize = 224;

fn scene() -> Scene {
    empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5])
}

fn shows(scene: &Scene) -> Vec<u8> {
    image(scene, &as_placed(scene), 0)
}

#[test]
fn a_point_appears_where_the_pinhole_puts_it() {
    let mut scene = scene();
    scene.bodies.push(body("ball", Primitive::Ball { radius: 0.02 }, [0.0, 0.3, 0.7], BLUE));
    let ball = pixels(&shows(&scene), SIDE, is_blue);
    let mean = |axis: usize| ball.iter().map(|p| p[axis] as f64 + 0.5).sum::<f64>() / ball.len() as f64;
    assert!((mean(0) - (112.0 + 0.3 * 112.0)).abs() < 0.5, "column {}", mean(0));
    assert!((mean(1) - (112.0 - 0.2 * 112.0)).abs() < 0.5, "row {}", mean(1));
}

#[test]
fn a_cube_covers_the_pixels_whose_centres_it_covers() {
    // The near face spans ±0.1 m at 0.9 m: ±12.44 pixels about the middle of the image, hence 24 pixel centres each way.
    let mut scene = scene();
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    let cube = pixels(&shows(&scene), SIDE, is_blue);
    assert_eq!(bounds(&cube), [[100, 100], [123, 123]]);
    assert_eq!(cube.len(), 24 * 24);
}

#[test]
fn solids_are_as_large_as_they_were_drawn() {
    // From 1 m, to within a pixel; round solids are polyhedra of 32 corners and show a little more than their middle.
    let cases = [
        (Primitive::Ball { radius: 0.2 }, [0.2, 0.2]),
        (Primitive::Cylinder { radius: 0.1, half_height: 0.25 }, [0.1, 0.25]),
        (Primitive::Capsule { radius: 0.1, half_height: 0.15 }, [0.1, 0.25]),
        (Primitive::Box { half: [0.001, 0.3, 0.12] }, [0.3, 0.12]),
    ];
    for (shape, half_m) in cases {
        let mut scene = scene();
        scene.bodies.push(body("solid", shape, [0.0, 0.0, 0.5], BLUE));
        let [least, greatest] = bounds(&pixels(&shows(&scene), SIDE, is_blue));
        for axis in 0..2 {
            let size_px = (greatest[axis] - least[axis] + 1) as f64;
            let expected = 2.0 * half_m[axis] * 112.0;
            assert!(
                (-1.5..=0.12 * expected).contains(&(size_px - expected)),
                "{shape:?}: {size_px} for {expected}"
            );
        }
    }
}

#[test]
fn the_nearer_body_hides_the_farther_whatever_their_order() {
    for order in [[0, 1], [1, 0]] {
        let mut scene = scene();
        let near = body("near", Primitive::Box { half: [0.1; 3] }, [0.3, 0.0, 0.5], RED);
        let far = body("far", Primitive::Box { half: [0.1; 3] }, [-0.3, 0.0, 0.5], BLUE);
        scene.bodies = order.map(|i| [&near, &far][i].clone()).to_vec();
        let image = shows(&scene);
        assert!(pixels(&image, SIDE, is_blue).is_empty(), "the far cube shines through");
        assert!(pixels(&image, SIDE, is_red).len() > 1000);
    }
}

#[test]
fn a_slab_that_reaches_behind_the_camera_is_clipped_not_torn() {
    // Its top is 0.1 m under the eye and ends 5 m ahead: 2.24 pixels under the horizon.
    let mut scene = scene();
    scene.bodies.push(body("slab", Primitive::Box { half: [5.0, 50.0, 0.05] }, [1.0, 0.0, 0.35], BLUE));
    let slab = pixels(&shows(&scene), SIDE, is_blue);
    assert_eq!(bounds(&slab), [[0, 114], [SIDE - 1, SIDE - 1]]);
    assert_eq!(slab.len(), (SIDE - 114) * SIDE);
}

#[test]
fn what_is_too_near_or_behind_is_not_drawn() {
    for x in [0.995, 1.5, 3.0] {
        let mut scene = scene();
        let speck = Primitive::Box { half: [0.004, 0.1, 0.1] };
        scene.bodies.push(body("speck", speck, [x, 0.0, 0.5], BLUE));
        assert!(pixels(&shows(&scene), SIDE, is_blue).is_empty(), "drawn at x {x}");
    }
}

#[test]
fn a_camera_error_moves_the_picture() {
    // Turned 0.1 rad to the left, the camera sees what is ahead 0.1 · 112 pixels further right.
    let mut scene = scene();
    scene.bodies.push(body("ball", Primitive::Ball { radius: 0.05 }, [0.0, 0.0, 0.5], BLUE));
    scene.cameras[0].pose_error = nalgebra::Isometry3::rotation(Vector3::z() * 0.1);
    let ball = pixels(&shows(&scene), SIDE, is_blue);
    let column = ball.iter().map(|p| p[0] as f64 + 0.5).sum::<f64>() / ball.len() as f64;
    assert!((column - (112.0 + libm::tan(0.1) * 112.0)).abs() < 0.5, "column {column}");
}

#[test]
fn a_camera_error_is_in_the_cameras_own_frame() {
    let (eye, target) = (Vector3::new(0.8, -0.5, 0.7), Vector3::new(0.0, 0.1, 0.2));
    let ahead = (target - eye).normalize();
    let left = Vector3::z().cross(&ahead).normalize();
    let seen_from = |eye: Vector3<f64>, error: [f64; 3]| {
        let mut scene = scene();
        scene.bodies.push(body("ball", Primitive::Ball { radius: 0.1 }, [0.0, 0.1, 0.2], BLUE));
        let target = eye + ahead;
        scene.cameras[0].mount = CameraMount::World { eye: eye.into(), target: target.into() };
        scene.cameras[0].pose_error = Translation3::from(error).into();
        let ball = pixels(&shows(&scene), SIDE, is_blue);
        assert!(ball.len() > 200, "the ball is in view");
        ball
    };
    for (axis, direction) in [ahead, left, ahead.cross(&left)].into_iter().enumerate() {
        let mut error = [0.0; 3];
        error[axis] = 0.03;
        let expected = seen_from(eye + direction * 0.03, [0.0; 3]);
        let found = seen_from(eye, error);
        let differ = found.iter().filter(|pixel| !expected.contains(pixel)).count();
        assert!(
            differ < 4 && found.len().abs_diff(expected.len()) < 4,
            "axis {axis}: {differ} pixels differ"
        );
        assert_ne!(found, seen_from(eye, [0.0; 3]), "axis {axis}: it is seen");
    }
}
