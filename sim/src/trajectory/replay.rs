//! Stepping a world through the actions of a trajectory.

use std::collections::BTreeMap;

use serde::Serialize;

use super::file::{ArmFile, BodyFile};
use super::start::{Start, pose_to_array};
use crate::physics::{Parameters, World, WorldState};
use crate::predicate::{Predicate, first_unmet};

/// A world that executes actions from a start state.
pub struct Replay<'a> {
    start: &'a Start,
    world: World,
    success: Vec<Predicate>,
}

/// The state after one step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Step {
    /// State of each arm.
    pub arms: Vec<ArmStep>,
    /// State of each body, by name.
    pub bodies: BTreeMap<&'static str, BodyFile>,
    /// Name of the first success predicate that does not hold; `None` if the task has succeeded.
    pub unmet: Option<&'static str>,
}

/// The state of one arm after one step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ArmStep {
    /// Joint positions and velocities.
    #[serde(flatten)]
    pub joints: ArmFile,
    /// World position (m) and orientation (w, x, y, z) of the TCP.
    pub tcp: [f64; 7],
    /// Names of the bodies that the arm grasps.
    pub grasps: Vec<&'static str>,
}

impl<'a> Replay<'a> {
    /// Builds the world in the start state.
    #[must_use]
    pub fn new(start: &'a Start, parameters: &Parameters) -> Self {
        let success = (start.task.task().success)(&start.scene, start.profile);
        Self { start, world: start.world(parameters), success }
    }

    /// Returns the world.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Executes one action row, `[action_dim]` f32.
    ///
    /// # Panics
    /// If the row has another length.
    pub fn step(&mut self, row: &[f32]) {
        self.world.step(row);
    }

    /// Returns the first success predicate that does not hold.
    #[must_use]
    pub fn unmet(&self) -> Option<Predicate> {
        first_unmet(&self.success, &self.world)
    }

    /// Returns the current state.
    #[must_use]
    pub fn record(&self) -> Step {
        let WorldState { arms, bodies } = self.world.state();
        let names = || self.start.scene.bodies.iter().map(|body| body.name);
        let arm = |(arm, state)| ArmStep {
            joints: ArmFile::of(state),
            tcp: pose_to_array(&self.world.tcp_pose(arm)),
            grasps: names()
                .enumerate()
                .filter(|(i, _)| self.world.is_grasping(arm, *i))
                .map(|it| it.1)
                .collect(),
        };
        Step {
            arms: arms.iter().enumerate().map(arm).collect(),
            bodies: names().zip(bodies.iter().map(BodyFile::of)).collect(),
            unmet: self.unmet().map(Predicate::name),
        }
    }
}
