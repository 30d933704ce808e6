//! What tasks share: the two workplaces with their arms, tables, lights and cameras (spec/env.md §2 to §4, §7),
//! and the bodies that stand there.

pub(super) mod cabinet;
pub(super) mod cooking;
pub(super) mod dish;
pub(super) mod drawer_unit;
pub(super) mod fruit;
pub(super) mod holed;
pub(super) mod insertion;
pub(super) mod pot;
pub(super) mod props;
pub(super) mod stacking;
pub(super) mod tools;
pub(super) mod tray;
pub(super) mod vessel;

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, PI};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::predicate::Predicate;
use crate::profile::Profile;
pub use crate::scene::rgb;
use crate::scene::{
    BackgroundSpec, BodySpec, CameraMount, CameraSlot, CameraSpec, DirectionalSpec, DistractorsSpec, Form,
    InstructionSpec, Jitter, LightsSpec, Motion, PaintSpec, PartSpec, PlacementSpec, Primitive, Range,
    RegionSpec, RobotSpec, Role, ScaledBy, Scene, SceneSpec, TableKind, TableSpec, Texture, VisualSpec,
    Widened,
};

/// World z of the single-arm table's top, in m.
pub const SINGLE_TABLE_Z: f64 = 0.0;
/// World z of the bimanual table's top, in m.
pub const BIMANUAL_TABLE_Z: f64 = 0.825;
/// kg/m³ of a body unless its task says otherwise.
pub const DENSITY: f64 = 1000.0;
/// Friction of a body unless its task says otherwise.
pub const FRICTION: f64 = 0.3;

/// Colour of the benchmark's blue cubes.
pub const BLUE: [f64; 3] = rgb([12, 42, 160]);

/// Start pose D of spec/tasks.md §1: TCP at (0, 0, 0.1698), pointing down.
pub const QPOS_D: [f64; 7] = [0.0, PI / 8.0, 0.0, -5.0 * PI / 8.0, 0.0, 3.0 * FRAC_PI_4, -FRAC_PI_4];
/// Rest pose B of spec/tasks.md §1, the same for both arms.
pub const QPOS_B: [f64; 7] = [FRAC_PI_2, 0.0, 0.0, -7.0 * PI / 8.0, 0.0, 3.0 * FRAC_PI_4, FRAC_PI_4];
/// Initial joint noise in rad, where a task does not fix its start pose.
pub const NOISE_RAD: f64 = 0.02;

/// Eyes and common target of the two external cameras.
pub struct Eyes {
    /// Eye and target of external 1, in m.
    pub external1: [[f64; 3]; 2],
    /// Eye and target of external 2, in m.
    pub external2: [[f64; 3]; 2],
}

/// Where the cameras are for what two arms lift and pour.
pub const LIFT_EYES: Eyes = Eyes {
    external1: [[0.75, 0.0, 1.58], [-0.2, 0.0, 1.13]],
    external2: [[-0.5, -0.25, 1.58], [-0.2, 0.0, 1.13]],
};

/// One arm at the single-arm table.
pub fn single_arm(
    qpos: [f64; 7],
    noise_rad: f64,
    eyes: &Eyes,
    regions: Vec<RegionSpec>,
    bodies: Vec<BodySpec>,
    instruction: &'static str,
) -> SceneSpec {
    workplace(
        Morphology::Single,
        vec![robot([-0.615, 0.0, 0.0], 0.0, qpos, noise_rad)],
        eyes,
        regions,
        bodies,
        instruction,
    )
}

/// Two arms facing each other across the bimanual table.
pub fn bimanual(
    qpos: [[f64; 7]; 2],
    noise_rad: f64,
    eyes: &Eyes,
    regions: Vec<RegionSpec>,
    bodies: Vec<BodySpec>,
    instruction: &'static str,
) -> SceneSpec {
    let robots = vec![
        robot([-0.4, -0.6, BIMANUAL_TABLE_Z], 0.0, qpos[0], noise_rad),
        robot([-0.4, 0.6, BIMANUAL_TABLE_Z], PI, qpos[1], noise_rad),
    ];
    workplace(Morphology::Bimanual, robots, eyes, regions, bodies, instruction)
}

/// A region around the origin in which one body is placed.
pub fn region(name: &'static str, x: Range, y: Range) -> RegionSpec {
    let common = [Range::fixed(0.0); 2];
    let widened = Some(Widened { x: by_half(x), y: by_half(y), common });
    RegionSpec { name, x, y, common, either_side: false, gap_m: None, widened }
}

/// A range as Pose-Randomization widens it: half as wide again, a point to 0.15 m (spec/perturbations.md §3).
pub fn by_half(range: Range) -> Range {
    const POINT: f64 = 1e-6;
    let width = range.hi - range.lo;
    if width < POINT { Range::new(range.lo - 0.075, range.hi + 0.075) } else { range.widened(1.5) }
}

/// A body to be handled that is seen as it collides, lies on a surface as its frame does and is scaled by MO-Size.
pub fn movable(name: &'static str, parts: Vec<PartSpec>, region: usize, surface_z_m: f64) -> BodySpec {
    BodySpec {
        name,
        role: Role::ManipulationObject,
        motion: Motion::Dynamic,
        parts,
        visuals: Vec::new(),
        scaled_by: ScaledBy::MoSize,
        scale: Range::fixed(1.0),
        placement: PlacementSpec::On {
            region,
            surface_z_m,
            upright: UnitQuaternion::identity(),
            yaw: Range::fixed(0.0),
        },
        density: DENSITY,
        friction: FRICTION,
        damping: [0.0; 2],
    }
}

/// A body that stands fast, is seen as it collides and keeps its size, for the reason given: what a handled one goes to
/// or comes from.
pub fn fixed(
    name: &'static str,
    parts: Vec<PartSpec>,
    region: usize,
    surface_z_m: f64,
    why_not_scaled: &'static str,
) -> BodySpec {
    BodySpec {
        role: Role::ReceiverObject,
        motion: Motion::Fixed,
        scaled_by: ScaledBy::Nothing(why_not_scaled),
        ..movable(name, parts, region, surface_z_m)
    }
}

/// A box of half extents `half` around `position` in the body's frame, in m.
pub fn block(half: [f64; 3], position: [f64; 3], paint: PaintSpec) -> PartSpec {
    PartSpec::at(Primitive::Box { half }, position, paint)
}

/// A part as it is seen, where a body shows more than its parts.
pub fn seen(part: &PartSpec) -> VisualSpec {
    VisualSpec { form: Form::Primitive(part.shape), pose: part.pose, paint: part.paint }
}

/// The body by more than a height above its start.
pub fn lifted(scene: &Scene, body: usize, by_m: f64, profile: Profile) -> Predicate {
    let from = scene.bodies[body].pose.translation.vector;
    if profile.counts_sinking() {
        Predicate::Moved { body, from: from.into(), along: [0.0, 0.0, 1.0], by_m }
    } else {
        Predicate::Above { body, z_m: from.z + by_m }
    }
}

/// A movable cube with edges of twice `half`, in m.
pub fn cube(name: &'static str, half: f64, color: [f64; 3], region: usize, surface_z_m: f64) -> BodySpec {
    let part = block([half; 3], [0.0; 3], PaintSpec::plain(color));
    movable(name, vec![part], region, surface_z_m)
}

/// Where tasks end that bring something to a place: a mark on the bimanual table, no thicker than paint.
pub fn goal(region: usize, parts: Vec<PartSpec>) -> BodySpec {
    BodySpec {
        role: Role::ReceiverObject,
        motion: Motion::Mark,
        scaled_by: ScaledBy::Nothing("it is a mark on the table"),
        ..movable("goal", parts, region, BIMANUAL_TABLE_Z)
    }
}

/// Radius of the disc on which cubes are stacked, in m.
pub const GOAL_RADIUS: f64 = 0.06;

/// Five rings, red and white in turn, each a little above the one around it.
pub fn goal_disc(region: usize) -> BodySpec {
    const RED: [f64; 3] = rgb([194, 19, 22]);
    let ring = |i: u32| {
        let (radius, half_height) = (GOAL_RADIUS * f64::from(5 - i) / 5.0, 2e-4 * f64::from(i + 1));
        let color = if i.is_multiple_of(2) { RED } else { [1.0; 3] };
        PartSpec::at(
            Primitive::Cylinder { radius, half_height },
            [0.0, 0.0, half_height],
            PaintSpec::plain(color),
        )
    };
    goal(region, (0..5).map(ring).collect())
}

fn workplace(
    morphology: Morphology,
    robots: Vec<RobotSpec>,
    eyes: &Eyes,
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
        external(CameraSlot::External1, eyes.external1),
        external(CameraSlot::External2, eyes.external2),
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
    SceneSpec {
        bodies,
        regions,
        sizes: None,
        robots,
        table: table(kind),
        background: BackgroundSpec {
            floor: PaintSpec::textured(Texture::Checker, [0.55, 0.55, 0.55]),
            walls: PaintSpec::plain([0.5; 3]),
        },
        lights: default_lights(),
        cameras,
        distractors: DistractorsSpec {
            n: 2,
            presence: 0.0,
            x: Range::symmetric(0.4),
            y: Range::symmetric(0.4),
            surface_z_m: match morphology {
                Morphology::Single => SINGLE_TABLE_Z,
                Morphology::Bimanual => BIMANUAL_TABLE_Z,
            },
        },
        instruction: InstructionSpec::training(instruction),
    }
}

/// A wooden top on steel; over a grey one where two arms work.
fn table(kind: TableKind) -> TableSpec {
    let plain = |color, specular| PaintSpec { specular, ..PaintSpec::plain(color) };
    let steel = plain([0.45, 0.46, 0.48], 0.3);
    TableSpec {
        kind,
        top: PaintSpec::textured(Texture::Wood, [0.80, 0.66, 0.47]),
        frame: steel,
        legs: steel,
        under: (kind == TableKind::Bimanual).then(|| plain([0.62, 0.62, 0.63], 0.1)),
    }
}

fn robot(base: [f64; 3], yaw_rad: f64, qpos: [f64; 7], noise_rad: f64) -> RobotSpec {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    RobotSpec { base: Isometry3::from_parts(Translation3::from(base), rotation), qpos, noise_rad }
}

/// Pose of the wrist camera in the hand's frame (spec/env.md §4): it looks along the approach direction.
fn hand_camera_pose() -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2));
    Isometry3::from_parts(Translation3::new(0.0465, -0.02, 0.036), rotation)
}

/// Grey ambient light of 0.3 and two white lights, one aslant and one from above, without shadows (spec/perturbations.md §7).
fn default_lights() -> LightsSpec {
    let white =
        |direction| DirectionalSpec { color: [Range::fixed(1.0); 3], direction, turn: Range::fixed(0.0) };
    LightsSpec {
        ambient: [Range::fixed(0.3); 3],
        directional: vec![white([1.0, 1.0, -1.0]), white([0.0, 0.0, -1.0])],
        shadows: false,
    }
}
