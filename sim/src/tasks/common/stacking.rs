//! Stacking of cubes on a goal disc, shared by DualArmStackCube and DualArmStackTwoCubes. See
//! docs/benchmark.md, "Scenes and objects".

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Vector3};

use super::bimanual_plan::{BimanualPlan, pose};
use super::{BIMANUAL_TABLE_Z, ExternalCameras, GOAL_RADIUS, goal_disc};
use crate::expert::grasp;
use crate::predicate::Predicate;
use crate::profile::{Profile, ProfileRules};
use crate::scene::{Body, BodySpec, Range, Scene};

/// Half-extent of a cube, in m.
pub(in crate::tasks) const HALF: f64 = 0.02;

/// External cameras of both tasks.
pub(in crate::tasks) const CAMERAS: ExternalCameras = ExternalCameras {
    external1: [[0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
    external2: [[-0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
};

/// Creates a cube of the tower.
pub(in crate::tasks) fn cube(name: &'static str, color: [f64; 3], region: usize) -> BodySpec {
    let cube = super::cube(name, HALF, color, region, BIMANUAL_TABLE_Z);
    cube.with_yaw(Range::new(0.0, TAU)).with_origin_z(0.85)
}

/// Creates the goal disc, which floats 6 mm above the table.
pub(in crate::tasks) fn goal(region: usize) -> BodySpec {
    goal_disc(region).with_origin_z(0.831)
}

/// Requires one cube to be on another, within 25 mm horizontally and 5 mm vertically.
pub(in crate::tasks) fn on(scene: &Scene, profile: Profile, top: usize, base: usize) -> Predicate {
    let scale = |body: usize| if profile.scales_thresholds() { scene.bodies[body].scale.x } else { 1.0 };
    Predicate::On {
        top,
        base,
        xy_m: 0.025 * scale(base),
        rise_m: HALF * (scale(top) + scale(base)),
        rise_tolerance_m: 0.005,
    }
}

/// Requires a cube to be above the goal, at any height.
pub(in crate::tasks) fn on_goal(cube: usize, goal: usize) -> Predicate {
    Predicate::On { top: cube, base: goal, xy_m: GOAL_RADIUS, rise_m: 0.0, rise_tolerance_m: f64::INFINITY }
}

/// Height of the TCP above the goal disc at which cubes are released, in m. They drop onto the goal or tower.
pub(in crate::tasks) const RELEASE_HEIGHT: f64 = 0.15;
/// World poses at which the arms are out of each other's way.
const PARKED: [([f64; 3], [f64; 4]); 2] = [
    ([-0.4, -0.254, 1.018], [0.138, 0.694, 0.694, -0.138]),
    ([-0.4, 0.254, 1.018], [0.138, -0.694, 0.694, 0.138]),
];
/// Candidate lean angles of the hand, in rad.
const LEANS: [f64; 5] = [0.0, 0.2, 0.4, 0.6, 0.8];

/// TCP poses with which an arm carries a cube to the goal.
pub(in crate::tasks) struct CubeTransfer {
    /// Pre-grasp pose above the cube.
    pub(in crate::tasks) above: Isometry3<f64>,
    /// Grasp pose at the cube.
    pub(in crate::tasks) grasp: Isometry3<f64>,
    /// Pose above the goal at which the cube is released.
    pub(in crate::tasks) release: Isometry3<f64>,
}

impl CubeTransfer {
    /// Plans the transfer of a cube to the goal, with the TCP at `height_m` above it.
    pub(in crate::tasks) fn new(scene: &Scene, arm: usize, cube: &Body, height_m: f64) -> Self {
        let release = scene.body("goal").pose.translation.vector + Vector3::z() * height_m;
        let waypoints = |tcp: &Isometry3<f64>| {
            [grasp::retreated(tcp, 0.1), *tcp, Isometry3::from_parts(release.into(), tcp.rotation)]
        };
        let closing = grasp::start_closing(scene, arm);
        let candidates: Vec<Isometry3<f64>> = [closing, Vector3::z().cross(&closing)]
            .iter()
            .map(|preferred| grasp::top_down(cube, preferred, &closing))
            .flat_map(|tcp| LEANS.map(|lean| grasp::tilted_toward_base(scene, arm, &tcp, lean)))
            .collect();
        let tcp = grasp::first_reachable(scene, arm, &candidates, waypoints);
        let [above, grasp, release] = waypoints(&tcp);
        Self { above, grasp, release }
    }
}

/// Plans to grasp two cubes simultaneously, to drop the first on the goal, and to carry the second above it.
pub(in crate::tasks) fn stack_two(
    scene: &Scene,
    first: &CubeTransfer,
    second: &CubeTransfer,
) -> BimanualPlan {
    BimanualPlan::new(scene)
        .screw([first.above, second.above])
        .screw([first.grasp, second.grasp])
        .close(0, 10)
        .close(1, 10)
        .screw_one(0, first.release)
        .open(0, 10)
        .screw_one(0, parked(0))
        .screw_one(1, second.release)
}

/// Returns the pose at which an arm is out of the other's way.
pub(in crate::tasks) fn parked(arm: usize) -> Isometry3<f64> {
    let (position, orientation) = PARKED[arm];
    pose(position, orientation)
}
