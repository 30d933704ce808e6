//! Recipes of distractor objects, as the files under `kinds/` contain them; `mod.rs` documents their format.

use core::slice::from_ref;
use std::collections::BTreeMap;

use nalgebra::Isometry3;
use serde::Deserialize;

use super::builder::{IDENTITY, Quat, Z_TO_X, pose, z_axis_to};
use super::outline::{Steps, arc};
use super::paint::Paint;
use super::shape::Shape;
use super::surface::Surface;

/// One file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
#[derive(Default)]
pub(crate) struct File {
    pub(crate) vivid: Vec<Paint>,
    pub(crate) profiles: BTreeMap<String, Vec<[f64; 2]>>,
    pub(crate) groups: BTreeMap<String, Vec<Step>>,
    pub(crate) kind: Vec<Recipe>,
}

/// Steps that sample an object, and its physical properties.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Recipe {
    pub(crate) name: String,
    pub(crate) density: f64,
    #[serde(default = "default_friction")]
    pub(crate) friction: f64,
    #[serde(default)]
    pub(crate) rolls: bool,
    pub(crate) steps: Vec<Step>,
}

fn default_friction() -> f64 {
    0.5
}

/// One step of a recipe.
#[derive(Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum Step {
    Vivid {
        vivid: Vec<String>,
    },
    Let {
        r#let: String,
        of: Vec<Paint>,
        #[serde(default)]
        vary: bool,
        #[serde(default = "ones")]
        times: [f64; 3],
    },
    OneOf {
        one_of: Vec<Vec<Step>>,
    },
    Chance {
        chance: f64,
        then: Vec<Step>,
        #[serde(default)]
        r#else: Vec<Step>,
    },
    Use {
        r#use: Group,
        #[serde(default)]
        at: [f64; 3],
        turn: Option<Turn>,
        surface: Option<Surface>,
    },
    Shape(ShapeStep),
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

/// Steps given by the name of a group or in place.
#[derive(Deserialize)]
#[serde(untagged)]
pub(crate) enum Group {
    Named(String),
    Steps(Vec<Step>),
}

/// A shape with its places.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ShapeStep {
    #[serde(flatten)]
    pub(crate) shape: Shape,
    #[serde(default)]
    at: OneOrMany<[f64; 3]>,
    #[serde(default)]
    turn: OneOrMany<Turn>,
    ring: Option<Ring>,
    pub(crate) paint: Option<OneOrMany<Paint>>,
    #[serde(default)]
    pub(crate) solid: bool,
}

impl ShapeStep {
    /// Returns the poses of all copies.
    pub(crate) fn poses(&self) -> Vec<Isometry3<f64>> {
        if let Some(ring) = &self.ring {
            return ring.poses().collect();
        }
        let turns = self.turn.as_slice();
        self.at.as_slice().iter().flat_map(|at| turns.iter().map(|turn| pose(*at, turn.quat()))).collect()
    }
}

/// Copies on the circle of a sphere at a fraction `height` of its radius, their z axes pointing outwards.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Ring {
    radius: f64,
    height: f64,
    steps: Steps,
}

impl Ring {
    fn poses(&self) -> impl Iterator<Item = Isometry3<f64>> {
        let points = arc((1.0 - self.height * self.height).sqrt(), self.steps);
        points.map(|[x, y]| {
            let outwards = [x, y, self.height];
            pose(outwards.map(|x| x * self.radius), z_axis_to(outwards))
        })
    }
}

/// A rotation.
#[derive(Deserialize)]
#[serde(untagged)]
pub(crate) enum Turn {
    Named(TurnName),
    Quaternion(Quat),
    /// Turns the z axis to a unit vector.
    Towards([f64; 3]),
}

/// A rotation that has a name.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum TurnName {
    None,
    ZToX,
    ZToY,
    YToZ,
    XToYToZ,
}

impl Turn {
    pub(crate) fn quat(&self) -> Quat {
        match *self {
            Self::Named(TurnName::None) => IDENTITY,
            Self::Named(TurnName::ZToX) => Z_TO_X,
            Self::Named(TurnName::ZToY) => [1.0, -1.0, 0.0, 0.0],
            Self::Named(TurnName::YToZ) => [1.0, 1.0, 0.0, 0.0],
            Self::Named(TurnName::XToYToZ) => [1.0, 1.0, 1.0, 1.0],
            Self::Quaternion(quat) => quat,
            Self::Towards(axis) => z_axis_to(axis),
        }
    }
}

impl Default for Turn {
    fn default() -> Self {
        Self::Named(TurnName::None)
    }
}

/// One value or a list.
#[derive(Deserialize)]
#[serde(untagged)]
pub(crate) enum OneOrMany<T> {
    One(T),
    Many(Vec<T>),
}

impl<T> OneOrMany<T> {
    pub(crate) fn as_slice(&self) -> &[T] {
        match self {
            Self::One(one) => from_ref(one),
            Self::Many(many) => many,
        }
    }
}

impl<T: Default> Default for OneOrMany<T> {
    fn default() -> Self {
        Self::One(T::default())
    }
}
