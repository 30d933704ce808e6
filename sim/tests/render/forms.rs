//! What is seen may differ from what collides: forms appear as large as they are stated, and perturbations reach them.

use nalgebra::{Isometry3, Vector3};
use sim::scene::{Appearance, Primitive, Scene, Visual, VisualShape};
use sim::{Perturbation, TaskId};

use crate::common::{BLUE, as_placed, body, bounds, drawn, empty_room, image, perturbed, pixels};
use crate::independence::differing;

const SIDE: usize = 224;
/// Pixels per metre at 1 m: the camera spans 90°.
const PX_PER_M: f64 = 112.0;

/// A form at `y_m` that looks at the camera, half of whose extents along the world's axes are `half_m` and which covers
/// about `area_m2` of the plane through its middle.
struct Case {
    form: VisualShape,
    facing: bool,
    y_m: f64,
    half_m: [f64; 3],
    area_m2: f64,
    /// sRGB, each channel 0 or 1.
    color: [f64; 3],
}

fn square(half_m: f64) -> Vec<[f64; 2]> {
    vec![[-half_m, -half_m], [half_m, -half_m], [half_m, half_m], [-half_m, half_m]]
}

fn cases() -> [Case; 5] {
    use core::f64::consts::PI;
    let cup = vec![[0.0, -0.1], [0.04, -0.1], [0.08, 0.1], [0.07, 0.1], [0.035, -0.09], [0.0, -0.09]];
    let ball = Primitive::Ball { radius: 0.05 };
    let case = |form, facing, y_m, half_m, area_m2, color| Case { form, facing, y_m, half_m, area_m2, color };
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

/// The cases side by side, 1 m before the camera, each as the looks of a body whose part is a speck.
fn side_by_side(scale: f64) -> Scene {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    for Case { form, facing, y_m, color, .. } in cases() {
        let mut seen = body("form", Primitive::Ball { radius: 0.001 }, [0.0, y_m, 0.5], color);
        let turn_rad = if facing { core::f64::consts::FRAC_PI_2 } else { 0.0 };
        seen.visuals.push(Visual {
            shape: form.scaled(scale),
            pose: Isometry3::rotation(Vector3::y() * turn_rad),
            appearance: Appearance { color, texture: None, specular: 0.0 },
        });
        scene.bodies.push(seen);
    }
    scene
}

/// Pixels that show a case.
fn shown(image: &[u8], case: &Case) -> Vec<[usize; 2]> {
    pixels(image, SIDE, |rgb| (0..3).all(|channel| (rgb[channel] > 0) == (case.color[channel] > 0.0)))
}

fn pictured(scene: &Scene) -> Vec<u8> {
    image(scene, &as_placed(scene), 0)
}

#[test]
fn forms_fill_their_extents_and_no_more() {
    for scale in [0.8, 1.0, 1.2] {
        let image = pictured(&side_by_side(scale));
        for case in cases() {
            let seen = shown(&image, &case);
            let [least, greatest] = bounds(&seen);
            let [depth, width, height] = case.half_m.map(|half| half * scale);
            // Columns grow with y, rows against z.
            for (axis, (centre, half)) in [(case.y_m, width), (0.0, height)].into_iter().enumerate() {
                let across = |side: f64, x: f64| 112.0 + PX_PER_M * (centre + side * half) / (1.0 - x);
                let found = [least[axis] as f64, greatest[axis] as f64 + 1.0];
                for (found, side) in found.into_iter().zip([-1.0, 1.0]) {
                    // Between the middle plane, to within a pixel, and the corners of the extents, to within half of one.
                    let reach = |x: f64| side * across(side, x);
                    let most = reach(depth).max(reach(-depth)) + 0.51;
                    let range = reach(0.0) - 1.01..=most;
                    assert!(range.contains(&(side * found)), "{:?}, {scale}: {found}, {range:?}", case.form);
                }
            }
            let area = seen.len() as f64 / (PX_PER_M * scale).powi(2);
            assert!((0.93..1.2).contains(&(area / case.area_m2)), "{:?}: {area} m²", case.form);
        }
    }
}

#[test]
fn rings_and_holes_are_seen_through() {
    let image = pictured(&side_by_side(1.0));
    for case in cases() {
        let middle = [(112.0 + PX_PER_M * case.y_m) as usize, 112];
        let is_open = matches!(case.form, VisualShape::Torus { .. } | VisualShape::Extrusion { .. });
        assert_eq!(shown(&image, &case).contains(&middle), !is_open, "{:?}", case.form);
    }
}

#[test]
fn a_body_without_visuals_is_seen_as_its_parts() {
    let mut scene = side_by_side(1.0);
    let ball = scene.bodies[0].visuals[0].shape.clone();
    let as_visual = pictured(&scene);
    scene.bodies[0].visuals.clear();
    scene.bodies[0].parts[0].shape = Primitive::Ball { radius: 0.05 };
    assert_eq!(ball, VisualShape::Primitive(scene.bodies[0].parts[0].shape));
    assert!(as_visual == pictured(&scene), "a part and a visual of one shape look different");
}

#[test]
fn mo_color_gives_every_visual_a_colour_of_its_own() {
    let (nominal, snapshot) = drawn(TaskId::DualArmLiftTray);
    let spec = perturbed(TaskId::DualArmLiftTray, Perturbation::MoColor);
    let [first, again, other] = [5, 5, 6].map(|seed| {
        let scene = spec.draw(seed);
        let visuals = &scene.body("tray").visuals;
        visuals.iter().map(|visual| visual.appearance.color).collect::<Vec<_>>()
    });
    assert_eq!(first, again);
    assert!(first.len() == 2 && first[0] != first[1], "{first:?}");
    assert!(first.iter().zip(&other).all(|(a, b)| a != b), "{first:?} and {other:?}");
    let mut colored = nominal.clone();
    colored.bodies[0].visuals = spec.draw(5).bodies[0].visuals.clone();
    let changed = differing(&image(&nominal, &snapshot, 0), &image(&colored, &snapshot, 0));
    assert!(changed > 500, "{changed} pixels change");
}

#[test]
fn visuals_grow_with_their_body() {
    let spec = perturbed(TaskId::DualArmLiftTray, Perturbation::MoSize);
    for seed in 0..8 {
        let tray = spec.draw(seed).body("tray").clone();
        for (visual, at_one) in tray.visuals.iter().zip(&spec.bodies[0].visuals) {
            assert_eq!(visual.shape, at_one.shape.scaled(tray.scale));
            let expected = at_one.pose.translation.vector * tray.scale;
            assert_eq!(visual.pose.translation.vector, expected);
        }
        assert!((tray.scale - 1.0).abs() > 1e-3, "the seed {seed} draws the nominal size");
    }
}
