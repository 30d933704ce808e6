//! Scenes and image helpers shared by the renderer tests.

use ipc_types::{ControlMode, ImageSizes};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::stream::episode_seed;
use sim::scene::{
    Appearance, Background, Body, Camera, CameraMount, CameraSlot, Lights, Mass, Motion, Part, Primitive,
    Role, Scene, SceneSpec, Snapshot, Table, TableKind,
};
use sim::{Perturbation, Profile, TaskId};

pub(crate) const BLUE: [f64; 3] = [0.0, 0.0, 1.0];
pub(crate) const RED: [f64; 3] = [1.0, 0.0, 0.0];

/// Returns the first scene of a task, with its initial snapshot.
pub(crate) fn first_scene(task: TaskId) -> (Scene, Snapshot) {
    let spec = (task.task().nominal)(Profile::Strict);
    let scene = spec.draw(episode_seed(0, task.name(), 0));
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
    (scene, snapshot)
}

/// Returns the scene distribution of a task under a perturbation.
pub(crate) fn perturbed(task: TaskId, perturbation: Perturbation) -> SceneSpec {
    Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL)
}

/// Returns a room with a table, ambient light and a camera at `eye` that looks at `target` with a 90° field
/// of view.
pub(crate) fn empty_room(eye: [f64; 3], target: [f64; 3]) -> Scene {
    let paint = |color| Appearance { color, texture: None, specular: 0.0, metallic: 0.0 };
    Scene {
        sizes: Vec::new(),
        physics_hz: 100,
        bodies: Vec::new(),
        robots: Vec::new(),
        table: Table {
            kind: TableKind::SingleArm,
            top: paint([0.6; 3]),
            legs: paint([0.6; 3]),
            lower_top: None,
            as_block: false,
        },
        background: Background { floor: paint([0.4; 3]), walls: None },
        lights: Lights { ambient: [1.0; 3], directional: Vec::new(), shadows: false },
        cameras: vec![Camera {
            slot: CameraSlot::External1,
            mount: CameraMount::World { eye, target },
            pose_error: Isometry3::identity(),
            fov_y_rad: core::f64::consts::FRAC_PI_2,
            clip_m: [0.01, 100.0],
        }],
        instruction: String::new(),
    }
}

/// Returns a body with one collision part and no visuals.
pub(crate) fn body(name: &'static str, shape: Primitive, position: [f64; 3], color: [f64; 3]) -> Body {
    Body {
        name,
        role: Role::ManipulationObject,
        motion: Motion::Dynamic,
        parts: vec![Part {
            shape,
            pose: Isometry3::identity(),
            appearance: Appearance { color, texture: None, specular: 0.0, metallic: 0.0 },
        }],
        visuals: Vec::new(),
        scale: Vector3::repeat(1.0),
        pose: Isometry3::from_parts(Translation3::from(Vector3::from(position)), UnitQuaternion::identity()),
        drop_m: 0.0,
        mass: Mass::Density(1000.0),
        friction: 0.3,
        damping: [0.0; 2],
    }
}

/// Returns the initial snapshot of a scene without arms.
pub(crate) fn initial_snapshot(scene: &Scene) -> Snapshot {
    Snapshot { bodies: scene.bodies.iter().map(|body| body.pose.cast()).collect(), arms: Vec::new() }
}

/// Renders one image.
pub(crate) fn render(scene: &Scene, snapshot: &Snapshot, camera_idx: usize) -> Vec<u8> {
    let scene = RenderScene::new(scene, ImageSizes::BENCHMARK);
    let mut out = vec![0; scene.size(camera_idx).n_bytes()];
    CpuRenderer::new(1).render(&mut [View { scene: &scene, snapshot, camera_idx, out: &mut out }]).unwrap();
    out
}

/// Returns [column, row] of all pixels of a `side` × `side` image that satisfy `predicate`.
pub(crate) fn pixels_where(
    image: &[u8],
    side: usize,
    predicate: impl Fn([u8; 3]) -> bool,
) -> Vec<[usize; 2]> {
    let rgb = image.chunks_exact(3).map(|p| [p[0], p[1], p[2]]);
    rgb.enumerate().filter(|(_, rgb)| predicate(*rgb)).map(|(i, _)| [i % side, i / side]).collect()
}

/// Returns `true` if a pixel shows a [`BLUE`] surface.
pub(crate) fn is_blue([r, g, b]: [u8; 3]) -> bool {
    r == 0 && g == 0 && b > 0
}

/// Returns `true` if a pixel shows a [`RED`] surface.
pub(crate) fn is_red([r, g, b]: [u8; 3]) -> bool {
    r > 0 && g == 0 && b == 0
}

/// Returns the minimum and maximum [column, row] of some pixels.
pub(crate) fn bounds(pixels: &[[usize; 2]]) -> [[usize; 2]; 2] {
    let reduce = |axis: usize, f: fn(usize, usize) -> usize| {
        pixels.iter().map(|p| p[axis]).reduce(f).expect("no pixels to bound")
    };
    [[reduce(0, usize::min), reduce(1, usize::min)], [reduce(0, usize::max), reduce(1, usize::max)]]
}

/// Returns the number of pixels that differ between two images.
pub(crate) fn n_different_pixels(a: &[u8], b: &[u8]) -> usize {
    a.chunks_exact(3).zip(b.chunks_exact(3)).filter(|(a, b)| a != b).count()
}
