//! Visual shapes, which may differ from collision shapes: their size in images, and how perturbations affect
//! them.

use nalgebra::{Isometry3, Vector3};
use sim::scene::{Appearance, Primitive, Scene, Visual, VisualShape};
use sim::{Perturbation, TaskId};

use crate::common::{
    BLUE, body, bounds, empty_room, first_scene, initial_snapshot, n_different_pixels, perturbed,
    pixels_where, render,
};

const SIDE: usize = 224;
/// Pixels per metre at 1 m, for a field of view of 90°.
const PX_PER_M: f64 = 112.0;

/// A visual shape and its expected silhouette.
struct ShapeCase {
    shape: VisualShape,
    /// `true` if its axis of symmetry points to the camera.
    facing: bool,
    /// World y of its centre, in m.
    y_m: f64,
    /// Half extents along the world axes, in m.
    half_m: [f64; 3],
    /// Approximate area of the silhouette in the plane through its centre, in m².
    area_m2: f64,
    /// sRGB, each channel 0 or 1.
    color: [f64; 3],
}

fn square(half_m: f64) -> Vec<[f64; 2]> {
    vec![[-half_m, -half_m], [half_m, -half_m], [half_m, half_m], [-half_m, half_m]]
}

fn cases() -> [ShapeCase; 5] {
    use core::f64::consts::PI;
    let cup = vec![[0.0, -0.1], [0.04, -0.1], [0.08, 0.1], [0.07, 0.1], [0.035, -0.09], [0.0, -0.09]];
    let ball = Primitive::Ball { radius: 0.05 };
    let case =
        |shape, facing, y_m, half_m, area_m2, color| ShapeCase { shape, facing, y_m, half_m, area_m2, color };
    [
        case(VisualShape::Primitive(ball), false, -0.6, [0.05; 3], PI * 0.0025, [1.0, 0.0, 0.0]),
        case(
            VisualShape::RoundedBox { half: [0.02, 0.1, 0.06], edge_radius: 0.01 },
            false,
            -0.3,
            [0.02, 0.1, 0.06],
            0.024 - (4.0 - PI) * 1e-4,
            [0.0, 1.0, 0.0],
        ),
        case(VisualShape::Lathe { profile: cup }, false, 0.0, [0.08, 0.08, 0.1], 0.024, BLUE),
        case(
            VisualShape::Torus { major_radius: 0.09, minor_radius: 0.02 },
            true,
            0.3,
            [0.02, 0.11, 0.11],
            PI * (0.0121 - 0.0049),
            [1.0, 1.0, 0.0],
        ),
        case(
            VisualShape::Extrusion { outline: square(0.1), holes: vec![square(0.06)], half_height: 0.004 },
            true,
            0.6,
            [0.004, 0.1, 0.1],
            0.04 - 0.0144,
            [0.0, 1.0, 1.0],
        ),
    ]
}

/// Returns a scene with all cases side by side, 1 m in front of the camera. Each is the visual of a body with
/// a tiny collision part.
fn side_by_side(scale: f64) -> Scene {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    for ShapeCase { shape, facing, y_m, color, .. } in cases() {
        let mut body = body("shape", Primitive::Ball { radius: 0.001 }, [0.0, y_m, 0.5], color);
        let turn_rad = if facing { core::f64::consts::FRAC_PI_2 } else { 0.0 };
        body.visuals.push(Visual {
            stretch: [1.0; 3],
            shape: shape.scaled(scale),
            pose: Isometry3::rotation(Vector3::y() * turn_rad),
            appearance: Appearance { color, texture: None, specular: 0.0, metallic: 0.0 },
        });
        scene.bodies.push(body);
    }
    scene
}

/// Returns the pixels that show a case.
fn pixels_of(image: &[u8], case: &ShapeCase) -> Vec<[usize; 2]> {
    pixels_where(image, SIDE, |rgb| (0..3).all(|channel| (rgb[channel] > 0) == (case.color[channel] > 0.0)))
}

fn render_initial(scene: &Scene) -> Vec<u8> {
    render(scene, &initial_snapshot(scene), 0)
}

#[test]
fn shapes_have_expected_extents_and_area() {
    for scale in [0.8, 1.0, 1.2] {
        let image = render_initial(&side_by_side(scale));
        for case in cases() {
            let covered = pixels_of(&image, &case);
            let [min, max] = bounds(&covered);
            let [depth, width, height] = case.half_m.map(|half| half * scale);
            // Columns increase with y, rows with −z.
            for (axis, (centre, half)) in [(case.y_m, width), (0.0, height)].into_iter().enumerate() {
                let across = |side: f64, x: f64| 112.0 + PX_PER_M * (centre + side * half) / (1.0 - x);
                let found = [min[axis] as f64, max[axis] as f64 + 1.0];
                for (found, side) in found.into_iter().zip([-1.0, 1.0]) {
                    // At least the extent in the centre plane (to within a pixel) and at most the corners of
                    // the bounding box (to within half a pixel).
                    let edge = |x: f64| side * across(side, x);
                    let max = edge(depth).max(edge(-depth)) + 0.51;
                    let range = edge(0.0) - 1.01..=max;
                    assert!(range.contains(&(side * found)), "{:?}, {scale}: {found}, {range:?}", case.shape);
                }
            }
            let area = covered.len() as f64 / (PX_PER_M * scale).powi(2);
            assert!((0.93..1.2).contains(&(area / case.area_m2)), "{:?}: {area} m²", case.shape);
        }
    }
}

#[test]
fn holes_are_transparent() {
    let image = render_initial(&side_by_side(1.0));
    for case in cases() {
        let middle = [(112.0 + PX_PER_M * case.y_m) as usize, 112];
        let is_open = matches!(case.shape, VisualShape::Torus { .. } | VisualShape::Extrusion { .. });
        assert_eq!(pixels_of(&image, &case).contains(&middle), !is_open, "{:?}", case.shape);
    }
}

#[test]
fn body_without_visuals_renders_collision_parts() {
    let mut scene = side_by_side(1.0);
    let ball = scene.bodies[0].visuals[0].shape.clone();
    let as_visual = render_initial(&scene);
    scene.bodies[0].visuals.clear();
    scene.bodies[0].parts[0].shape = Primitive::Ball { radius: 0.05 };
    assert_eq!(ball, VisualShape::Primitive(scene.bodies[0].parts[0].shape.clone()));
    assert!(as_visual == render_initial(&scene), "a part and a visual of the same shape differ");
}

#[test]
fn mo_color_samples_color_per_render_part() {
    let colors = |task, body: &str, seed| {
        let scene = perturbed(task, Perturbation::MoColor).draw(seed);
        scene.body(body).visuals.iter().map(|visual| visual.appearance.color).collect::<Vec<_>>()
    };
    let book = colors(TaskId::PlaceBookInShelf, "book", 5);
    assert!(book.len() > 1 && book.iter().skip(1).all(|color| *color != book[0]), "{book:?}");

    // The original's tray is a single mesh.
    let (nominal, snapshot) = first_scene(TaskId::DualArmLiftTray);
    let spec = perturbed(TaskId::DualArmLiftTray, Perturbation::MoColor);
    let [first, again, other] = [5, 5, 6].map(|seed| colors(TaskId::DualArmLiftTray, "tray", seed));
    assert_eq!(first, again);
    assert!(first.len() > 1 && first.iter().all(|color| *color == first[0]), "{first:?}");
    assert!(first.iter().zip(&other).all(|(a, b)| a != b), "{first:?} and {other:?}");
    let mut colored = nominal.clone();
    colored.bodies[0].visuals = spec.draw(5).bodies[0].visuals.clone();
    let changed = n_different_pixels(&render(&nominal, &snapshot, 0), &render(&colored, &snapshot, 0));
    assert!(changed > 500, "{changed} pixels change");
}

#[test]
fn visuals_scale_with_their_body() {
    let spec = perturbed(TaskId::DualArmLiftTray, Perturbation::MoSize);
    for seed in 0..8 {
        let tray = spec.draw(seed).body("tray").clone();
        for (visual, at_one) in tray.visuals.iter().zip(&spec.bodies[0].visuals) {
            assert_eq!(visual.shape, at_one.shape);
            let expected = at_one.pose.translation.vector.component_mul(&tray.scale);
            assert_eq!(visual.pose.translation.vector, expected);
            let along = at_one.pose.rotation * Vector3::from(visual.stretch);
            assert!((along.abs() - tray.scale).amax() < 1e-9, "{along} is not {}", tray.scale);
        }
        assert!((tray.scale.x - tray.scale.y).abs() > 1e-3, "seed {seed} scales all axes alike");
    }
}
