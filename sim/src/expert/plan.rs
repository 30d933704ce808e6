//! The motion planner, which converts moves into action rows.

use ipc_types::Morphology;
use nalgebra::Isometry3;

use super::timing::{MotionLimits, time_parametrise};
use super::{MotionPlanError, Move, TcpGoal};
use crate::physics::CONTROL_HZ;
use crate::robot::ik;
use crate::robot::kinematics::{self, Joints};
use crate::scene::Scene;

/// Maximum TCP displacement between two inverse-kinematics solutions on a straight line, in m and rad.
const MAX_LINE_STEP: [f64; 2] = [0.005, 0.02];

/// A robot configuration: the joint positions of all arms, in rad.
#[derive(Clone, Debug)]
pub(super) struct Configuration(Vec<Joints>);

impl Configuration {
    /// Returns the maximum difference of any joint to `other`, in rad.
    pub(super) fn distance(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max)
    }

    /// Interpolates linearly in joint space: `t` = 0 is `self`, 1 is `other`.
    pub(super) fn lerp(&self, other: &Self, t: f64) -> Self {
        Self(self.0.iter().zip(&other.0).map(|(a, b)| a.lerp(b, t)).collect())
    }
}

/// Plans all moves and returns their action rows, `[n_steps, 8 · n_arms]` f32.
pub(super) fn plan(scene: &Scene, moves: &[Move]) -> Result<Vec<f32>, MotionPlanError> {
    let mut planner = Planner {
        scene,
        config: Configuration(scene.robots.iter().map(|robot| Joints::from(robot.qpos)).collect()),
        grippers: vec![1.0; scene.robots.len()],
        rows: Vec::new(),
    };
    planner.hold(1);
    for (move_idx, mv) in moves.iter().enumerate() {
        planner.add(mv).map_err(|Unreachable { arm, tcp, t }| MotionPlanError {
            move_idx,
            name: mv.name(),
            arm,
            at: tcp.translation.vector.into(),
            percent: t * 100.0,
        })?;
    }
    Ok(planner.rows)
}

/// A pose without a joint-space solution.
struct Unreachable {
    arm: usize,
    tcp: Isometry3<f64>,
    t: f64,
}

/// State of the planner: the configuration and gripper commands after the rows planned so far.
struct Planner<'a> {
    scene: &'a Scene,
    config: Configuration,
    grippers: Vec<f32>,
    rows: Vec<f32>,
}

impl Planner<'_> {
    fn add(&mut self, mv: &Move) -> Result<(), Unreachable> {
        match mv {
            Move::Straight(goals) => {
                let path = self.line(vec![self.config.clone()], goals)?;
                self.follow(&path, self.straight_limits());
            }
            Move::Waypoints(waypoints) => {
                let mut path = vec![self.config.clone()];
                for goals in waypoints {
                    path = self.line(path, goals)?;
                }
                self.follow(&path, self.straight_limits());
            }
            Move::Joint(goals) => {
                let mut goal = self.config.clone();
                for TcpGoal { arm, tcp } in goals {
                    let target = self.scene.robots[*arm].base.inverse() * tcp;
                    goal.0[*arm] = ik::solve(&target, &self.config.0[*arm]).ok_or(Unreachable {
                        arm: *arm,
                        tcp: *tcp,
                        t: 1.0,
                    })?;
                }
                self.follow(&[self.config.clone(), goal], self.joint_limits());
            }
            Move::Grip { arms, command, steps } => {
                for arm in arms {
                    self.grippers[*arm] = *command;
                }
                self.hold(*steps);
            }
            Move::Hold { steps } => self.hold(*steps),
        }
        Ok(())
    }

    /// Extends a path by configurations along straight TCP lines from its end. Each solution starts from the
    /// previous one, so that the joints move continuously.
    fn line(
        &self,
        mut path: Vec<Configuration>,
        goals: &[TcpGoal],
    ) -> Result<Vec<Configuration>, Unreachable> {
        let start = &path[path.len() - 1];
        let starts: Vec<Isometry3<f64>> = goals.iter().map(|goal| self.tcp(start, goal.arm)).collect();
        let n_steps =
            starts.iter().zip(goals).map(|(start, goal)| line_steps(start, &goal.tcp)).max().unwrap_or(1);
        for step in 1..=n_steps {
            let t = step as f64 / n_steps as f64;
            let mut config = path[path.len() - 1].clone();
            for (start, TcpGoal { arm, tcp }) in starts.iter().zip(goals) {
                let tcp = interpolate(start, tcp, t);
                let target = self.scene.robots[*arm].base.inverse() * tcp;
                config.0[*arm] =
                    ik::iterate(&target, &config.0[*arm]).ok_or(Unreachable { arm: *arm, tcp, t })?;
            }
            path.push(config);
        }
        Ok(path)
    }

    fn tcp(&self, config: &Configuration, arm: usize) -> Isometry3<f64> {
        self.scene.robots[arm].base * kinematics::tcp(&config.0[arm])
    }

    fn follow(&mut self, path: &[Configuration], limits: MotionLimits) {
        for config in time_parametrise(path, limits, 1.0 / CONTROL_HZ) {
            self.config = config;
            self.push_row();
        }
    }

    fn hold(&mut self, steps: u32) {
        for _ in 0..steps {
            self.push_row();
        }
    }

    fn push_row(&mut self) {
        for (joints, gripper) in self.config.0.iter().zip(&self.grippers) {
            self.rows.extend(joints.iter().map(|q| *q as f32));
            self.rows.push(*gripper);
        }
    }

    fn morphology(&self) -> Morphology {
        if self.scene.robots.len() == 1 { Morphology::Single } else { Morphology::Bimanual }
    }

    /// Returns the limits for straight moves. The benchmark plans those of two arms with a time step of 0.1 s
    /// and executes them with
    /// 0.05 s, which doubles the speed and quadruples the acceleration.
    fn straight_limits(&self) -> MotionLimits {
        match self.morphology() {
            Morphology::Single => MotionLimits { speed: 0.9, acceleration: 0.9 },
            Morphology::Bimanual => MotionLimits { speed: 1.62, acceleration: 3.24 },
        }
    }

    fn joint_limits(&self) -> MotionLimits {
        match self.morphology() {
            Morphology::Single => MotionLimits { speed: 0.9, acceleration: 0.9 },
            Morphology::Bimanual => MotionLimits { speed: 0.81, acceleration: 0.81 },
        }
    }
}

/// Returns the number of interpolation steps on a straight line between two TCP poses.
fn line_steps(from: &Isometry3<f64>, to: &Isometry3<f64>) -> usize {
    let distance = (to.translation.vector - from.translation.vector).norm();
    let turn = from.rotation.angle_to(&to.rotation);
    (distance / MAX_LINE_STEP[0]).max(turn / MAX_LINE_STEP[1]).ceil().max(1.0) as usize
}

/// Interpolates between two poses: position linearly, rotation at constant angular velocity.
fn interpolate(from: &Isometry3<f64>, to: &Isometry3<f64>, t: f64) -> Isometry3<f64> {
    let turn = (from.rotation.inverse() * to.rotation).scaled_axis() * t;
    let rotation = from.rotation * nalgebra::UnitQuaternion::from_scaled_axis(turn);
    Isometry3::from_parts(from.translation.vector.lerp(&to.translation.vector, t).into(), rotation)
}
