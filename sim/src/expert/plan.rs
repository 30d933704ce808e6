//! The motion planner, which converts moves into action rows.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::moves::{CONTROL_MODE, MotionPlanError, Move, TcpGoal};
use super::screw;
use super::spline::Spline;
use super::timing::{Configuration, MotionLimits, time_parametrise};
use super::topp::time_optimal;
use crate::physics::CONTROL_HZ;
use crate::robot::control::{Drive, arm_drive};
use crate::robot::dynamics::{self, Dynamics, LinkInertias};
use crate::robot::ik;
use scene::Scene;
use scene::robot::kinematics::{self, Joints};

/// Maximum TCP displacement between two inverse-kinematics solutions on a straight line, in m and rad.
const MAX_LINE_STEP: [f64; 2] = [0.005, 0.02];

/// Plans all moves and returns their action rows, `[n_steps, 8 · n_arms]` f32.
pub(crate) fn plan(scene: &Scene, moves: &[Move]) -> Result<Vec<f32>, MotionPlanError> {
    let config = Configuration(scene.robots.iter().map(|robot| Joints::from(robot.qpos)).collect());
    let arm = (config.0.len() == 1).then(|| FreeArm::at(config.0[0], scene.physics_hz));
    let start = scene.robots[0].base * kinematics::tcp(&config.0[0]);
    let mut planner = Planner {
        scene,
        gripped: start,
        goal: start,
        limits: if arm.is_some() { [SINGLE_LIMITS; 2] } else { BIMANUAL_LIMITS },
        arm,
        config,
        grippers: vec![1.0; scene.robots.len()],
        rows: Vec::new(),
    };
    if planner.arm.is_none() {
        planner.hold(1);
    }
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

/// Limits of the motions of a single arm.
const SINGLE_LIMITS: MotionLimits = MotionLimits { speed: 0.9, acceleration: 0.9 };
/// Limits of straight and joint-space motions of two arms. The benchmark plans the former with a time step of
/// 0.1 s and executes them with 0.05 s, which doubles the speed and quadruples the acceleration.
const BIMANUAL_LIMITS: [MotionLimits; 2] =
    [MotionLimits { speed: 1.62, acceleration: 3.24 }, MotionLimits { speed: 0.81, acceleration: 0.81 }];

/// Motion of an arm that touches nothing, from which the planner knows where each of its moves starts: the
/// original plans from the measured joint positions, which lag behind their targets.
struct FreeArm {
    physics_hz: u32,
    inertias: LinkInertias,
    drive: Drive,
    q: Joints,
    v: Joints,
}

impl FreeArm {
    fn at(q: Joints, physics_hz: u32) -> Self {
        Self {
            physics_hz,
            inertias: LinkInertias::default(),
            drive: arm_drive(CONTROL_MODE),
            q,
            v: Joints::zeros(),
        }
    }

    /// Advances by one control step towards the targets.
    fn step(&mut self, targets: &Joints) {
        let Dynamics { inertia, bias } = self.inertias.at(&kinematics::links(&self.q), &self.v);
        let inverse = inertia.cholesky().expect("an inertia matrix is positive definite").inverse();
        for _ in 0..self.physics_hz / CONTROL_HZ as u32 {
            let dt = 1.0 / f64::from(self.physics_hz);
            let path = dynamics::advance(&self.q, &mut self.v, targets, self.drive, &inverse, &bias, dt);
            self.q = path[path.len() - 1];
        }
    }
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
    /// Prediction of a single arm's motion.
    arm: Option<FreeArm>,
    config: Configuration,
    /// Limits of straight and joint-space motions.
    limits: [MotionLimits; 2],
    /// TCP pose of the first arm after its gripper has moved.
    gripped: Isometry3<f64>,
    /// Goal of a single arm's last screw motion.
    goal: Isometry3<f64>,
    grippers: Vec<f32>,
    rows: Vec<f32>,
}

impl Planner<'_> {
    fn add(&mut self, mv: &Move) -> Result<(), Unreachable> {
        if let Some(arm) = &self.arm {
            self.config.0[0] = arm.q;
        }
        match mv {
            Move::Limit { per_joint } => {
                self.limits = [MotionLimits { speed: *per_joint, acceleration: *per_joint }; 2];
            }
            Move::Straight(goals) => match (&self.arm, goals.as_slice()) {
                (Some(_), [goal]) => self.screw(&goal.tcp)?,
                _ => self.follow_line(core::slice::from_ref(goals))?,
            },
            Move::Carry { from, to } => self.screw(&(to * self.held(from).inverse() * self.gripped))?,
            Move::Correct { from, to } => {
                let body = self.tcp(&self.config, 0) * self.gripped.inverse() * self.held(from);
                self.screw(&(to * body.inverse() * self.goal))?;
            }
            Move::Shift { by } => {
                let tcp = self.tcp(&self.config, 0);
                self.screw(&(Translation3::from(*by) * tcp))?;
            }
            Move::Waypoints(waypoints) => self.follow_line(waypoints)?,
            Move::Joint(goals) => {
                let mut goal = self.config.clone();
                for TcpGoal { arm, tcp } in goals {
                    let target = self.scene.robots[*arm].base.inverse() * tcp;
                    let from = &self.config.0[*arm];
                    // Like the original's, a single arm's solution comes from the current positions if
                    // possible.
                    let near = self.arm.as_ref().and_then(|_| ik::iterate(&target, from));
                    goal.0[*arm] = near.or_else(|| ik::solve(&target, from)).ok_or(Unreachable {
                        arm: *arm,
                        tcp: *tcp,
                        t: 1.0,
                    })?;
                }
                self.follow(&[self.config.clone(), goal], self.limits[1])?;
            }
            Move::Grip { arms, command, steps } => {
                for arm in arms {
                    self.grippers[*arm] = *command;
                }
                self.hold(*steps);
                let end = self.arm.as_ref().map_or(self.config.0[0], |arm| arm.q);
                self.gripped = self.scene.robots[0].base * kinematics::tcp(&end);
            }
            Move::Hold { steps } => self.hold(*steps),
        }
        Ok(())
    }

    /// Moves a single arm along a screw, or along a straight line if the screw is out of reach.
    fn screw(&mut self, tcp: &Isometry3<f64>) -> Result<(), Unreachable> {
        self.goal = *tcp;
        let target = self.scene.robots[0].base.inverse() * tcp;
        match screw::path(&target, &self.config.0[0]) {
            Some(path) => {
                let path: Vec<_> = path.into_iter().map(|joints| Configuration(vec![joints])).collect();
                self.follow(&path, self.limits[0])
            }
            None => self.follow_line(&[vec![TcpGoal { arm: 0, tcp: *tcp }]]),
        }
    }

    /// Returns the pose of a body, `from` before it was gripped, after the fingers have closed on its middle.
    fn held(&self, from: &Isometry3<f64>) -> Isometry3<f64> {
        let closing = self.gripped.rotation * Vector3::y();
        let offset = closing.dot(&(from.translation.vector - self.gripped.translation.vector));
        Translation3::from(closing * -offset) * from
    }

    fn follow_line(&mut self, waypoints: &[Vec<TcpGoal>]) -> Result<(), Unreachable> {
        let mut path = vec![self.config.clone()];
        for goals in waypoints {
            path = self.line(path, goals)?;
        }
        self.follow(&path, self.limits[0])
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

    fn follow(&mut self, path: &[Configuration], limits: MotionLimits) -> Result<(), Unreachable> {
        let dt = 1.0 / CONTROL_HZ;
        let samples = if self.arm.is_some() {
            let spline = Spline::through(path.iter().map(|config| config.0[0]).collect());
            let end = &path[path.len() - 1];
            let unreachable = || Unreachable { arm: 0, tcp: self.tcp(end, 0), t: 1.0 };
            let samples = time_optimal(&spline, limits, dt).ok_or_else(unreachable)?;
            samples.into_iter().map(|joints| Configuration(vec![joints])).collect()
        } else {
            time_parametrise(path, limits, dt)
        };
        for config in samples {
            self.config = config;
            self.push_row();
        }
        Ok(())
    }

    fn hold(&mut self, steps: u32) {
        for _ in 0..steps {
            self.push_row();
        }
    }

    fn push_row(&mut self) {
        if let Some(arm) = &mut self.arm {
            arm.step(&self.config.0[0]);
        }
        for (joints, gripper) in self.config.0.iter().zip(&self.grippers) {
            self.rows.extend(joints.iter().map(|q| *q as f32));
            self.rows.push(*gripper);
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
