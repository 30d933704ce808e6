//! Interpreter of recipes: draws what a recipe leaves open and builds the object.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::builder::{DistractorBuilder, IDENTITY, pose};
use super::distractor::Distractor;
use super::outline::outline;
use super::paint::Paint;
use super::recipe::{File, Recipe, RecipeStep, Rotation, ShapeStep, StepGroup};
use super::shape::{Extrusion, Lathe, Shape};
use super::surface::{Surface, column};
use crate::stream::Stream;
use crate::{AppearanceSpec, Primitive, Range, VisualShape};

/// Factor by which the brightness of a colour varies.
const BRIGHTNESS: Range = Range::new(0.7, 1.2);

/// Samples an object by its recipe. `shared` holds the groups and profiles of all files.
///
/// # Panics
/// If the recipe refers to something that does not exist.
pub(crate) fn sample(recipe: &Recipe, shared: &File, stream: &mut Stream) -> Distractor {
    let builder = DistractorBuilder::new(recipe.density, recipe.friction, recipe.rolls);
    let mut interpreter = Interpreter { shared, stream, builder, paints: BTreeMap::new() };
    let place = Place { frame: Isometry3::identity(), surface: None };
    interpreter.run(&shared.groups["paints"], place);
    interpreter.run(&recipe.steps, place);
    interpreter.builder.build(stream)
}

struct Interpreter<'a> {
    shared: &'a File,
    stream: &'a mut Stream,
    builder: DistractorBuilder,
    /// Paints by name.
    paints: BTreeMap<&'a str, AppearanceSpec>,
}

/// The place of a group of steps.
#[derive(Clone, Copy)]
struct Place<'a> {
    frame: Isometry3<f64>,
    surface: Option<&'a Surface>,
}

impl<'a> Interpreter<'a> {
    fn run(&mut self, steps: &'a [RecipeStep], place: Place<'a>) {
        for step in steps {
            match step {
                RecipeStep::Vivid { vivid } => self.draw_vivid(vivid),
                RecipeStep::Let { r#let, of, vary, times } => {
                    let mut paint = self.choose(of);
                    if *vary {
                        paint.color = self.vary_brightness(paint.color);
                    }
                    paint.color = core::array::from_fn(|i| times[i] * paint.color[i]);
                    self.paints.insert(r#let, paint);
                }
                RecipeStep::OneOf { one_of } => {
                    let steps = self.stream.choose(one_of);
                    self.run(steps, place);
                }
                RecipeStep::Chance { chance, then, r#else } => {
                    let steps = if self.stream.unit() < *chance { then } else { r#else };
                    self.run(steps, place);
                }
                RecipeStep::Use { r#use, at, turn, surface } => {
                    let local = pose(*at, turn.as_ref().map_or(IDENTITY, Rotation::quat));
                    let surface = surface.as_ref().or(place.surface);
                    let steps = match r#use {
                        StepGroup::Named(name) => &self.shared.groups[name],
                        StepGroup::Steps(steps) => steps,
                    };
                    self.run(steps, Place { frame: place.frame * local, surface });
                }
                RecipeStep::Shape(step) => self.add_copies(step, place),
            }
        }
    }

    /// Draws saturated colours of different hues; there are at most 12.
    fn draw_vivid(&mut self, names: &'a [String]) {
        let hues = &self.shared.vivid;
        let first = (self.stream.unit() * hues.len() as f64) as usize;
        for (i, name) in names.iter().enumerate() {
            // 5 and 12 are coprime, so stepping by 5 visits every colour once.
            let mut paint = self.appearance(&hues[(first + 5 * i) % hues.len()]);
            paint.color = self.vary_brightness(paint.color);
            self.paints.insert(name, paint);
        }
    }

    fn vary_brightness(&mut self, color: [f64; 3]) -> [f64; 3] {
        let factor = self.stream.uniform(BRIGHTNESS);
        color.map(|channel| (channel * factor).min(1.0))
    }

    /// Draws one of `paints`; the only one without a draw.
    fn choose(&mut self, paints: &[Paint]) -> AppearanceSpec {
        let paint = if let [paint] = paints { paint } else { self.stream.choose(paints) };
        self.appearance(paint)
    }

    fn appearance(&self, paint: &Paint) -> AppearanceSpec {
        paint.appearance(|name| {
            *self.paints.get(name).unwrap_or_else(|| panic!("no paint is called `{name}`"))
        })
    }

    fn add_copies(&mut self, step: &ShapeStep, place: Place) {
        for pose in step.poses() {
            let appearance = step.paint.as_ref().map(|paints| self.choose(paints.as_slice()));
            let pose = place.frame * pose;
            if step.solid || appearance.is_none() {
                let (shape, z) = collider(&step.shape);
                self.builder.collider(shape, pose * Isometry3::translation(0.0, 0.0, z));
            }
            if let Some(appearance) = appearance {
                self.add_visual(&step.shape, pose, place.surface, appearance);
            }
        }
    }

    fn add_visual(
        &mut self,
        shape: &Shape,
        pose: Isometry3<f64>,
        surface: Option<&Surface>,
        appearance: AppearanceSpec,
    ) {
        match shape {
            Shape::Seam(seam) => seam.add_to(&mut self.builder, pose, appearance),
            Shape::Bow(bow) => bow.add_to(&mut self.builder, pose, appearance),
            Shape::Band(_) | Shape::Panel(_) | Shape::Print(_) | Shape::Picture(_) => {
                let surface = surface.expect("prints belong to a group with a surface");
                for (on_surface, shape) in surface.prints(shape) {
                    self.builder.visual(shape, pose * on_surface, appearance);
                }
            }
            _ => self.builder.visual(self.visual_shape(shape), pose, appearance),
        }
    }

    fn visual_shape(&self, shape: &Shape) -> VisualShape {
        match shape {
            &Shape::RoundedBox([x, y, z, edge_radius]) => {
                VisualShape::RoundedBox { half: [x, y, z], edge_radius }
            }
            &Shape::Column([radius, low, high]) => column(radius, [low, high]),
            Shape::Lathe(Lathe::Points(profile)) => VisualShape::Lathe { profile: profile.clone() },
            Shape::Lathe(Lathe::Scaled { profile, times }) => {
                let points = self.shared.profiles[profile].iter();
                VisualShape::Lathe { profile: points.map(|point| point.map(|x| x * times)).collect() }
            }
            Shape::Extrusion(Extrusion { half, outline: pieces, holes }) => VisualShape::Extrusion {
                outline: outline(pieces),
                holes: holes.iter().map(|hole| outline(hole)).collect(),
                half_height: *half,
            },
            _ => VisualShape::Primitive(collider(shape).0),
        }
    }
}

/// Returns the collision shape and the height of its centre.
fn collider(shape: &Shape) -> (Primitive, f64) {
    match *shape {
        Shape::Box(half) => (Primitive::Box { half }, 0.0),
        Shape::RoundedBox([x, y, z, _]) => (Primitive::Box { half: [x, y, z] }, 0.0),
        Shape::Cylinder([radius, half_height]) => (Primitive::Cylinder { radius, half_height }, 0.0),
        Shape::Column([radius, low, high]) => {
            (Primitive::Cylinder { radius, half_height: (high - low) / 2.0 }, f64::midpoint(low, high))
        }
        Shape::Ball(radius) => (Primitive::Ball { radius }, 0.0),
        Shape::Capsule([radius, half_height]) => (Primitive::Capsule { radius, half_height }, 0.0),
        _ => panic!("a shape without a paint collides, which only convex primitives can"),
    }
}
