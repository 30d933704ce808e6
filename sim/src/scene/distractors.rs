//! Where clutter stands: anywhere in its square that is clear of the arms, of what the task needs, and of other clutter.

use core::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::clutter::{Kind, Thing};
use super::draw::{draw_parts, draw_visuals};
use super::drawn::{Body, Robot};
use super::place::DistractorsSpec;
use super::range::Range;
use super::spec::{Motion, Role};
use crate::robot::kinematics::{self, Joints};
use crate::stream::Stream;

/// Names, and with them the streams, of as many distractors as a scene may have.
const NAMES: [&str; 2] = ["distractor 1", "distractor 2"];
/// Things drawn before a distractor is left out because there is room for none, and places tried for each.
const MAX_THINGS: usize = 40;
const MAX_PLACES: usize = 50;
/// Room for a gripper's fingers between a distractor's circle and all else that stands there, in m.
const ROOM_M: f64 = 0.05;
/// Greatest distance of an arm's surface from the line through its joints, in m.
const ARM_RADIUS_M: f64 = 0.12;
/// Points looked at on each stretch of that line.
const POINTS_PER_LINK: usize = 6;

/// The episode's distractors.
///
/// # Panics
/// If there may be more than have names.
pub(super) fn draw(
    spec: &DistractorsSpec,
    bodies: &[Body],
    robots: &[Robot],
    episode_seed: u64,
) -> Vec<Body> {
    assert!(spec.n <= NAMES.len(), "a scene has at most {} distractors", NAMES.len());
    if spec.presence == 0.0 {
        return Vec::new();
    }
    let arm_points: Vec<Point3<f64>> = robots.iter().flat_map(points_along).collect();
    let mut taken: Vec<Footprint> = bodies.iter().map(Footprint::of).collect();
    let mut distractors = Vec::new();
    for name in &NAMES[..spec.n] {
        let stream = |of: &str| Stream::new(episode_seed, &format!("{name}/{of}"));
        if stream("chance").unit() >= spec.presence {
            continue;
        }
        let (mut choice, mut place) = (stream("kind"), stream("place"));
        let free = |body: &Body, pose: &Isometry3<f64>| {
            let circle = Circle::under(body, pose);
            taken.iter().all(|other| circle.is_clear_of(other))
                && arm_points.iter().all(|point| circle.is_clear_of_arm_at(point))
        };
        let found = (0..MAX_THINGS).find_map(|_| {
            let kind = choice.choose(Kind::ALL);
            let body = body(name, &(kind.make)(&mut stream(kind.name)), episode_seed);
            let pose = (0..MAX_PLACES).map(|_| pose(spec, &mut place)).find(|pose| free(&body, pose))?;
            Some(Body { pose, ..body })
        });
        if let Some(body) = found {
            taken.push(Footprint::of(&body));
            distractors.push(body);
        }
    }
    distractors
}

/// Somewhere in the square, turned anyhow.
fn pose(spec: &DistractorsSpec, place: &mut Stream) -> Isometry3<f64> {
    let [x, y] = [spec.x, spec.y].map(|range| place.uniform(range));
    let yaw = place.uniform(Range::new(0.0, TAU));
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::new(x, y, spec.surface_z_m), yaw)
}

fn body(name: &'static str, thing: &Thing, episode_seed: u64) -> Body {
    Body {
        name,
        role: Role::Distractor,
        motion: Motion::Dynamic,
        parts: draw_parts(name, &thing.parts, 1.0, episode_seed),
        visuals: draw_visuals(name, &thing.visuals, 1.0, episode_seed),
        scale: 1.0,
        pose: Isometry3::identity(),
        density: thing.density,
        friction: thing.friction,
        damping: thing.damping,
    }
}

/// What a body takes up, seen from above: the rectangle around it, in m.
struct Footprint {
    least: [f64; 2],
    greatest: [f64; 2],
}

impl Footprint {
    fn of(body: &Body) -> Self {
        let extent = body.extent(&body.pose);
        Self { least: [extent.min.x, extent.min.y], greatest: [extent.max.x, extent.max.y] }
    }
}

/// What a distractor takes up at any yaw, in m.
struct Circle {
    middle: [f64; 2],
    radius: f64,
    top_z: f64,
}

impl Circle {
    fn under(body: &Body, pose: &Isometry3<f64>) -> Self {
        let extent = body.extent(&Isometry3::identity());
        let reach = extent.min.abs().sup(&extent.max.abs());
        let at = pose.translation;
        Self { middle: [at.x, at.y], radius: reach.x.hypot(reach.y), top_z: at.z + extent.max.z }
    }

    fn is_clear_of(&self, other: &Footprint) -> bool {
        let beyond = |axis: usize| {
            let at = self.middle[axis];
            (other.least[axis] - at).max(at - other.greatest[axis]).max(0.0)
        };
        beyond(0).hypot(beyond(1)) > self.radius + ROOM_M
    }

    fn is_clear_of_arm_at(&self, point: &Point3<f64>) -> bool {
        let apart = (point.x - self.middle[0]).hypot(point.y - self.middle[1]);
        point.z - ARM_RADIUS_M > self.top_z || apart > self.radius + ARM_RADIUS_M
    }
}

/// World points along an arm, from its base to its TCP.
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
