//! Stacking of cubes on a goal disc, shared by DualArmStackCube and DualArmStackTwoCubes. See
//! docs/benchmark.md, "Scenes and objects".

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Vector3};

use super::{BIMANUAL_TABLE_Z, ExternalCameras, GOAL_RADIUS, goal_disc};
use crate::expert::{Move, TcpGoal, both_arms, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use scene::{Body, BodySpec, Range, Scene};

/// Half-extent of a cube, in m.
pub(crate) const HALF: f64 = 0.02;

/// External cameras of both tasks.
pub(crate) const CAMERAS: ExternalCameras = ExternalCameras {
    external1: [[0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
    external2: [[-0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
};

/// Creates a cube of the tower.
pub(crate) fn cube(name: &'static str, color: [f64; 3], region: usize) -> BodySpec {
    let cube = super::cube(name, HALF, color, region, BIMANUAL_TABLE_Z);
    cube.with_yaw(Range::new(0.0, TAU)).with_origin_z(0.85)
}

/// Creates the goal disc, which floats 6 mm above the table.
pub(crate) fn goal(region: usize) -> BodySpec {
    goal_disc(region).with_origin_z(0.831)
}

/// Requires one cube to be on another, within 25 mm horizontally and 5 mm vertically.
pub(crate) fn on(scene: &Scene, profile: Profile, top: usize, base: usize) -> Predicate {
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
pub(crate) fn on_goal(cube: usize, goal: usize) -> Predicate {
    Predicate::On { top: cube, base: goal, xy_m: GOAL_RADIUS, rise_m: 0.0, rise_tolerance_m: f64::INFINITY }
}

/// TCP waypoints with which an arm carries a cube to the goal.
pub(crate) struct CubeTransfer {
    arm: usize,
    /// Pre-grasp pose above the cube.
    pub(crate) above: Isometry3<f64>,
    /// Grasp pose at the cube.
    pub(crate) grasp: Isometry3<f64>,
    /// Pose above the grasp pose with the cube.
    raised: Isometry3<f64>,
    /// Pose above the goal.
    over_goal: Isometry3<f64>,
    /// Pose at which the cube is released.
    release: Isometry3<f64>,
}

/// Candidate lean angles of the hand, in rad.
const LEANS: [f64; 5] = [0.0, 0.2, 0.4, 0.6, 0.8];
/// Clearance at which a cube is carried over other objects, in m.
const CLEARANCE: f64 = 0.06;
/// Distance by which an arm holds its cube back while the other arm is at the goal, in m.
const HOLD_BACK: f64 = 0.1;

impl CubeTransfer {
    /// Plans the transfer of a cube to a position where its lower face is `base_m` above the table.
    pub(crate) fn new(scene: &Scene, arm: usize, cube: &Body, base_m: f64) -> Self {
        let to_goal = {
            let rise = Vector3::z() * (base_m + 0.002);
            let offset = scene.body("goal").pose.translation.vector - cube.pose.translation.vector;
            Vector3::new(offset.x, offset.y, 0.0) + rise
        };
        let waypoints = |tcp: &Isometry3<f64>| {
            let up = Vector3::z() * CLEARANCE;
            let down = grasp::translated(tcp, &to_goal);
            let raised = grasp::translated(tcp, &(up + Vector3::z() * base_m));
            [grasp::retreated(tcp, 0.1), *tcp, raised, grasp::translated(&down, &up), down]
        };
        let closing = grasp::start_closing(scene, arm);
        let candidates: Vec<Isometry3<f64>> = [closing, Vector3::z().cross(&closing)]
            .iter()
            .map(|preferred| grasp::top_down(cube, preferred, &closing))
            .flat_map(|tcp| LEANS.map(|lean| grasp::tilted_toward_base(scene, arm, &tcp, lean)))
            .collect();
        let tcp = grasp::first_reachable(scene, arm, &candidates, waypoints);
        let [above, grasp, raised, over_goal, release] = waypoints(&tcp);
        Self { arm, above, grasp, raised, over_goal, release }
    }

    /// Returns the target that raises the grasped cube.
    pub(crate) fn raised(&self) -> TcpGoal {
        TcpGoal { arm: self.arm, tcp: self.raised }
    }

    /// Returns the target that holds the grasped cube out of the other arm's way: raised, and nearer to the
    /// arm's own base.
    pub(crate) fn held_back(&self, scene: &Scene) -> TcpGoal {
        let home = scene.robots[self.arm].base.translation.vector - self.raised.translation.vector;
        let back = Vector3::new(home.x, home.y, 0.0).normalize() * HOLD_BACK;
        TcpGoal { arm: self.arm, tcp: grasp::translated(&self.raised, &back) }
    }

    /// Plans to carry the raised cube above the goal. `leaving` is the simultaneous target of the other arm,
    /// if any.
    pub(crate) fn carry(&self, leaving: Option<TcpGoal>) -> Move {
        Move::Straight(leaving.into_iter().chain([TcpGoal { arm: self.arm, tcp: self.over_goal }]).collect())
    }

    /// Plans to release the cube on the goal.
    pub(crate) fn place(&self) -> [Move; 2] {
        [Move::straight(self.arm, self.release), Move::open(&[self.arm], 6)]
    }

    /// Plans to retreat from the released cube.
    pub(crate) fn retreat(&self) -> Move {
        Move::straight(self.arm, grasp::retreated(&self.release, CLEARANCE))
    }
}

/// Plans the stacking of two cubes: both arms grasp their cubes simultaneously; then the first arm places its
/// cube on the goal and the second arm places its own on top. Returns the moves and the second transfer.
pub(crate) fn stack_two(scene: &Scene, lower: &Body, upper: &Body) -> (Vec<Move>, CubeTransfer) {
    let (first, second) = (
        CubeTransfer::new(scene, 0, lower, 0.0),
        CubeTransfer::new(scene, 1, upper, 2.0 * HALF * lower.scale.x),
    );
    let to = |tcps| Move::Straight(both_arms(tcps));
    let mut moves =
        vec![to([first.above, second.above]), to([first.grasp, second.grasp]), Move::close(&[0, 1], 6)];
    moves.extend([Move::Straight(vec![first.raised(), second.held_back(scene)]), first.carry(None)]);
    moves.extend(first.place());
    moves.extend([first.retreat(), second.carry(Some(parked(scene, 0)))]);
    moves.extend(second.place());
    (moves, second)
}

/// Returns the target at which an arm is out of the other's way: its initial TCP pose.
pub(crate) fn parked(scene: &Scene, arm: usize) -> TcpGoal {
    TcpGoal { arm, tcp: grasp::start_tcp(scene, arm) }
}
