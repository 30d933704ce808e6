//! Depth and segmentation. As in `projection`, the camera looks along −x from (1, 0, 0.5) m and a metre at 1
//! m spans 112 pixels.

use std::collections::BTreeSet;

use ipc_types::ImageSizes;
use sim::TaskId;
use sim::render::{CpuRenderer, Inspection, RenderScene, Segment};
use sim::scene::{Primitive, Scene, Snapshot};

use crate::common::{BLUE, body, empty_room, first_scene, initial_snapshot, is_blue, pixels_where, render};

const SIDE: usize = 224;

fn inspect(scene: &Scene, snapshot: &Snapshot, camera_idx: usize) -> Inspection {
    CpuRenderer::new(1).inspect(&RenderScene::new(scene, ImageSizes::BENCHMARK), snapshot, camera_idx)
}

fn scene_with_cube() -> Scene {
    let mut scene = empty_room([1.0, 0.0, 0.5], [0.0, 0.0, 0.5]);
    scene.bodies.push(body("cube", Primitive::Box { half: [0.1; 3] }, [0.0, 0.0, 0.5], BLUE));
    scene
}

#[test]
fn box_has_its_depth_and_silhouette() {
    let scene = scene_with_cube();
    let snapshot = initial_snapshot(&scene);
    let inspection = inspect(&scene, &snapshot, 0);
    let cube: Vec<[usize; 2]> = (0..SIDE * SIDE)
        .filter(|pixel| inspection.segments[*pixel] == Segment::Body(0))
        .map(|pixel| [pixel % SIDE, pixel / SIDE])
        .collect();
    assert_eq!(cube, pixels_where(&render(&scene, &snapshot, 0), SIDE, is_blue));
    assert_eq!(cube.len(), 24 * 24);
    for [x, y] in cube {
        let depth_m = inspection.depth_m[y * SIDE + x];
        assert!((depth_m - 0.9).abs() < 1e-3, "{depth_m} m at column {x}, row {y}");
    }
}

#[test]
fn table_and_floor_depths_follow_their_planes() {
    // The table top lies 0.5 m below the eye and extends from x = 0.4845 m to −0.7245 m. The floor is at z =
    // −0.9196 m.
    let inspection = inspect(&scene_with_cube(), &initial_snapshot(&scene_with_cube()), 0);
    for row in 113..SIDE {
        // A column that misses the cube.
        let pixel = row * SIDE + 90;
        let slope = (row as f32 + 0.5 - 112.0) / 112.0;
        let (table_m, floor_m) = (0.5 / slope, 1.4196 / slope);
        let expected_m = match table_m {
            0.53..1.70 => table_m,
            1.75.. if floor_m < 20.9 => floor_m,
            _ => continue,
        };
        let expected = if expected_m == table_m { Segment::Table } else { Segment::Floor };
        assert_eq!(inspection.segments[pixel], expected, "row {row}");
        let depth_m = inspection.depth_m[pixel];
        assert!((depth_m - expected_m).abs() < 1e-3 * expected_m.max(1.0), "{depth_m} m at row {row}");
    }
}

#[test]
fn walls_are_distinguished_from_background() {
    let mut scene = scene_with_cube();
    // 0.2 m above the horizon at 1 m, where only a wall can be visible. Its inner face is at x = −1.45 m.
    let pixel = (112 - 22) * SIDE + 10;
    let open = inspect(&scene, &initial_snapshot(&scene), 0);
    assert_eq!((open.segments[pixel], open.depth_m[pixel]), (Segment::Nothing, f32::INFINITY));
    scene.background.walls = Some(scene.table.top);
    let walled = inspect(&scene, &initial_snapshot(&scene), 0);
    assert_eq!(walled.segments[112 * SIDE + 90], Segment::Walls);
    assert!((walled.depth_m[112 * SIDE + 90] - 2.45).abs() < 1e-3, "{} m", walled.depth_m[112 * SIDE + 90]);
    for (segment, depth_m) in walled.segments.iter().zip(&walled.depth_m) {
        assert_eq!(*segment == Segment::Nothing, depth_m.is_infinite());
    }
}

#[test]
fn all_bodies_and_arms_are_visible() {
    for &task in TaskId::ALL {
        let (scene, snapshot) = first_scene(task);
        let visible: BTreeSet<Segment> = (0..scene.cameras.len())
            .flat_map(|camera_idx| inspect(&scene, &snapshot, camera_idx).segments)
            .collect();
        for segment in
            (0..scene.bodies.len()).map(Segment::Body).chain((0..scene.robots.len()).map(Segment::Arm))
        {
            assert!(visible.contains(&segment), "{}: {segment:?} is not in {visible:?}", task.name());
        }
        assert!(visible.contains(&Segment::Table) && visible.contains(&Segment::Floor), "{}", task.name());
    }
}
