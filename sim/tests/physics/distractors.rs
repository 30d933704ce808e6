//! Properties that hold for every kind of distractor object.

use core::f64::consts::PI;

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use sim::physics::World;
use sim::scene::distractors::{Distractor, DistractorKind};
use sim::scene::stream::Stream;
use sim::scene::{
    Aabb, BodySpec, Mass, Motion, PartSpec, PlacementSpec, Primitive, Range, Role, ScaledBy, VisualShape,
    VisualSpec,
};
use sim::{Profile, TaskId};

/// Objects tested per kind.
const SEEDS: u64 = 4;
/// Control steps in two seconds.
const STEPS: usize = 40;

/// Calls `f` for every kind and seed, in parallel.
fn for_all_kinds<T: Send>(f: impl Fn(&'static DistractorKind, u64) -> T + Sync) -> Vec<T> {
    let all: Vec<_> =
        DistractorKind::all().iter().flat_map(|kind| (0..SEEDS).map(move |seed| (kind, seed))).collect();
    all.into_par_iter().map(|(kind, seed)| f(kind, seed)).collect()
}

fn make(kind: &DistractorKind, seed: u64) -> Distractor {
    kind.sample(&mut Stream::new(seed, kind.name()))
}

/// Returns how far an object placed on a table at a random yaw translates (m) and rotates (rad) within two
/// seconds.
fn drift(kind: &'static DistractorKind, seed: u64) -> [f64; 2] {
    let mut spec = (TaskId::RaiseCube.task().nominal)(Profile::Strict);
    let Distractor { parts, visuals, density, friction, damping } = make(kind, seed);
    let cube = spec.bodies.remove(0);
    let placement = PlacementSpec::OnSurface {
        region: 0,
        surface_z_m: 0.0,
        origin_z_m: None,
        orientation: nalgebra::UnitQuaternion::identity(),
        yaw: Range::new(0.0, 2.0 * PI),
    };
    spec.bodies = vec![BodySpec {
        name: kind.name(),
        role: Role::Distractor,
        motion: Motion::Dynamic,
        scaled_by: ScaledBy::Nothing("it is a distractor"),
        parts,
        visuals,
        placement,
        mass: Mass::Density(density),
        friction,
        damping,
        ..cube
    }];
    spec.robots.clear();
    let mut world = World::build(&spec.draw(seed), ControlMode::JointPos);
    let start: Isometry3<f64> = world.body_pose(0).cast();
    let mut max = [0.0_f64; 2];
    for _ in 0..STEPS {
        world.step(&[]);
        let now: Isometry3<f64> = world.body_pose(0).cast();
        let moved = (now.translation.vector - start.translation.vector).norm();
        let turned = start.rotation.angle_to(&now.rotation);
        max = [max[0].max(moved), max[1].max(turned)];
    }
    max
}

#[test]
fn objects_stay_at_rest_on_the_table() {
    for_all_kinds(|kind, seed| {
        let [moved, turned] = drift(kind, seed);
        assert!(moved < 5.1e-4 && turned < 0.009, "{} {seed}: {moved} m, {turned} rad", kind.name());
    });
}

/// Returns the bounding box of a visual, treating polygons that approximate circles as circles.
fn visual_aabb(visual: &VisualSpec) -> Aabb {
    let pose = &visual.pose;
    let around = |points: &mut dyn Iterator<Item = Point3<f64>>| {
        let points = points.map(|point| (pose * point).coords);
        let each = points.map(|p| Aabb { min: p, max: p });
        each.reduce(Aabb::union).expect("a shape has points")
    };
    match &visual.shape {
        VisualShape::Primitive(primitive) => primitive.aabb(pose),
        VisualShape::RoundedBox { half, edge_radius } => {
            let inner = half.map(|h| h - edge_radius);
            let core = Primitive::Box { half: inner }.aabb(pose);
            let ball = Vector3::repeat(*edge_radius);
            Aabb { min: core.min - ball, max: core.max + ball }
        }
        VisualShape::Lathe { profile } => profile
            .iter()
            .map(|[radius, z]| {
                let disc = Primitive::Cylinder { radius: *radius, half_height: 0.0 };
                disc.aabb(&(pose * Isometry3::translation(0.0, 0.0, *z)))
            })
            .reduce(Aabb::union)
            .expect("a profile has points"),
        VisualShape::Torus { .. } => panic!("no distractor has a torus"),
        VisualShape::Extrusion { outline, half_height, .. } => around(
            &mut outline
                .iter()
                .flat_map(|[x, y]| [-1.0, 1.0].map(|side| Point3::new(*x, *y, side * half_height))),
        ),
    }
}

fn union(aabbs: impl Iterator<Item = Aabb>) -> Aabb {
    aabbs.reduce(Aabb::union).expect("at least one shape")
}

fn parts_aabb(parts: &[PartSpec]) -> Aabb {
    union(parts.iter().map(|part| part.shape.aabb(&part.pose)))
}

/// Returns the mass in kg.
fn mass(Distractor { parts, density, .. }: &Distractor) -> f64 {
    let volume = |shape: &Primitive| match *shape {
        Primitive::Box { half: [x, y, z] } => 8.0 * x * y * z,
        Primitive::Cylinder { radius, half_height } => 2.0 * PI * radius * radius * half_height,
        Primitive::Ball { radius } => 4.0 / 3.0 * PI * radius.powi(3),
        Primitive::Capsule { radius, half_height } => {
            PI * radius * radius * (2.0 * half_height + 4.0 / 3.0 * radius)
        }
        Primitive::Hull { .. } => unreachable!("no distractor has a hull"),
    };
    parts.iter().map(|part| volume(&part.shape) * density).sum()
}

/// Returns a description of every requirement that an object violates.
fn defects(kind: &'static DistractorKind, seed: u64) -> Vec<String> {
    let object = make(kind, seed);
    let (solid, visible) = (parts_aabb(&object.parts), union(object.visuals.iter().map(visual_aabb)));
    let mut defects = Vec::new();
    let mut check = |holds: bool, defect: String| {
        if !holds {
            defects.push(defect);
        }
    };
    check(solid.min.z.abs() < 1e-9, format!("has its lowest collision point at z = {}", solid.min.z));
    check(visible.min.z >= -1e-6, format!("has its lowest visible point at z = {}", visible.min.z));
    check(((solid.min + solid.max) / 2.0).xy().amax() < 1e-3, "is not centred on the z axis".to_owned());
    check((solid.max - solid.min).max() <= 0.25, format!("is {} m long", (solid.max - solid.min).max()));
    let (protrusion, gap) = (
        (visible.max - solid.max).sup(&(solid.min - visible.min)),
        (solid.max - visible.max).sup(&(visible.min - solid.min)),
    );
    let mm = |lengths: Vector3<f64>| format!("{:.2?} mm", lengths.map(|x| 1e3 * x).as_slice());
    check(protrusion.max() <= 3e-3, format!("has visuals that protrude by {}", mm(protrusion)));
    check(gap.max() <= 3e-3, format!("has collision shapes that protrude by {}", mm(gap)));
    check((solid.max - solid.min).max() >= 0.02, "is too small".to_owned());
    check((1..=8).contains(&object.parts.len()), format!("has {} parts", object.parts.len()));
    check((0.02..=1.5).contains(&mass(&object)), format!("weighs {} kg", mass(&object)));
    check((0.3..=0.8).contains(&object.friction), format!("has friction {}", object.friction));
    for visual in &object.visuals {
        if let VisualShape::Lathe { profile } = &visual.shape {
            check(profile.len() <= 14, format!("has a profile of {} points", profile.len()));
        }
    }
    let again = make(kind, seed);
    check(
        again.parts == object.parts && again.visuals == object.visuals,
        "differs when it is sampled again".to_owned(),
    );
    defects
}

#[test]
fn objects_satisfy_all_requirements() {
    let reports = for_all_kinds(|kind, seed| {
        let defects = defects(kind, seed);
        defects.iter().map(|defect| format!("{} {seed} {defect}\n", kind.name())).collect::<String>()
    });
    assert_eq!(reports.concat(), "");
}

#[test]
fn kinds_vary_and_have_unique_names() {
    let kinds = DistractorKind::all();
    assert!(kinds.len() >= 40, "{} kinds", kinds.len());
    for (i, kind) in kinds.iter().enumerate() {
        assert!(kinds[..i].iter().all(|other| other.name() != kind.name()), "{} occurs twice", kind.name());
        assert!(make(kind, 0).visuals != make(kind, 1).visuals, "{} does not vary", kind.name());
    }
}
