//! Shared building blocks of tasks: the single-arm and bimanual workspaces (arms, table, lights and cameras)
//! and recurring bodies. See docs/benchmark.md, "Scenes and objects" and "Robot and control".

pub(crate) mod bimanual_plan;
pub(crate) mod furniture;
pub(crate) mod kitchen;
pub(crate) mod objects;
pub(crate) mod stacking;

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, PI};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use scene::{
    AppearanceSpec, BackgroundSpec, BodySpec, CameraMount, CameraSlot, CameraSpec, DirectionalLightSpec,
    DistractorPlacement, DistractorsSpec, InstructionSpec, Jitter, LightsSpec, Mass, Motion, PartSpec,
    PlacementSpec, Primitive, Range, RegionSpec, RenderParts, RobotSpec, Role, ScaleAxes, ScaledBy, Scene,
    SceneSpec, TableKind, TableSpec, Texture, VisualShape, VisualSpec, WidenedRanges,
};
pub use scene::{rgb, srgb};

/// World z of the single-arm table top, in m.
pub const SINGLE_TABLE_Z: f64 = 0.0;
/// World z of the bimanual table top, in m.
pub const BIMANUAL_TABLE_Z: f64 = 0.825;
/// Default density of a body, in kg/m³.
pub const DENSITY: f64 = 1000.0;
/// Default linear and angular damping of a body, in 1/s: those of the benchmark's engine.
pub const DAMPING: [f64; 2] = [0.0, 0.05];
/// Default friction coefficient of a body.
pub const FRICTION: f64 = 0.3;

/// sRGB colour of the benchmark's blue cubes.
pub const BLUE: [f64; 3] = rgb([12, 42, 160]);

/// Default initial joint positions of the single arm, in rad: TCP at world (0, 0, 0.1698) m, pointing down.
pub const QPOS_D: [f64; 7] = [0.0, PI / 8.0, 0.0, -5.0 * PI / 8.0, 0.0, 3.0 * FRAC_PI_4, -FRAC_PI_4];
/// Default initial joint positions of each of the two arms, in rad.
pub const QPOS_B: [f64; 7] = [FRAC_PI_2, 0.0, 0.0, -7.0 * PI / 8.0, 0.0, 3.0 * FRAC_PI_4, FRAC_PI_4];
/// Standard deviation of the noise on the initial joint positions in rad, for tasks that randomize them.
pub const QPOS_NOISE_RAD: f64 = 0.02;

/// Poses of the two external cameras, each given as camera position and look-at point in the world, in m.
pub struct ExternalCameras {
    /// Position and look-at point of camera `external1`.
    pub external1: [[f64; 3]; 2],
    /// Position and look-at point of camera `external2`.
    pub external2: [[f64; 3]; 2],
}

/// External cameras of the tasks in which both arms lift or pour.
pub const LIFT_CAMERAS: ExternalCameras = ExternalCameras {
    external1: [[0.75, 0.0, 1.58], [-0.2, 0.0, 1.13]],
    external2: [[-0.5, -0.25, 1.58], [-0.2, 0.0, 1.13]],
};

/// Creates the scene distribution of one arm at the single-arm table.
pub fn single_arm(
    qpos: [f64; 7],
    noise_rad: f64,
    cameras: &ExternalCameras,
    regions: Vec<RegionSpec>,
    bodies: Vec<BodySpec>,
    instruction: &'static str,
) -> SceneSpec {
    workspace(
        Morphology::Single,
        vec![robot([-0.615, 0.0, 0.0], 0.0, qpos, noise_rad)],
        cameras,
        regions,
        bodies,
        instruction,
    )
}

/// Creates the scene distribution of two arms facing each other across the bimanual table.
pub fn bimanual(
    qpos: [[f64; 7]; 2],
    noise_rad: f64,
    cameras: &ExternalCameras,
    regions: Vec<RegionSpec>,
    bodies: Vec<BodySpec>,
    instruction: &'static str,
) -> SceneSpec {
    let robots = vec![
        robot([-0.4, -0.6, BIMANUAL_TABLE_Z], 0.0, qpos[0], noise_rad),
        robot([-0.4, 0.6, BIMANUAL_TABLE_Z], PI, qpos[1], noise_rad),
    ];
    workspace(Morphology::Bimanual, robots, cameras, regions, bodies, instruction)
}

/// Creates a placement region with the benchmark's default widening under Pose-Randomization.
pub fn region(name: &'static str, x: Range, y: Range) -> RegionSpec {
    let shared_offset = [Range::fixed(0.0); 2];
    let widened = Some(WidenedRanges { x: widened_by_half(x), y: widened_by_half(y), shared_offset });
    RegionSpec { name, x, y, shared_offset, random_mirror: false, min_gap_m: None, widened }
}

/// Returns a range as Pose-Randomization widens it: 1.5 times as wide, or 0.15 m if it is a single value.
pub fn widened_by_half(range: Range) -> Range {
    /// Ranges narrower than this count as a single value, in m.
    const MIN_WIDTH: f64 = 1e-6;
    let width = range.hi - range.lo;
    if width < MIN_WIDTH { Range::new(range.lo - 0.075, range.hi + 0.075) } else { range.widened(1.5) }
}

/// Creates a dynamic manipulated object without visuals, level on a surface and scaled by MO-Size.
pub fn movable(name: &'static str, parts: Vec<PartSpec>, region: usize, surface_z_m: f64) -> BodySpec {
    BodySpec {
        name,
        role: Role::ManipulationObject,
        motion: Motion::Dynamic,
        parts,
        visuals: Vec::new(),
        render_parts: RenderParts::PerAppearance,
        scaled_by: ScaledBy::MoSize,
        scale: Range::fixed(1.0),
        scale_axes: ScaleAxes::Together,
        placement: PlacementSpec::OnSurface {
            region,
            surface_z_m,
            origin_z_m: None,
            orientation: UnitQuaternion::identity(),
            yaw: Range::fixed(0.0),
        },
        mass: Mass::Density(DENSITY),
        friction: FRICTION,
        damping: DAMPING,
    }
}

/// Creates a fixed receptacle object without visuals, which no perturbation scales for the given reason.
pub fn fixed(
    name: &'static str,
    parts: Vec<PartSpec>,
    region: usize,
    surface_z_m: f64,
    reason_not_scaled: &'static str,
) -> BodySpec {
    BodySpec {
        role: Role::ReceiverObject,
        motion: Motion::Fixed,
        scaled_by: ScaledBy::Nothing(reason_not_scaled),
        ..movable(name, parts, region, surface_z_m)
    }
}

/// Creates a box part with half-extents `half`, centred at `position` in the body's frame, in m.
pub fn box_part(half: [f64; 3], position: [f64; 3], appearance: AppearanceSpec) -> PartSpec {
    PartSpec::at(Primitive::Box { half }, position, appearance)
}

/// Creates the visual that renders a part unchanged, for bodies with additional visuals.
pub fn visual_of(part: &PartSpec) -> VisualSpec {
    VisualSpec {
        shape: VisualShape::Primitive(part.shape.clone()),
        pose: part.pose,
        appearance: part.appearance,
    }
}

/// Requires the body to be more than `by_m` above its initial height.
pub fn lifted(scene: &Scene, body: usize, by_m: f64, profile: Profile) -> Predicate {
    let from = scene.bodies[body].pose.translation.vector;
    if profile.counts_sinking() {
        Predicate::Moved { body, from: from.into(), along: [0.0, 0.0, 1.0], by_m }
    } else {
        Predicate::Above { body, z_m: from.z + by_m }
    }
}

/// Creates a movable cube with half-extent `half`, in m.
pub fn cube(name: &'static str, half: f64, color: [f64; 3], region: usize, surface_z_m: f64) -> BodySpec {
    let part = box_part([half; 3], [0.0; 3], AppearanceSpec::plain(color));
    movable(name, vec![part], region, surface_z_m)
}

/// Creates a goal marker on the bimanual table, which does not collide.
pub fn goal_marker(region: usize, parts: Vec<PartSpec>) -> BodySpec {
    BodySpec {
        role: Role::ReceiverObject,
        motion: Motion::VisualOnly,
        scaled_by: ScaledBy::Nothing("it is a mark on the table"),
        ..movable("goal", parts, region, BIMANUAL_TABLE_Z)
    }
}

/// Radius of the goal disc on which cubes are stacked, in m.
pub const GOAL_RADIUS: f64 = 0.06;

/// Creates a goal disc of five alternating red and white rings, each slightly higher than the one around it.
pub fn goal_disc(region: usize) -> BodySpec {
    const RED: [f64; 3] = rgb([194, 19, 22]);
    let ring = |i: u32| {
        let (radius, half_height) = (GOAL_RADIUS * f64::from(5 - i) / 5.0, 2e-4 * f64::from(i + 1));
        let color = if i.is_multiple_of(2) { RED } else { [1.0; 3] };
        PartSpec::at(
            Primitive::Cylinder { radius, half_height },
            [0.0, 0.0, half_height],
            AppearanceSpec::plain(color),
        )
    };
    let rings = (0..5).map(ring).collect();
    BodySpec { render_parts: RenderParts::PerShape, ..goal_marker(region, rings) }
}

fn workspace(
    morphology: Morphology,
    robots: Vec<RobotSpec>,
    cameras: &ExternalCameras,
    regions: Vec<RegionSpec>,
    bodies: Vec<BodySpec>,
    instruction: &'static str,
) -> SceneSpec {
    let (fov_y_rad, far, kind) = match morphology {
        Morphology::Single => (FRAC_PI_2, 100.0, TableKind::SingleArm),
        Morphology::Bimanual => (PI / 3.0, 10.0, TableKind::Bimanual),
    };
    let external = |slot, [eye, target]: [[f64; 3]; 2]| CameraSpec {
        slot,
        mount: CameraMount::World { eye, target },
        fov_y_rad,
        clip_m: [0.01, far],
        jitter: Jitter::NONE,
    };
    let mut cameras = vec![
        external(CameraSlot::External1, cameras.external1),
        external(CameraSlot::External2, cameras.external2),
    ];
    cameras.extend(
        [CameraSlot::Hand1, CameraSlot::Hand2].into_iter().take(morphology.n_arms()).enumerate().map(
            |(arm, slot)| CameraSpec {
                slot,
                mount: CameraMount::Hand { arm, pose: hand_camera_pose() },
                fov_y_rad: FRAC_PI_2,
                clip_m: [0.01, 100.0],
                jitter: Jitter::NONE,
            },
        ),
    );
    let manipulated = bodies.iter().position(|body| body.role == Role::ManipulationObject);
    SceneSpec {
        bodies,
        regions,
        min_start_gap_m: None,
        sizes: None,
        physics_hz: 100,
        robots,
        table: table(kind),
        background: BackgroundSpec {
            floor: AppearanceSpec::textured(Texture::FloorGrid, [1.0; 3]),
            walls: AppearanceSpec::plain([0.5; 3]),
        },
        lights: default_lights(),
        cameras,
        distractors: DistractorsSpec {
            n: 2,
            presence: 0.0,
            x: Range::symmetric(0.4),
            y: Range::symmetric(0.4),
            placement: DistractorPlacement::Resting,
            drop_m: (0.25, manipulated),
            surface_z_m: match morphology {
                Morphology::Single => SINGLE_TABLE_Z,
                Morphology::Bimanual => BIMANUAL_TABLE_Z,
            },
        },
        instruction: InstructionSpec::training(instruction),
    }
}

/// Creates the wooden table. The bimanual one stands on the table of a single arm.
fn table(kind: TableKind) -> TableSpec {
    // The benchmark's mesh declares the varnished top a metal, which gives it coppery highlights.
    let cedar = AppearanceSpec { metallic: 1.0, ..AppearanceSpec::textured(Texture::Cedar, [1.0; 3]) };
    let maple = AppearanceSpec::textured(Texture::Maple, [1.0; 3]);
    let grey = AppearanceSpec::plain([0.8; 3]);
    let is_bimanual = kind == TableKind::Bimanual;
    TableSpec {
        kind,
        top: if is_bimanual { maple } else { cedar },
        legs: grey,
        lower_top: is_bimanual.then_some(cedar),
        as_block: false,
    }
}

fn robot(base: [f64; 3], yaw_rad: f64, qpos: [f64; 7], noise_rad: f64) -> RobotSpec {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    RobotSpec { base: Isometry3::from_parts(Translation3::from(base), rotation), qpos, noise_rad }
}

/// Returns the pose of the wrist camera in the hand's frame. It looks along the approach direction; see
/// docs/benchmark.md, "Cameras".
fn hand_camera_pose() -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2));
    Isometry3::from_parts(Translation3::new(0.0465, -0.02, 0.036), rotation)
}

/// Returns the default lighting: ambient light of 0.3 and two white directional lights, one oblique and one
/// from above, without shadows.
fn default_lights() -> LightsSpec {
    let white =
        |direction| DirectionalLightSpec { color: [Range::fixed(1.0); 3], direction, yaw: Range::fixed(0.0) };
    LightsSpec {
        ambient: [Range::fixed(0.3); 3],
        directional: vec![white([1.0, 1.0, -1.0]), white([0.0, 0.0, -1.0])],
        shadows: false,
    }
}
