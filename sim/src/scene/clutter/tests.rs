//! What holds of every kind.

use core::f64::consts::PI;

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::{Kind, Thing};
use crate::TaskId;
use crate::physics::World;
use crate::scene::{
    BodySpec, Extent, Form, Motion, PartSpec, PlacementSpec, Primitive, Range, Role, ScaledBy, VisualSpec,
};
use crate::stream::Stream;

const SEEDS: u64 = 4;
/// Two seconds of control steps.
const STEPS: usize = 40;

fn every<T: Send>(look: impl Fn(&'static Kind, u64) -> T + Sync) -> Vec<T> {
    let all: Vec<_> = Kind::ALL.iter().flat_map(|kind| (0..SEEDS).map(move |seed| (kind, seed))).collect();
    all.into_par_iter().map(|(kind, seed)| look(kind, seed)).collect()
}

/// A kind's thing of a seed.
fn thing(kind: &Kind, seed: u64) -> Thing {
    (kind.make)(&mut Stream::new(seed, kind.name))
}

/// How far a thing moves (m) and turns (rad) in two seconds on a table, at any yaw.
fn drift(kind: &'static Kind, seed: u64) -> [f64; 2] {
    let mut spec = (TaskId::RaiseCube.task().nominal)();
    let Thing { parts, visuals, density, friction, damping } = thing(kind, seed);
    let cube = spec.bodies.remove(0);
    let place = PlacementSpec::On {
        region: 0,
        surface_z_m: 0.0,
        upright: nalgebra::UnitQuaternion::identity(),
        yaw: Range::new(0.0, 2.0 * PI),
    };
    spec.bodies = vec![BodySpec {
        name: kind.name,
        role: Role::Distractor,
        motion: Motion::Dynamic,
        scaled_by: ScaledBy::Nothing("it is clutter"),
        parts,
        visuals,
        placement: place,
        density,
        friction,
        damping,
        ..cube
    }];
    spec.robots.clear();
    let mut world = World::build(&spec.draw(seed), ControlMode::JointPos);
    let start: Isometry3<f64> = world.body_pose(0).cast();
    let mut worst = [0.0_f64; 2];
    for _ in 0..STEPS {
        world.step(&[]);
        let now: Isometry3<f64> = world.body_pose(0).cast();
        let moved = (now.translation.vector - start.translation.vector).norm();
        let turned = start.rotation.angle_to(&now.rotation);
        worst = [worst[0].max(moved), worst[1].max(turned)];
    }
    worst
}

#[test]
fn things_stay_where_they_are_put() {
    every(|kind, seed| {
        let [moved, turned] = drift(kind, seed);
        assert!(moved < 5e-4 && turned < 0.009, "{} {seed}: {moved} m, {turned} rad", kind.name);
    });
}

/// Extent of a form, the polygons that stand for circles taken as circles.
fn form_extent(visual: &VisualSpec) -> Extent {
    let pose = &visual.pose;
    let around = |points: &mut dyn Iterator<Item = Point3<f64>>| {
        let points = points.map(|point| (pose * point).coords);
        let each = points.map(|p| Extent { min: p, max: p });
        each.reduce(Extent::union).expect("a form has points")
    };
    match &visual.form {
        Form::Primitive(solid) => solid.extent(pose),
        Form::RoundedBox { half, edge_radius } => {
            let inner = half.map(|h| h - edge_radius);
            let core = Primitive::Box { half: inner }.extent(pose);
            let ball = Vector3::repeat(*edge_radius);
            Extent { min: core.min - ball, max: core.max + ball }
        }
        Form::Lathe { profile } => profile
            .iter()
            .map(|[radius, z]| {
                let disc = Primitive::Cylinder { radius: *radius, half_height: 0.0 };
                disc.extent(&(pose * Isometry3::translation(0.0, 0.0, *z)))
            })
            .reduce(Extent::union)
            .expect("a profile has points"),
        Form::Torus { .. } => panic!("no thing has a torus"),
        Form::Extrusion { outline, half_height, .. } => around(
            &mut outline
                .iter()
                .flat_map(|[x, y]| [-1.0, 1.0].map(|side| Point3::new(*x, *y, side * half_height))),
        ),
    }
}

fn whole(extents: impl Iterator<Item = Extent>) -> Extent {
    extents.reduce(Extent::union).expect("something is there")
}

fn solid_extent(parts: &[PartSpec]) -> Extent {
    whole(parts.iter().map(|part| part.shape.extent(&part.pose)))
}

fn mass(Thing { parts, density, .. }: &Thing) -> f64 {
    let volume = |shape: Primitive| match shape {
        Primitive::Box { half: [x, y, z] } => 8.0 * x * y * z,
        Primitive::Cylinder { radius, half_height } => 2.0 * PI * radius * radius * half_height,
        Primitive::Ball { radius } => 4.0 / 3.0 * PI * radius.powi(3),
        Primitive::Capsule { radius, half_height } => {
            PI * radius * radius * (2.0 * half_height + 4.0 / 3.0 * radius)
        }
    };
    parts.iter().map(|part| volume(part.shape) * density).sum()
}

/// What is wrong with a thing, in words.
fn faults(kind: &'static Kind, seed: u64) -> Vec<String> {
    let thing = thing(kind, seed);
    let (solid, seen) = (solid_extent(&thing.parts), whole(thing.visuals.iter().map(form_extent)));
    let mut faults = Vec::new();
    let mut check = |holds: bool, what: String| {
        if !holds {
            faults.push(what);
        }
    };
    check(solid.min.z.abs() < 1e-9, format!("lies at {}", solid.min.z));
    check(seen.min.z >= -1e-6, format!("is seen down to {}", seen.min.z));
    check(((solid.min + solid.max) / 2.0).xy().amax() < 1e-3, "is off the axis".to_owned());
    check((solid.max - solid.min).max() <= 0.25, format!("is {} m long", (solid.max - solid.min).max()));
    let (out, less) = (
        (seen.max - solid.max).sup(&(solid.min - seen.min)),
        (solid.max - seen.max).sup(&(seen.min - solid.min)),
    );
    check(out.max() <= 3e-3, format!("stands out by {:.2?} mm", out.map(|x| 1e3 * x).as_slice()));
    check(
        less.max() <= 3e-3,
        format!("collides beyond its looks by {:.2?} mm", less.map(|x| 1e3 * x).as_slice()),
    );
    check((solid.max - solid.min).max() >= 0.02, "is too small".to_owned());
    check((1..=8).contains(&thing.parts.len()), format!("has {} parts", thing.parts.len()));
    check((0.02..=1.5).contains(&mass(&thing)), format!("weighs {} kg", mass(&thing)));
    check((0.3..=0.8).contains(&thing.friction), format!("has friction {}", thing.friction));
    for visual in &thing.visuals {
        if let Form::Lathe { profile } = &visual.form {
            check(profile.len() <= 14, format!("has a profile of {} points", profile.len()));
        }
    }
    let again = self::thing(kind, seed);
    check(again.parts == thing.parts && again.visuals == thing.visuals, "is drawn otherwise".to_owned());
    faults
}

#[test]
fn things_are_sound() {
    let told = every(|kind, seed| {
        let faults = faults(kind, seed);
        faults.iter().map(|fault| format!("{} {seed} {fault}\n", kind.name)).collect::<String>()
    });
    assert_eq!(told.concat(), "");
}

#[test]
fn a_kind_has_things_that_differ_and_names_are_unique() {
    assert!(Kind::ALL.len() >= 40, "{} kinds", Kind::ALL.len());
    for (i, kind) in Kind::ALL.iter().enumerate() {
        assert!(Kind::ALL[..i].iter().all(|other| other.name != kind.name), "{} twice", kind.name);
        assert!(thing(kind, 0).visuals != thing(kind, 1).visuals, "{} is always the same", kind.name);
    }
}
