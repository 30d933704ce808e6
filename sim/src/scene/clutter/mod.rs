//! Things of every day that may stand about on a table and that no task mentions. Each kind is one function that draws a
//! thing from a stream: its size, its colours and what is printed on it; one file holds the kinds of a theme. Nothing
//! here knows where a thing is put.

mod balls;
mod banana;
mod bottles;
mod cans;
mod cartons;
mod cutlery;
mod fruit;
mod kitchenware;
mod model;
mod paint;
#[cfg(test)]
mod tests;
mod tools;
mod toys;

pub(crate) use fruit::APPLE;

use crate::scene::{PartSpec, VisualSpec};
use crate::stream::Stream;

/// What a distractor is made of, as it rests on z 0 around the z axis of its own frame.
pub(crate) struct Thing {
    /// Solids that collide; drawn if there are no visuals.
    pub(crate) parts: Vec<PartSpec>,
    /// Forms drawn instead of the parts.
    pub(crate) visuals: Vec<VisualSpec>,
    /// kg/m³.
    pub(crate) density: f64,
    /// Coefficient, static and dynamic.
    pub(crate) friction: f64,
    /// Share of linear and angular speed lost per second, 1/s.
    pub(crate) damping: [f64; 2],
}

/// A kind of thing.
pub(crate) struct Kind {
    /// What it is called.
    pub(crate) name: &'static str,
    /// Draws one of its kind: the same from equal streams.
    pub(crate) make: fn(&mut Stream) -> Thing,
}

const fn kind(name: &'static str, make: fn(&mut Stream) -> Thing) -> Kind {
    Kind { name, make }
}

impl Kind {
    /// All of them.
    pub(crate) const ALL: &[Self] = &[
        kind("soup can", cans::soup),
        kind("tuna can", cans::tuna),
        kind("coffee can", cans::coffee),
        kind("crisps tube", cans::crisps),
        kind("potted-meat can", cans::potted_meat),
        kind("cracker box", cartons::crackers),
        kind("sugar box", cartons::sugar),
        kind("pudding box", cartons::pudding),
        kind("gelatine box", cartons::gelatine),
        kind("mustard bottle", bottles::mustard),
        kind("cleanser bottle", bottles::cleanser),
        kind("spray bottle", bottles::sprayer),
        kind("pitcher", bottles::pitcher),
        kind("apple", fruit::apple),
        kind("pear", fruit::pear),
        kind("orange", fruit::orange),
        kind("peach", fruit::peach),
        kind("plum", fruit::plum),
        kind("lemon", fruit::lemon),
        kind("strawberry", fruit::strawberry),
        kind("banana", banana::banana),
        kind("cup", kitchenware::cup),
        kind("stacking cups", kitchenware::stacking_cups),
        kind("mug", kitchenware::mug),
        kind("bowl", kitchenware::bowl),
        kind("plate", kitchenware::plate),
        kind("pan lid", kitchenware::pan_lid),
        kind("sponge", kitchenware::sponge),
        kind("shaker", kitchenware::shaker),
        kind("fork", cutlery::fork),
        kind("knife", cutlery::knife),
        kind("spoon", cutlery::spoon),
        kind("spatula", cutlery::spatula),
        kind("drill", tools::drill),
        kind("wood block", tools::wood_block),
        kind("screwdriver", tools::screwdriver),
        kind("wrench", tools::wrench),
        kind("hammer", tools::hammer),
        kind("clamp", tools::clamp),
        kind("padlock", tools::padlock),
        kind("scissors", tools::scissors),
        kind("tape roll", tools::tape),
        kind("marker", tools::marker),
        kind("football", balls::football),
        kind("baseball", balls::baseball),
        kind("tennis ball", balls::tennis_ball),
        kind("golf ball", balls::golf_ball),
        kind("racquetball", balls::racquetball),
        kind("foam brick", toys::foam_brick),
        kind("die", toys::die),
        kind("small toy brick", toys::small_brick),
        kind("long toy brick", toys::long_brick),
        kind("toy brick tower", toys::brick_tower),
        kind("toy aeroplane", toys::aeroplane),
        kind("cube puzzle", toys::cube_puzzle),
        kind("kitchen timer", toys::timer),
        kind("toy car", toys::car),
        kind("ring tower", toys::ring_tower),
    ];
}
