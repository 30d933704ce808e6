//! What the two tasks share that build a tower of cubes on a goal disc (spec/tasks.md §3, tasks 27 and 28).

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Vector3};

use super::{BIMANUAL_TABLE_Z, ExternalCameras, GOAL_RADIUS};
use crate::expert::{Move, TcpGoal, both_arms, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::profile::ProfileRules;
use crate::scene::{Body, BodySpec, Range, Scene};

/// Half a cube's edge, in m.
pub(in crate::tasks) const HALF: f64 = 0.02;

pub(in crate::tasks) const CAMERAS: ExternalCameras = ExternalCameras {
    external1: [[0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
    external2: [[-0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
};

/// A cube of the tower.
pub(in crate::tasks) fn cube(name: &'static str, color: [f64; 3], region: usize) -> BodySpec {
    super::cube(name, HALF, color, region, BIMANUAL_TABLE_Z).with_yaw(Range::new(0.0, TAU))
}

/// One cube on another within 25 mm and 5 mm.
pub(in crate::tasks) fn on(scene: &Scene, profile: Profile, top: usize, base: usize) -> Predicate {
    let scale = |body: usize| if profile.scales_thresholds() { scene.bodies[body].scale } else { 1.0 };
    Predicate::On {
        top,
        base,
        xy_m: 0.025 * scale(base),
        rise_m: HALF * (scale(top) + scale(base)),
        rise_tolerance_m: 0.005,
    }
}

/// A cube over the goal, at any height.
pub(in crate::tasks) fn on_goal(cube: usize, goal: usize) -> Predicate {
    Predicate::On { top: cube, base: goal, xy_m: GOAL_RADIUS, rise_m: 0.0, rise_tolerance_m: f64::INFINITY }
}

/// How an arm brings a cube to the goal: where its TCP goes.
pub(in crate::tasks) struct Way {
    arm: usize,
    /// On the way down to the cube, around it, raised with it, over the goal, and where it is let go.
    pub(in crate::tasks) above: Isometry3<f64>,
    pub(in crate::tasks) at: Isometry3<f64>,
    raised: Isometry3<f64>,
    over: Isometry3<f64>,
    down: Isometry3<f64>,
}

/// Leans of the hand that are tried, in rad.
const LEANS: [f64; 5] = [0.0, 0.2, 0.4, 0.6, 0.8];
/// How high cubes are carried over what they pass, in m.
const CLEARANCE: f64 = 0.08;
/// How far an arm holds its cube back while the other is at the goal, in m.
const ASIDE: f64 = 0.2;

impl Way {
    /// For a cube whose lower face comes to lie `base_m` above the table.
    pub(in crate::tasks) fn new(scene: &Scene, arm: usize, cube: &Body, base_m: f64) -> Self {
        let to_goal = {
            let rise = Vector3::z() * (base_m + 0.002);
            let offset = scene.body("goal").pose.translation.vector - cube.pose.translation.vector;
            Vector3::new(offset.x, offset.y, 0.0) + rise
        };
        let stations = |tcp: &Isometry3<f64>| {
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
        let tcp = grasp::first_reachable(scene, arm, &candidates, stations);
        let [above, at, raised, over, down] = stations(&tcp);
        Self { arm, above, at, raised, over, down }
    }

    /// The gripped cube raised.
    pub(in crate::tasks) fn raised(&self) -> TcpGoal {
        TcpGoal { arm: self.arm, tcp: self.raised }
    }

    /// The gripped cube out of the other arm's way: raised, and nearer to the arm's own base.
    pub(in crate::tasks) fn aside(&self, scene: &Scene) -> TcpGoal {
        let home = scene.robots[self.arm].base.translation.vector - self.raised.translation.vector;
        let back = Vector3::new(home.x, home.y, 0.0).normalize() * ASIDE;
        TcpGoal { arm: self.arm, tcp: grasp::translated(&self.raised, &back) }
    }

    /// Carries the raised cube over the goal; `leaving` is where the other arm goes meanwhile, if it does.
    pub(in crate::tasks) fn carry(&self, leaving: Option<TcpGoal>) -> Move {
        Move::Straight(leaving.into_iter().chain([TcpGoal { arm: self.arm, tcp: self.over }]).collect())
    }

    /// Lets the cube go on the goal and backs off from it.
    pub(in crate::tasks) fn put(&self) -> [Move; 3] {
        let Self { arm, down, .. } = self;
        [
            Move::straight(*arm, *down),
            Move::open(&[*arm], 6),
            Move::straight(*arm, grasp::retreated(down, CLEARANCE)),
        ]
    }
}

/// Each arm takes a cube at once; then the first arm puts its own on the goal, and the second one its own on that.
pub(in crate::tasks) fn stack_two(scene: &Scene, lower: &Body, upper: &Body) -> Vec<Move> {
    let (first, second) =
        (Way::new(scene, 0, lower, 0.0), Way::new(scene, 1, upper, 2.0 * HALF * lower.scale));
    let to = |tcps| Move::Straight(both_arms(tcps));
    let mut moves = vec![to([first.above, second.above]), to([first.at, second.at]), Move::close(&[0, 1], 6)];
    moves.extend([Move::Straight(vec![first.raised(), second.aside(scene)]), first.carry(None)]);
    moves.extend(first.put());
    moves.push(second.carry(Some(parked(scene, 0))));
    moves.extend(second.put());
    moves
}

/// Where an arm is out of the other's way.
pub(in crate::tasks) fn parked(scene: &Scene, arm: usize) -> TcpGoal {
    TcpGoal { arm, tcp: grasp::start_tcp(scene, arm) }
}
