//! Recipes of distractor objects. `kinds/README.md` documents their format.

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
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct File {
    pub(crate) vivid: Vec<Paint>,
    pub(crate) profiles: BTreeMap<String, Vec<[f64; 2]>>,
    pub(crate) groups: BTreeMap<String, Vec<RecipeStep>>,
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
    pub(crate) steps: Vec<RecipeStep>,
}

fn default_friction() -> f64 {
    0.5
}

/// One step of a recipe.
#[derive(Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum RecipeStep {
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
        one_of: Vec<Vec<RecipeStep>>,
    },
    Chance {
        chance: f64,
        then: Vec<RecipeStep>,
        #[serde(default)]
        r#else: Vec<RecipeStep>,
    },
    Use {
        r#use: StepGroup,
        #[serde(default)]
        at: [f64; 3],
        turn: Option<Rotation>,
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
pub(crate) enum StepGroup {
    Named(String),
    Steps(Vec<RecipeStep>),
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
    turn: OneOrMany<Rotation>,
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
pub(crate) enum Rotation {
    Named(NamedRotation),
    Quaternion(Quat),
    /// Turns the z axis to a unit vector.
    Towards([f64; 3]),
}

/// A rotation that has a name.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum NamedRotation {
    None,
    ZToX,
    ZToY,
    YToZ,
    XToYToZ,
}

impl Rotation {
    pub(crate) fn quat(&self) -> Quat {
        match *self {
            Self::Named(NamedRotation::None) => IDENTITY,
            Self::Named(NamedRotation::ZToX) => Z_TO_X,
            Self::Named(NamedRotation::ZToY) => [1.0, -1.0, 0.0, 0.0],
            Self::Named(NamedRotation::YToZ) => [1.0, 1.0, 0.0, 0.0],
            Self::Named(NamedRotation::XToYToZ) => [1.0, 1.0, 1.0, 1.0],
            Self::Quaternion(quat) => quat,
            Self::Towards(axis) => z_axis_to(axis),
        }
    }
}

impl Default for Rotation {
    fn default() -> Self {
        Self::Named(NamedRotation::None)
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
