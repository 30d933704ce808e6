//! Depths and segments. As in `projection`, the camera looks along −x from (1, 0, 0.5) and has 112 pixels per metre at 1 m.

use std::collections::BTreeSet;

use sim::TaskId;
use sim::render::{CpuRenderer, Inspection, RenderScene, Segment};
use sim::scene::{Primitive, Scene, Snapshot};

use crate::common::{BLUE, as_placed, body, drawn, empty_room, image, is_blue, pixels};

const SIDE: usize = 224;

fn inspect(scene: &Scene, snapshot: &Snapshot, camera_idx: usize) -> Inspection {
    CpuRenderer::new(1).inspect(&RenderScene::new(scene), snapshot, camera_idx)
}

fn scene_with_cube() -> Scene {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    scene
}

#[test]
fn a_box_is_as_far_as_it_stands_and_no_larger() {
    let scene = scene_with_cube();
    let snapshot = as_placed(&scene);
    let seen = inspect(&scene, &snapshot, 0);
    let cube: Vec<[usize; 2]> = (0..SIDE * SIDE)
        .filter(|pixel| seen.segments[*pixel] == Segment::Body(0))
        .map(|pixel| [pixel % SIDE, pixel / SIDE])
        .collect();
    assert_eq!(cube, pixels(&image(&scene, &snapshot, 0), SIDE, is_blue));
    assert_eq!(cube.len(), 24 * 24);
    for [x, y] in cube {
        let depth_m = seen.depth_m[y * SIDE + x];
        assert!((depth_m - 0.9).abs() < 1e-3, "{depth_m} m at column {x}, row {y}");
    }
}

#[test]
fn the_table_recedes_to_its_edge_and_the_floor_goes_on() {
    // The table's top lies 0.5 m under the eye and reaches from x = 0.4845 to −0.7245 m; the floor lies at z = −0.9196 m.
    let seen = inspect(&scene_with_cube(), &as_placed(&scene_with_cube()), 0);
    for row in 113..SIDE {
        // Beside the cube.
        let pixel = row * SIDE + 90;
        let slope = (row as f32 + 0.5 - 112.0) / 112.0;
        let (table_m, floor_m) = (0.5 / slope, 1.4196 / slope);
        let expected_m = match table_m {
            0.53..1.70 => table_m,
            1.75.. if floor_m < 20.9 => floor_m,
            _ => continue,
        };
        let expected = if expected_m == table_m { Segment::Table } else { Segment::Floor };
        assert_eq!(seen.segments[pixel], expected, "row {row}");
        let depth_m = seen.depth_m[pixel];
        assert!((depth_m - expected_m).abs() < 1e-3 * expected_m.max(1.0), "{depth_m} m at row {row}");
    }
}

#[test]
fn walls_are_told_from_nothing() {
    let mut scene = scene_with_cube();
    // 0.2 m above the horizon at 1 m, where only a wall can be: its inner face is at x = −1.45 m.
    let pixel = (112 - 22) * SIDE + 10;
    let open = inspect(&scene, &as_placed(&scene), 0);
    assert_eq!((open.segments[pixel], open.depth_m[pixel]), (Segment::Nothing, f32::INFINITY));
    scene.background.walls = Some(scene.table.top);
    let walled = inspect(&scene, &as_placed(&scene), 0);
    assert_eq!(walled.segments[112 * SIDE + 90], Segment::Walls);
    assert!((walled.depth_m[112 * SIDE + 90] - 2.45).abs() < 1e-3, "{} m", walled.depth_m[112 * SIDE + 90]);
    for (segment, depth_m) in walled.segments.iter().zip(&walled.depth_m) {
        assert_eq!(*segment == Segment::Nothing, depth_m.is_infinite());
    }
}

#[test]
fn every_body_and_arm_of_a_task_is_seen_by_some_camera() {
    for &task in TaskId::ALL {
        let (scene, snapshot) = drawn(task);
        let seen: BTreeSet<Segment> = (0..scene.cameras.len())
            .flat_map(|camera_idx| inspect(&scene, &snapshot, camera_idx).segments)
            .collect();
        for segment in
            (0..scene.bodies.len()).map(Segment::Body).chain((0..scene.robots.len()).map(Segment::Arm))
        {
            assert!(seen.contains(&segment), "{}: {segment:?} is not in {seen:?}", task.name());
        }
        assert!(seen.contains(&Segment::Table) && seen.contains(&Segment::Floor), "{}", task.name());
    }
}
