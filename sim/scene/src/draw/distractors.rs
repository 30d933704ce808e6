//! Sampling of distractor objects: their kinds, and positions that are clear of the arms, of the task's
//! bodies, of one another and of the external cameras' view of the manipulated objects, or anywhere in the
//! air.

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::occlusion::LinesOfSight;
use super::parts::{Painter, draw_parts, draw_visuals};
use crate::distractors::{Distractor, DistractorKind};
use crate::drawn::{Body, Robot};
use crate::mass::Mass;
use crate::range::Range;
use crate::robot::kinematics::{self, Joints};
use crate::spec::{CameraSpec, Motion, RenderParts, Role};
use crate::spec::{DistractorPlacement, DistractorsSpec};
use crate::stream::Stream;

/// Body names, which also name the random streams. Their number limits the distractor objects of a scene.
const NAMES: [&str; 2] = ["distractor 1", "distractor 2"];
/// Maximum number of objects sampled before a distractor is omitted for lack of space.
const MAX_OBJECT_DRAWS: usize = 40;
/// Maximum number of poses sampled for each object.
const MAX_POSE_DRAWS: usize = 50;
/// Clearance between a distractor's bounding circle and any other footprint, in m: room for the gripper's
/// fingers.
const CLEARANCE_M: f64 = 0.05;
/// Maximum distance of an arm's surface from the polyline through its joints, in m.
const ARM_RADIUS_M: f64 = 0.12;
/// Points tested on each segment of that polyline.
const POINTS_PER_LINK: usize = 6;

/// Draws the distractor objects of one episode.
///
/// # Panics
/// If `spec.n` exceeds the number of available names.
pub(crate) fn draw(
    spec: &DistractorsSpec,
    bodies: &[Body],
    robots: &[Robot],
    cameras: &[CameraSpec],
    episode_seed: u64,
) -> Vec<Body> {
    assert!(spec.n <= NAMES.len(), "a scene has at most {} distractors, not {}", NAMES.len(), spec.n);
    if spec.presence == 0.0 {
        return Vec::new();
    }
    if spec.placement == DistractorPlacement::Dropped {
        return drop(spec, bodies, episode_seed);
    }
    let arm_points: Vec<Point3<f64>> = robots.iter().flat_map(points_along).collect();
    let lines_of_sight = LinesOfSight::new(cameras, bodies);
    let mut occupied: Vec<Footprint> = bodies.iter().map(Footprint::of).collect();
    let mut distractors = Vec::new();
    for name in &NAMES[..spec.n] {
        let stream = |of: &str| Stream::new(episode_seed, &format!("{name}/{of}"));
        if stream("chance").unit() >= spec.presence {
            continue;
        }
        let (mut kinds, mut poses) = (stream("kind"), stream("place"));
        let is_clear = |body: &Body, pose: &Isometry3<f64>| {
            let circle = BoundingCircle::of(body, pose);
            occupied.iter().all(|other| circle.is_clear_of(other))
                && arm_points.iter().all(|point| circle.is_clear_of_arm_at(point))
                && !lines_of_sight.are_blocked_by(&body.aabb(pose))
        };
        let found = (0..MAX_OBJECT_DRAWS).find_map(|_| {
            let kind = kinds.choose(DistractorKind::all());
            let body = draw_body(name, &kind.sample(&mut stream(kind.name())), episode_seed);
            let mut candidates = (0..MAX_POSE_DRAWS).map(|_| draw_pose(spec, &mut poses));
            let pose = candidates.find(|pose| is_clear(&body, pose))?;
            Some(Body { pose, ..body })
        });
        if let Some(body) = found {
            occupied.push(Footprint::of(&body));
            distractors.push(body);
        }
    }
    distractors
}

/// Draws objects that fall from the air, one after another without looking at anything below.
fn drop(spec: &DistractorsSpec, bodies: &[Body], episode_seed: u64) -> Vec<Body> {
    let (above_m, reference) = spec.drop_m;
    let z = above_m + reference.map_or(0.0, |body| bodies[body].pose.translation.z);
    let is_present =
        |name: &&&str| Stream::new(episode_seed, &format!("{name}/chance")).unit() < spec.presence;
    let draw = |name: &&'static str| {
        let stream = |of: &str| Stream::new(episode_seed, &format!("{name}/{of}"));
        let (mut place, kind) = (stream("place"), stream("kind").choose(DistractorKind::all()));
        let [x, y] = [spec.x, spec.y].map(|range| place.uniform(range));
        let body = draw_body(name, &kind.sample(&mut stream(kind.name())), episode_seed);
        Body { pose: Isometry3::translation(x, y, z), ..body }
    };
    NAMES[..spec.n].iter().filter(is_present).map(draw).collect()
}

/// Draws a position within the spec's ranges and any yaw.
fn draw_pose(spec: &DistractorsSpec, stream: &mut Stream) -> Isometry3<f64> {
    let [x, y] = [spec.x, spec.y].map(|range| stream.uniform(range));
    let yaw = stream.uniform(Range::new(0.0, TAU));
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::new(x, y, spec.surface_z_m), yaw)
}

fn draw_body(name: &'static str, distractor: &Distractor, episode_seed: u64) -> Body {
    let painter = Painter { name, render_parts: RenderParts::PerShape, episode_seed };
    Body {
        name,
        role: Role::Distractor,
        motion: Motion::Dynamic,
        parts: draw_parts(&painter, &distractor.parts, &Vector3::repeat(1.0)),
        visuals: draw_visuals(&painter, &distractor.visuals, &Vector3::repeat(1.0)),
        scale: Vector3::repeat(1.0),
        pose: Isometry3::identity(),
        drop_m: 0.0,
        mass: Mass::Density(distractor.density),
        friction: distractor.friction,
        damping: distractor.damping,
    }
}

/// Bounding rectangle of a body's projection onto the ground, in m.
struct Footprint {
    min: [f64; 2],
    max: [f64; 2],
}

impl Footprint {
    fn of(body: &Body) -> Self {
        let aabb = body.aabb(&body.pose);
        Self { min: [aabb.min.x, aabb.min.y], max: [aabb.max.x, aabb.max.y] }
    }
}

/// Bounding circle of a distractor's footprint at any yaw, in m.
struct BoundingCircle {
    centre: [f64; 2],
    radius: f64,
    /// World z of the distractor's highest point.
    top_z: f64,
}

impl BoundingCircle {
    fn of(body: &Body, pose: &Isometry3<f64>) -> Self {
        let aabb = body.aabb(&Isometry3::identity());
        let half = aabb.min.abs().sup(&aabb.max.abs());
        let at = pose.translation;
        Self { centre: [at.x, at.y], radius: libm::hypot(half.x, half.y), top_z: at.z + aabb.max.z }
    }

    fn is_clear_of(&self, other: &Footprint) -> bool {
        let outside_by = |axis: usize| {
            let at = self.centre[axis];
            (other.min[axis] - at).max(at - other.max[axis]).max(0.0)
        };
        libm::hypot(outside_by(0), outside_by(1)) > self.radius + CLEARANCE_M
    }

    fn is_clear_of_arm_at(&self, point: &Point3<f64>) -> bool {
        let distance = libm::hypot(point.x - self.centre[0], point.y - self.centre[1]);
        point.z - ARM_RADIUS_M > self.top_z || distance > self.radius + ARM_RADIUS_M
    }
}

/// Samples world points along the polyline from an arm's base through its joints to its TCP.
fn points_along(robot: &Robot) -> Vec<Point3<f64>> {
    let q = Joints::from(robot.qpos);
    let frames = kinematics::links(&q).into_iter().chain([kinematics::tcp(&q)]);
    let mut from = Point3::from(robot.base.translation.vector);
    let mut points = Vec::new();
    for frame in frames {
        let to = robot.base * Point3::from(frame.translation.vector);
        points.extend((0..POINTS_PER_LINK).map(|i| from + (to - from) * (i as f64 / POINTS_PER_LINK as f64)));
        from = to;
    }
    points.push(from);
    points
}
