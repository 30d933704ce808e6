//! Projection, clipping and occlusion.
//!
//! The camera looks along −x from (1, 0, 0.5) m, so right in the image is +y. Its 224 pixels span 90°: a
//! metre at 1 m spans 112 pixels.

use nalgebra::{Translation3, Vector3};
use sim::scene::{CameraMount, Primitive, Scene};

use crate::common::{
    BLUE, RED, body, bounds, empty_room, initial_snapshot, is_blue, is_red, pixels_where, render,
};

const SIDE: usize = 224;

fn scene() -> Scene {
    empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5])
}

fn render_initial(scene: &Scene) -> Vec<u8> {
    render(scene, &initial_snapshot(scene), 0)
}

#[test]
fn ball_projects_to_expected_pixel() {
    let mut scene = scene();
    scene.bodies.push(body("ball", Primitive::Ball { radius: 0.02 }, [0.0, 0.3, 0.7], BLUE));
    let ball = pixels_where(&render_initial(&scene), SIDE, is_blue);
    let mean = |axis: usize| ball.iter().map(|p| p[axis] as f64 + 0.5).sum::<f64>() / ball.len() as f64;
    assert!((mean(0) - (112.0 + 0.3 * 112.0)).abs() < 0.5, "column {}", mean(0));
    assert!((mean(1) - (112.0 - 0.2 * 112.0)).abs() < 0.5, "row {}", mean(1));
}

#[test]
fn cube_covers_pixels_by_their_centres() {
    // The near face spans ±0.1 m at 0.9 m, which is ±12.44 pixels around the image centre: 24 pixel centres
    // per axis.
    let mut scene = scene();
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    let cube = pixels_where(&render_initial(&scene), SIDE, is_blue);
    assert_eq!(bounds(&cube), [[100, 100], [123, 123]]);
    assert_eq!(cube.len(), 24 * 24);
}

#[test]
fn primitives_have_their_projected_size() {
    // Seen from 1 m, with a tolerance of about a pixel. Parts of a round solid in front of its centre plane
    // enlarge its silhouette.
    let cases = [
        (Primitive::Ball { radius: 0.2 }, [0.2, 0.2]),
        (Primitive::Cylinder { radius: 0.1, half_height: 0.25 }, [0.1, 0.25]),
        (Primitive::Capsule { radius: 0.1, half_height: 0.15 }, [0.1, 0.25]),
        (Primitive::Box { half: [0.001, 0.3, 0.12] }, [0.3, 0.12]),
    ];
    for (shape, half_m) in cases {
        let mut scene = scene();
        scene.bodies.push(body("solid", shape.clone(), [0.0, 0.0, 0.5], BLUE));
        let [min, max] = bounds(&pixels_where(&render_initial(&scene), SIDE, is_blue));
        for axis in 0..2 {
            let size_px = (max[axis] - min[axis] + 1) as f64;
            let expected = 2.0 * half_m[axis] * 112.0;
            assert!(
                (-1.5..=0.12 * expected).contains(&(size_px - expected)),
                "{shape:?}: {size_px} for {expected}"
            );
        }
    }
}

#[test]
fn nearer_body_occludes_farther_in_any_order() {
    for order in [[0, 1], [1, 0]] {
        let mut scene = scene();
        let near = body("near", Primitive::Box { half: [0.1; 3] }, [0.3, 0.0, 0.5], RED);
        let far = body("far", Primitive::Box { half: [0.1; 3] }, [-0.3, 0.0, 0.5], BLUE);
        scene.bodies = order.map(|i| [&near, &far][i].clone()).to_vec();
        let image = render_initial(&scene);
        assert!(pixels_where(&image, SIDE, is_blue).is_empty(), "the far cube is visible");
        assert!(pixels_where(&image, SIDE, is_red).len() > 1000);
    }
}

#[test]
fn slab_behind_camera_is_clipped_correctly() {
    // The top of the slab lies 0.1 m below the eye and ends 5 m ahead, 2.24 pixels below the horizon.
    let mut scene = scene();
    scene.bodies.push(body("slab", Primitive::Box { half: [5.0, 50.0, 0.05] }, [1.0, 0.0, 0.35], BLUE));
    let slab = pixels_where(&render_initial(&scene), SIDE, is_blue);
    assert_eq!(bounds(&slab), [[0, 114], [SIDE - 1, SIDE - 1]]);
    assert_eq!(slab.len(), (SIDE - 114) * SIDE);
}

#[test]
fn bodies_behind_near_plane_are_invisible() {
    for x in [0.995, 1.5, 3.0] {
        let mut scene = scene();
        let speck = Primitive::Box { half: [0.004, 0.1, 0.1] };
        scene.bodies.push(body("speck", speck, [x, 0.0, 0.5], BLUE));
        assert!(pixels_where(&render_initial(&scene), SIDE, is_blue).is_empty(), "visible at x {x}");
    }
}

#[test]
fn camera_error_shifts_image() {
    // A rotation of 0.1 rad to the left shifts the centre of the image by tan(0.1) · 112 pixels to the right.
    let mut scene = scene();
    scene.bodies.push(body("ball", Primitive::Ball { radius: 0.05 }, [0.0, 0.0, 0.5], BLUE));
    scene.cameras[0].pose_error = nalgebra::Isometry3::rotation(Vector3::z() * 0.1);
    let ball = pixels_where(&render_initial(&scene), SIDE, is_blue);
    let column = ball.iter().map(|p| p[0] as f64 + 0.5).sum::<f64>() / ball.len() as f64;
    assert!((column - (112.0 + libm::tan(0.1) * 112.0)).abs() < 0.5, "column {column}");
}

#[test]
fn camera_error_applies_in_camera_frame() {
    let (eye, target) = (Vector3::new(0.8, -0.5, 0.7), Vector3::new(0.0, 0.1, 0.2));
    let ahead = (target - eye).normalize();
    let left = Vector3::z().cross(&ahead).normalize();
    let ball_pixels = |eye: Vector3<f64>, error: [f64; 3]| {
        let mut scene = scene();
        scene.bodies.push(body("ball", Primitive::Ball { radius: 0.1 }, [0.0, 0.1, 0.2], BLUE));
        let target = eye + ahead;
        scene.cameras[0].mount = CameraMount::World { eye: eye.into(), target: target.into() };
        scene.cameras[0].pose_error = Translation3::from(error).into();
        let ball = pixels_where(&render_initial(&scene), SIDE, is_blue);
        assert!(ball.len() > 200, "the ball is not visible");
        ball
    };
    for (axis, direction) in [ahead, left, ahead.cross(&left)].into_iter().enumerate() {
        let mut error = [0.0; 3];
        error[axis] = 0.03;
        let expected = ball_pixels(eye + direction * 0.03, [0.0; 3]);
        let found = ball_pixels(eye, error);
        let differ = found.iter().filter(|pixel| !expected.contains(pixel)).count();
        assert!(
            differ < 4 && found.len().abs_diff(expected.len()) < 4,
            "axis {axis}: {differ} pixels differ"
        );
        assert_ne!(found, ball_pixels(eye, [0.0; 3]), "axis {axis}: the error has no effect");
    }
}
