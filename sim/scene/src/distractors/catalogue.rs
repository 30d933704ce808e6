//! The kinds of distractor objects.

use super::distractor::Distractor;
use super::{balls, banana, bottles, cans, cartons, cutlery, fruit, kitchenware, tools, toys};
use crate::stream::Stream;

/// A kind of distractor object.
pub struct DistractorKind {
    /// Name; also the name of the stream from which its objects are sampled.
    pub name: &'static str,
    /// Samples an object of this kind: a pure function of the stream.
    pub make: fn(&mut Stream) -> Distractor,
}

const fn kind(name: &'static str, make: fn(&mut Stream) -> Distractor) -> DistractorKind {
    DistractorKind { name, make }
}

impl DistractorKind {
    /// All kinds. The order is part of the sampled scenes.
    pub const ALL: &[Self] = &[
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
