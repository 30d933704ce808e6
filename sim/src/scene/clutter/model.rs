//! A thing in the making: solids that collide and forms that are seen, put together in whatever frame is convenient.
//! When it is done it is set down around the z axis and given its size. Lengths in m.

use core::ops::RangeInclusive;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::Thing;
use crate::scene::{Extent, Form, PaintSpec, PartSpec, Primitive, Range, VisualSpec};
use crate::stream::Stream;

/// How far a label stands out, so that it hides what is under it.
pub(super) const LABEL: f64 = 0.0003;
/// Share of its spin that a ball loses per second, for it is no perfect one; in 1/s.
const ROLLING_LOSS: f64 = 3.0;
/// Isotropic scale of a thing.
const SCALE: Range = Range::new(0.92, 1.08);

/// A rotation as a quaternion (w, x, y, z) of any length.
pub(super) type Turn = [f64; 4];
/// As it is.
pub(super) const AS_IS: Turn = [1.0, 0.0, 0.0, 0.0];
/// The z axis to x, and x to −z.
pub(super) const ALONG_X: Turn = [1.0, 0.0, 1.0, 0.0];
/// The z axis to y, and y to −z.
pub(super) const ALONG_Y: Turn = [1.0, -1.0, 0.0, 0.0];
/// The y axis to z, and z to −y: an outline stands up.
pub(super) const UPRIGHT: Turn = [1.0, 1.0, 0.0, 0.0];
/// The x axis to y, y to z and z to x: an outline stands up along y.
pub(super) const SIDEWAYS: Turn = [1.0, 1.0, 1.0, 1.0];
/// Half a turn about z.
pub(super) const HALF_TURN: Turn = [0.0, 0.0, 0.0, 1.0];

/// The pose at `position` (m), turned.
pub(super) fn pose(position: [f64; 3], [w, x, y, z]: Turn) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Translation3::from(position), rotation)
}

/// The turn that takes the z axis to a unit vector other than −z.
pub(super) fn z_to([x, y, z]: [f64; 3]) -> Turn {
    [1.0 + z, -y, x, 0.0]
}

/// Cosine and sine of 7.5°, a step around a circle.
pub(super) const STEP: [f64; 2] = [0.991_444_861_373_810_4, 0.130_526_192_220_051_6];

/// Points of a circle of this radius about the origin, at multiples of 7.5° from the x axis.
pub(super) fn arc(radius: f64, steps: RangeInclusive<i32>) -> Vec<[f64; 2]> {
    let turned = |[x, y]: [f64; 2], _| [STEP[0] * x - STEP[1] * y, STEP[1] * x + STEP[0] * y];
    steps.map(|step| (0..step.rem_euclid(48)).fold([radius, 0.0], turned)).collect()
}

/// Outline of an ellipse about the origin with these half axes.
pub(super) fn ellipse([a, b]: [f64; 2]) -> Vec<[f64; 2]> {
    arc(1.0, 0..=47).iter().step_by(2).map(|[x, y]| [a * x, b * y]).collect()
}

/// A thing in the making.
pub(super) struct Model(Thing);

impl Model {
    /// Nothing yet, of this density in kg/m³.
    pub(super) fn new(density: f64) -> Self {
        Self(Thing { parts: Vec::new(), visuals: Vec::new(), density, friction: 0.5, damping: [0.0; 2] })
    }

    /// Grips or slides as this coefficient says.
    pub(super) fn friction(&mut self, friction: f64) -> &mut Self {
        self.0.friction = friction;
        self
    }

    /// Rolls, and comes to rest some time.
    pub(super) fn rolling(&mut self) -> &mut Self {
        self.0.damping = [0.0, ROLLING_LOSS];
        self
    }

    /// With a solid that collides.
    pub(super) fn solid(&mut self, shape: Primitive, pose: Isometry3<f64>) -> &mut Self {
        self.0.parts.push(PartSpec { shape, pose, paint: PaintSpec::plain([0.7; 3]) });
        self
    }

    /// With a box that collides.
    pub(super) fn block(&mut self, half: [f64; 3], middle: [f64; 3]) -> &mut Self {
        self.solid(Primitive::Box { half }, pose(middle, AS_IS))
    }

    /// With two crossed boxes that collide and together leave out the edges along z of a third.
    pub(super) fn crossed(&mut self, [x, y, z]: [f64; 3], edge: f64, middle: [f64; 3]) -> &mut Self {
        self.block([x - edge, y, z], middle).block([x, y - edge, z], middle)
    }

    /// With a standing cylinder that collides, between two heights.
    pub(super) fn column(&mut self, radius: f64, [low, high]: [f64; 2]) -> &mut Self {
        let shape = Primitive::Cylinder { radius, half_height: (high - low) / 2.0 };
        self.solid(shape, pose([0.0, 0.0, f64::midpoint(low, high)], AS_IS))
    }

    /// With a rod along x that collides and does not roll, between two x.
    pub(super) fn rod(&mut self, radius: f64, [from, to]: [f64; 2]) -> &mut Self {
        let (half, middle) = ((to - from) / 2.0, [f64::midpoint(from, to), 0.0, 0.0]);
        self.block([half, radius, radius / 2.0], middle).block([half, radius / 2.0, radius], middle)
    }

    /// With a form that is seen.
    pub(super) fn form(&mut self, form: Form, pose: Isometry3<f64>, paint: PaintSpec) -> &mut Self {
        self.0.visuals.push(VisualSpec { form, pose, paint });
        self
    }

    /// With a box that is seen.
    pub(super) fn slab(&mut self, half: [f64; 3], middle: [f64; 3], paint: PaintSpec) -> &mut Self {
        self.form(Form::Primitive(Primitive::Box { half }), pose(middle, AS_IS), paint)
    }

    /// With a box that is seen and whose edges are rounded.
    pub(super) fn rounded(
        &mut self,
        half: [f64; 3],
        middle: [f64; 3],
        edge_radius: f64,
        paint: PaintSpec,
    ) -> &mut Self {
        self.form(Form::RoundedBox { half, edge_radius }, pose(middle, AS_IS), paint)
    }

    /// With a box that collides, seen with its edges rounded.
    pub(super) fn piece(
        &mut self,
        half: [f64; 3],
        middle: [f64; 3],
        edge_radius: f64,
        paint: PaintSpec,
    ) -> &mut Self {
        self.block(half, middle).rounded(half, middle, edge_radius, paint)
    }

    /// With what a profile of points (r, z) sweeps about an axis, as [`Form::Lathe`] says.
    pub(super) fn lathe(
        &mut self,
        profile: &[[f64; 2]],
        pose: Isometry3<f64>,
        paint: PaintSpec,
    ) -> &mut Self {
        self.form(Form::Lathe { profile: profile.to_vec() }, pose, paint)
    }

    /// With what a profile sweeps about z.
    pub(super) fn turned(&mut self, profile: &[[f64; 2]], paint: PaintSpec) -> &mut Self {
        self.lathe(profile, Isometry3::identity(), paint)
    }

    /// With a standing drum that is seen, between two heights.
    pub(super) fn drum(&mut self, radius: f64, [low, high]: [f64; 2], paint: PaintSpec) -> &mut Self {
        self.turned(&[[0.0, low], [radius, low], [radius, high], [0.0, high]], paint)
    }

    /// With a drum about the x axis that is seen, between two x.
    pub(super) fn drum_along_x(&mut self, radius: f64, between: [f64; 2], paint: PaintSpec) -> &mut Self {
        self.drum_along_x_at(radius, between, 0.0, paint)
    }

    /// The same at some y.
    pub(super) fn drum_along_x_at(
        &mut self,
        radius: f64,
        [from, to]: [f64; 2],
        y: f64,
        paint: PaintSpec,
    ) -> &mut Self {
        let profile = [[0.0, from], [radius, from], [radius, to], [0.0, to]];
        self.lathe(&profile, pose([0.0, y, 0.0], ALONG_X), paint)
    }

    /// With a plate that is seen.
    pub(super) fn plate(
        &mut self,
        outline: &[[f64; 2]],
        holes: &[&[[f64; 2]]],
        half_height: f64,
        pose: Isometry3<f64>,
        paint: PaintSpec,
    ) -> &mut Self {
        let holes = holes.iter().map(|hole| hole.to_vec()).collect();
        self.form(Form::Extrusion { outline: outline.to_vec(), holes, half_height }, pose, paint)
    }

    /// With a curved sheet that lies around a drum of this radius, `layer` sheets above it: between two heights, and to
    /// both sides of the turned x axis over so many steps of 7.5°.
    pub(super) fn sheet(
        &mut self,
        (radius, layer): (f64, u32),
        half_steps: i32,
        [low, high]: [f64; 2],
        turn: Turn,
        paint: PaintSpec,
    ) -> &mut Self {
        let outer = radius + LABEL * f64::from(layer);
        let steps = || -half_steps..=half_steps;
        let mut outline = arc(outer, steps());
        outline.extend(arc(radius - 0.003, steps()).into_iter().rev());
        let middle = [0.0, 0.0, f64::midpoint(low, high)];
        self.plate(&outline, &[], (high - low) / 2.0, pose(middle, turn), paint)
    }

    /// All of it turned.
    pub(super) fn tipped(&mut self, turn: Turn) -> &mut Self {
        self.moved(&pose([0.0; 3], turn))
    }

    fn moved(&mut self, by: &Isometry3<f64>) -> &mut Self {
        self.0.parts.iter_mut().for_each(|part| part.pose = by * part.pose);
        self.0.visuals.iter_mut().for_each(|visual| visual.pose = by * visual.pose);
        self
    }

    /// What collides set down on z 0 around the z axis, all of it at a size that is drawn.
    ///
    /// # Panics
    /// If nothing collides.
    pub(super) fn made(mut self, stream: &mut Stream) -> Thing {
        let extents = self.0.parts.iter().map(|part| part.shape.extent(&part.pose));
        let Extent { min, max } = extents.reduce(Extent::union).expect("a thing has at least one part");
        let middle = (min + max) / 2.0;
        self.moved(&Translation3::new(-middle.x, -middle.y, -min.z).into());
        let scale = stream.uniform(SCALE);
        let Thing { parts, visuals, .. } = &mut self.0;
        for part in parts {
            part.shape = part.shape.scaled(scale);
            part.pose.translation.vector *= scale;
        }
        for visual in visuals {
            visual.form = visual.form.scaled(scale);
            visual.pose.translation.vector *= scale;
        }
        self.0
    }
}
