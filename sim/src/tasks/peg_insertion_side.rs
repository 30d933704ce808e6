//! PegInsertionSide: push a peg into the hole in the side of a box. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_6, FRAC_PI_8};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Translation3, Vector3};

use super::common::objects::hole::Hole;
use super::common::{
    self, DENSITY, ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, box_part, movable, region,
    single_arm, srgb,
};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{AppearanceSpec, BodySpec, Range, RegionSpec, ScaledBy, Scene, SceneSpec, SizesSpec};

pub(crate) const TASK: Task = Task {
    env_id: "PegInsertionSideColosseumV2-v1",
    category: Category::Insertion,
    morphology: Morphology::Single,
    max_steps: 266,
    demo_steps: 151.4,
    instruction: "insert the peg into the hole from the side",
    lerobot_instruction: "Insert the peg from the side",
    paraphrases: include_str!("paraphrases/peg_insertion_side.txt"),
    nominal,
    success,
    expert,
};

/// Sampled dimensions: the peg's half-length and half-width in m, and the hole's y and z from −1 to 1, in
/// units of its maximum distance from the box's centre.
const SIZES: SizesSpec = SizesSpec {
    ranges: &[
        ("half length", Range::new(0.085, 0.125)),
        ("half width", Range::new(0.015, 0.025)),
        ("hole y", Range::symmetric(1.0)),
        ("hole z", Range::symmetric(1.0)),
    ],
    apply: set_sizes,
};
/// Clearance between the peg and the hole on each side, in m.
const CLEARANCE: f64 = 0.006;

fn nominal(profile: Profile) -> SceneSpec {
    let parts = |colors: &[[u8; 3]]| {
        colors.iter().map(|color| box_part([0.0; 3], [0.0; 3], AppearanceSpec::plain(srgb(*color)))).collect()
    };
    let peg = BodySpec {
        scaled_by: ScaledBy::Nothing("its size is sampled for every episode"),
        ..movable("peg", parts(&[[237, 246, 249], [236, 115, 87]]), 0, SINGLE_TABLE_Z)
    };
    let target = common::fixed("box", parts(&[[143, 145, 150]; 4]), 1, SINGLE_TABLE_Z, "it fits the peg");
    let yaws = [Range::new(FRAC_PI_6, 5.0 * FRAC_PI_6), Range::new(3.0 * FRAC_PI_8, 5.0 * FRAC_PI_8)];
    let mut bodies = vec![peg.with_yaw(yaws[0]), target.with_yaw(yaws[1])];
    set_sizes(&[0.105, 0.02, 0.0, 0.0], &mut bodies);
    // In the released code, a long peg may start inside the box.
    let min_gap_m = profile.separates_starts().then_some(0.0);
    let regions = vec![
        region("peg", Range::symmetric(0.1), Range::new(-0.3, 0.0)),
        RegionSpec { min_gap_m, ..region("box", Range::symmetric(0.05), Range::new(0.2, 0.4)) },
    ];
    let centre = [0.0, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[0.35, -0.4, 0.3], centre], external2: [[-0.2, 0.0, 0.3], centre] };
    let scene = single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction);
    SceneSpec { sizes: Some(SIZES), ..scene }
}

/// Sets the sizes of the peg's tail and head and of the box's walls.
fn set_sizes(drawn: &[f64], bodies: &mut [BodySpec]) {
    let &[length, width, y, z] = drawn else { panic!("{} sampled dimensions, expected 4", drawn.len()) };
    let peg = [-1.0, 1.0].map(|end| ([length / 2.0, width, width], [end * length / 2.0, 0.0, 0.0]));
    let centre = [y, z].map(|fraction| fraction * (length - width) / 2.0);
    let walls = Hole::around(centre, [width + CLEARANCE; 2]).walls([length; 3]);
    let parts = bodies.iter_mut().flat_map(|body| &mut body.parts);
    for (part, (half, position)) in parts.zip(peg.into_iter().chain(walls)) {
        *part = box_part(half, position, part.appearance);
    }
}

/// Requires the peg's head to be in the hole, at most 15 mm short of the box's centre.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [body, of] = ["peg", "box"].map(|name| scene.body_idx(name));
    let length = scene.bodies[body].aabb(&Isometry3::identity()).max.x;
    let Hole { min: [y0, z0], max: [y1, z1] } = Hole::of(&scene.bodies[of]);
    let deepest = if profile.bounds_insertion() { length } else { f64::INFINITY };
    let region = Region::Box { min: [-0.015, y0, z0], max: [deepest, y1, z1] };
    vec![Predicate::Inside { body, point: [length, 0.0, 0.0], of: Some(of), region }]
}

/// Maximum distance beyond the box's middle to which the head is pushed, in m.
const INSERTION_DEPTH: f64 = 0.05;
/// Minimum distance of the hand from the box, in m.
const HAND_GAP: f64 = 0.015;
/// Number of moves that correct the peg's position in front of the hole.
const N_CORRECTIONS: usize = 3;
/// Sag of the arm under a payload, in m/kg: its position drives act as springs, and a plan cannot measure and
/// correct the error.
const SAG_PER_KG: f64 = 0.0095;
/// Candidate lean angles of the hand, in rad: tails far from the robot are out of reach from straight above.
const LEANS: [f64; 3] = [0.0, 0.2, 0.4];

fn expert(scene: &Scene) -> Vec<Move> {
    let (peg, target) = (scene.body("peg"), scene.body("box"));
    let half = peg.aabb(&Isometry3::identity()).max;
    let (length, mass) = (half.x, DENSITY * 8.0 * half.product());
    let [y, z] = Hole::of(target).centre();
    let closing = grasp::start_closing(scene, 0);
    let tail = f64::max(0.05, length / 2.0 + 0.01);
    let to_tail = peg.pose.rotation * -Vector3::x() * tail;
    let upright = grasp::translated(&grasp::top_down(peg, &closing, &closing), &to_tail);
    let peg_at = |x: f64| target.pose * Translation3::new(x, y, z + SAG_PER_KG * mass);
    let before_hole = peg_at(-0.01 - length - length);
    let plans = LEANS.map(|lean| {
        let tcp = grasp::tilted_toward_base(scene, 0, &upright, lean);
        let mut moves = vec![
            Move::Limit { per_joint: 0.75 },
            Move::straight(0, grasp::retreated(&tcp, 0.05)),
            Move::straight(0, tcp),
            Move::close(&[0], 6),
        ];
        moves.push(Move::straight(0, before_hole * peg.pose.inverse() * tcp));
        moves.extend(vec![Move::Correct { from: peg.pose, to: before_hole }; N_CORRECTIONS]);
        let inserted = peg_at(INSERTION_DEPTH.min(tail - HAND_GAP) - length);
        moves.push(Move::Carry { from: peg.pose, to: inserted });
        moves
    });
    first_feasible(scene, TASK.max_steps, plans.into_iter())
}
