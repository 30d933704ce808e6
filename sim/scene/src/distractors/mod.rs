//! Catalogue of distractor objects: everyday objects that no task mentions.
//!
//! The objects are data: the files under `kinds/`, one per theme, are embedded and interpreted. Placement on
//! the table is the concern of `draw/distractors.rs`.
//!
//! # Add a distractor
//!
//! Append a `[[kind]]` to a file, run the crate's tests and review what they report:
//!
//! ```toml
//! [[kind]]
//! name = "pill box"
//! density = 500     # kg/m³; `friction` is 0.5 unless given; `rolls = true` damps the rotation of round things
//! steps = [
//!   { let = "shell", of = ["#f68c18", "white"], vary = true },
//!   { column = [0.02, 0, 0.03] },                        # no paint: it collides
//!   { column = [0.02, 0, 0.03], paint = "glossy shell" } # a paint: it is seen
//! ]
//! ```
//!
//! Steps run in order. Lengths are in m, in any convenient frame: the finished object is moved onto the table
//! and scaled by a random factor. At least one shape must collide.
//!
//! | step | effect |
//! |--|--|
//! | `let = "a", of = [paint, …]` | names a paint, drawn from those given; then `vary = true` draws its brightness, and `times = [r, g, b]` multiplies its linear colour |
//! | `vivid = ["a", "b"]` | names saturated colours of different hues |
//! | `one_of = [[step, …], …]` | runs one of the lists |
//! | `chance = 0.4, then = [step, …], else = [step, …]` | runs one of two lists |
//! | `use = "group"` or `use = [step, …]` | runs the steps of a group, moved by `at` and `turn`; `surface` is where its prints go. `use = "pale"` and `use = "wood"` draw a paint of that name |
//! | a shape | adds the shape at each of `at`, turned by each of `turn`. With a `paint` it is seen, without one it collides, with `solid = true` it does both. If `paint` is a list, each copy draws one |
//!
//! | shape | numbers |
//! |--|--|
//! | `box`, `rounded_box` | half-extents x, y, z; edge radius |
//! | `ball`, `cylinder`, `capsule` | radius; half of the height along z (of a capsule, without its caps) |
//! | `column` | radius, lower z, upper z |
//! | `lathe` | profile points [r, z], up the outside; or `{ profile = "name", times = … }` |
//! | `extrusion` | `half` of the height along z, `outline` and `holes` of points [x, y] and of `arc` (in `steps` of 7.5°: first, last, increment), `ellipse` and `rounded` rectangles about `at` |
//! | `band`, `panel` | prints on `surface = { cylinder = [radius, low, high] }`: layer; of a panel, half of its width in steps of 7.5°; from and to in fractions of the height |
//! | `print`, `picture` | prints on `surface = { box = [x, y, z], sides = [1, -1] }`: layer; size y, z and place y, z, or the size, in fractions of the box |
//! | `seam`, `bow` | the seam of a ball; a bent, tapered solid such as a banana, which also collides |
//!
//! A `turn` is `z_to_x`, `z_to_y`, `y_to_z`, `x_to_y_to_z`, a quaternion [w, x, y, z] or the direction [x, y, z]
//! of the z axis; `ring` places copies on a parallel of a sphere instead. A paint is a name or `#rrggbb`,
//! after an optional finish (`plain`, `matt`, `peel`, `glossy`, `satin`, `polished`) and an optional texture,
//! as in `polished BrushedMetal #c7c9cf`.

mod builder;
mod curve;
mod distractor;
mod interpreter;
mod kind;
mod outline;
mod paint;
mod recipe;
mod shape;
mod surface;

pub use distractor::Distractor;
pub use kind::{DistractorKind, apple_profile};
