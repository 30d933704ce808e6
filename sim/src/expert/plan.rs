//! From moves to action rows.

use ipc_types::Morphology;
use nalgebra::Isometry3;

use super::timing::{Caps, sample};
use super::{MotionPlanError, Move, TcpGoal};
use crate::physics::CONTROL_HZ;
use crate::robot::ik;
use crate::robot::kinematics::{self, Joints};
use crate::scene::Scene;

/// Longest way of a TCP between two solutions of inverse kinematics on a straight line, in m and rad.
const LINE_STEP: [f64; 2] = [0.005, 0.02];

/// Joint positions of all arms.
#[derive(Clone, Debug)]
pub(super) struct Config(Vec<Joints>);

impl Config {
    /// How far the joint that moves most is from its place in `other`, in rad.
    pub(super) fn distance(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max)
    }

    /// The point at a fraction of the straight way to `other`.
    pub(super) fn towards(&self, other: &Self, part: f64) -> Self {
        Self(self.0.iter().zip(&other.0).map(|(a, b)| a.lerp(b, part)).collect())
    }
}

/// The action rows of all moves, one after another.
pub(super) fn plan(scene: &Scene, moves: &[Move]) -> Result<Vec<f32>, MotionPlanError> {
    let mut planner = Planner {
        scene,
        config: Config(scene.robots.iter().map(|robot| Joints::from(robot.qpos)).collect()),
        grippers: vec![1.0; scene.robots.len()],
        rows: Vec::new(),
    };
    planner.hold(1);
    for (move_idx, step) in moves.iter().enumerate() {
        planner.add(step).map_err(|Unreachable { arm, tcp, part }| MotionPlanError {
            move_idx,
            name: step.name(),
            arm,
            at: tcp.translation.vector.into(),
            percent: part * 100.0,
        })?;
    }
    Ok(planner.rows)
}

struct Unreachable {
    arm: usize,
    tcp: Isometry3<f64>,
    part: f64,
}

struct Planner<'a> {
    scene: &'a Scene,
    config: Config,
    grippers: Vec<f32>,
    rows: Vec<f32>,
}

impl Planner<'_> {
    fn add(&mut self, step: &Move) -> Result<(), Unreachable> {
        match step {
            Move::Straight(reaches) => {
                let path = self.line(vec![self.config.clone()], reaches)?;
                self.follow(&path, self.straight_caps());
            }
            Move::Waypoints(places) => {
                let mut path = vec![self.config.clone()];
                for reaches in places {
                    path = self.line(path, reaches)?;
                }
                self.follow(&path, self.straight_caps());
            }
            Move::Joint(reaches) => {
                let mut goal = self.config.clone();
                for TcpGoal { arm, tcp } in reaches {
                    let target = self.scene.robots[*arm].base.inverse() * tcp;
                    goal.0[*arm] = ik::solve(&target, &self.config.0[*arm]).ok_or(Unreachable {
                        arm: *arm,
                        tcp: *tcp,
                        part: 1.0,
                    })?;
                }
                self.follow(&[self.config.clone(), goal], self.joint_caps());
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

    /// The path with solutions along straight lines from its end, each found from the one before, so that the joints
    /// never jump.
    fn line(&self, mut path: Vec<Config>, reaches: &[TcpGoal]) -> Result<Vec<Config>, Unreachable> {
        let start = &path[path.len() - 1];
        let starts: Vec<Isometry3<f64>> = reaches.iter().map(|reach| self.tcp(start, reach.arm)).collect();
        let n_steps =
            starts.iter().zip(reaches).map(|(start, reach)| line_steps(start, &reach.tcp)).max().unwrap_or(1);
        for step in 1..=n_steps {
            let part = step as f64 / n_steps as f64;
            let mut config = path[path.len() - 1].clone();
            for (start, TcpGoal { arm, tcp }) in starts.iter().zip(reaches) {
                let tcp = between(start, tcp, part);
                let target = self.scene.robots[*arm].base.inverse() * tcp;
                config.0[*arm] =
                    ik::iterate(&target, &config.0[*arm]).ok_or(Unreachable { arm: *arm, tcp, part })?;
            }
            path.push(config);
        }
        Ok(path)
    }

    fn tcp(&self, config: &Config, arm: usize) -> Isometry3<f64> {
        self.scene.robots[arm].base * kinematics::tcp(&config.0[arm])
    }

    fn follow(&mut self, path: &[Config], caps: Caps) {
        for config in sample(path, caps, 1.0 / CONTROL_HZ) {
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

    /// The benchmark plans straight moves of two arms at 0.1 s and executes them at 0.05 s: twice the speed, four times the
    /// acceleration (spec/tasks.md §3).
    fn straight_caps(&self) -> Caps {
        match self.morphology() {
            Morphology::Single => Caps { speed: 0.9, acceleration: 0.9 },
            Morphology::Bimanual => Caps { speed: 1.62, acceleration: 3.24 },
        }
    }

    fn joint_caps(&self) -> Caps {
        match self.morphology() {
            Morphology::Single => Caps { speed: 0.9, acceleration: 0.9 },
            Morphology::Bimanual => Caps { speed: 0.81, acceleration: 0.81 },
        }
    }
}

fn line_steps(from: &Isometry3<f64>, to: &Isometry3<f64>) -> usize {
    let way = (to.translation.vector - from.translation.vector).norm();
    let turn = from.rotation.angle_to(&to.rotation);
    (way / LINE_STEP[0]).max(turn / LINE_STEP[1]).ceil().max(1.0) as usize
}

fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, part: f64) -> Isometry3<f64> {
    let turn = (from.rotation.inverse() * to.rotation).scaled_axis() * part;
    let rotation = from.rotation * nalgebra::UnitQuaternion::from_scaled_axis(turn);
    Isometry3::from_parts(from.translation.vector.lerp(&to.translation.vector, part).into(), rotation)
}
