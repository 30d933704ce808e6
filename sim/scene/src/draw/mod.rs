//! Sampling of a scene from its spec. Every range is sampled from a random stream of its own name.

mod appearance;
mod distractors;
mod occlusion;
mod parts;

use std::borrow::Cow;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use self::parts::{Painter, draw_parts, draw_visuals, scale_translation};
use super::drawn::{Body, Camera, Robot, Scene};
use super::shape::Aabb;
use super::spec::{
    BodySpec, CameraSpec, Jitter, JointKind, JointSpec, Motion, RobotSpec, ScaleAxes, SceneSpec,
};
use super::spec::{PlacementSpec, RegionSpec};
use crate::robot::panda::{LOWER, UPPER};
use crate::stream::{Stream, placement_seed};

/// Maximum number of positions sampled for a body in a crowded region. The last sample is used if all are
/// rejected.
const MAX_PLACEMENT_DRAWS: usize = 1000;

impl SceneSpec {
    /// Draws the scene of one episode: a pure function of the spec and the seed.
    #[must_use]
    pub fn draw(&self, episode_seed: u64) -> Scene {
        let stream = |name: &str| Stream::new(episode_seed, name);
        let mut specs = Cow::Borrowed(&self.bodies);
        let ranges = self.sizes.as_ref().map_or(&[][..], |sizes| sizes.ranges);
        let sizes: Vec<f64> = ranges.iter().map(|(name, range)| stream(name).uniform(*range)).collect();
        if let Some(spec) = &self.sizes {
            (spec.apply)(&sizes, specs.to_mut());
        }
        let mut bodies: Vec<Body> = specs.iter().map(|spec| draw_body(spec, episode_seed)).collect();
        self.place(&specs, &mut bodies, episode_seed);
        for (idx, spec) in specs.iter().enumerate() {
            match &spec.placement {
                PlacementSpec::OnSurface { .. } => {}
                PlacementSpec::Beside { body, x_m, min_gap_m, surface_z_m, origin_z_m } => {
                    let heights = [*surface_z_m, *origin_z_m];
                    place_beside(idx, *body, *x_m, *min_gap_m, heights, &mut bodies);
                }
                PlacementSpec::Over { body, origin_z_m, surface_z_m } => {
                    place_over(idx, *body, *origin_z_m, *surface_z_m, &mut bodies);
                }
                PlacementSpec::RelativeTo { body, pose } => {
                    bodies[idx].pose = bodies[*body].pose * scale_translation(pose, &bodies[*body].scale);
                }
            }
        }
        let robots = self.robots.iter().enumerate();
        let robots: Vec<Robot> = robots.map(|(arm, spec)| draw_robot(arm, spec, episode_seed)).collect();
        bodies.extend(distractors::draw(&self.distractors, &bodies, &robots, &self.cameras, episode_seed));
        Scene {
            physics_hz: self.physics_hz,
            bodies,
            robots,
            table: appearance::table(&self.table, episode_seed),
            background: appearance::background(&self.background, episode_seed),
            lights: appearance::lights(&self.lights, episode_seed),
            cameras: self.cameras.iter().map(|spec| draw_camera(spec, episode_seed)).collect(),
            instruction: self.instruction.draw(episode_seed),
            sizes,
        }
    }

    /// Sets the poses of all bodies that are placed in regions, again and again until no two of them are
    /// closer than the minimum gap.
    fn place(&self, specs: &[BodySpec], bodies: &mut [Body], episode_seed: u64) {
        for attempt in 0..MAX_PLACEMENT_DRAWS {
            let seed = placement_seed(episode_seed, attempt);
            let mut placed = Vec::new();
            for (region_idx, region) in self.regions.iter().enumerate() {
                place_region(region_idx, region, specs, bodies, &mut placed, seed);
            }
            if self.min_start_gap_m.is_none_or(|gap_m| keep_gap(specs, bodies, gap_m)) {
                break;
            }
        }
    }
}

/// Returns `true` if the bounding boxes of any two bodies placed in regions are at least `gap_m` apart.
fn keep_gap(specs: &[BodySpec], bodies: &[Body], gap_m: f64) -> bool {
    let in_region =
        |(spec, _): &(&BodySpec, &Body)| matches!(spec.placement, PlacementSpec::OnSurface { .. });
    let boxes: Vec<Aabb> =
        specs.iter().zip(bodies).filter(in_region).map(|(_, body)| body.aabb(&body.pose)).collect();
    let apart = |a: &Aabb, b: &Aabb| (a.min - b.max).sup(&(b.min - a.max)).max() >= gap_m;
    boxes.iter().enumerate().all(|(i, a)| boxes[..i].iter().all(|b| apart(a, b)))
}

fn draw_robot(arm: usize, spec: &RobotSpec, episode_seed: u64) -> Robot {
    let mut noise = Stream::new(episode_seed, &format!("arm{}/noise", arm + 1));
    let qpos = core::array::from_fn(|joint| {
        let q = spec.qpos[joint] + spec.noise_rad * noise.normal();
        q.clamp(LOWER[joint], UPPER[joint])
    });
    Robot { base: spec.base, qpos }
}

/// Draws the scale of a body: one factor for all axes, or one for each.
fn draw_scale(spec: &BodySpec, episode_seed: u64) -> Vector3<f64> {
    let mut stream = Stream::new(episode_seed, &format!("{}/scale", spec.name));
    let first = stream.uniform(spec.scale);
    match spec.scale_axes {
        ScaleAxes::Together => Vector3::repeat(first),
        ScaleAxes::Independent => Vector3::new(first, stream.uniform(spec.scale), stream.uniform(spec.scale)),
    }
}

fn draw_body(spec: &BodySpec, episode_seed: u64) -> Body {
    let name = spec.name;
    let scale = draw_scale(spec, episode_seed);
    let painter = Painter { name, render_parts: spec.render_parts, episode_seed };
    Body {
        name,
        role: spec.role,
        motion: scale_motion(spec.motion, &scale),
        parts: draw_parts(&painter, &spec.parts, &scale),
        visuals: draw_visuals(&painter, &spec.visuals, &scale),
        scale,
        pose: Isometry3::identity(),
        drop_m: 0.0,
        mass: spec.mass.stretched(&scale),
        friction: spec.friction,
        damping: spec.damping,
    }
}

/// Scales the travel of a slide joint with its body. The range of a hinge joint does not depend on the scale.
fn scale_motion(motion: Motion, scale: &Vector3<f64>) -> Motion {
    match motion {
        Motion::Jointed(joint) if joint.kind == JointKind::Slide => {
            let along = Vector3::from(joint.axis).component_mul(scale).norm();
            Motion::Jointed(JointSpec { upper: joint.upper * along, ..joint })
        }
        other => other,
    }
}

/// Sets the pose of every body of a region.
///
/// Yaw and position have separate streams. The position is resampled while the body is too close to a body
/// that has already been placed. `placed` contains the world xy centres and footprint radii of those bodies,
/// in m.
fn place_region(
    region_idx: usize,
    region: &RegionSpec,
    specs: &[BodySpec],
    bodies: &mut [Body],
    placed: &mut Vec<([f64; 2], f64)>,
    episode_seed: u64,
) {
    let mut common = Stream::new(episode_seed, &format!("{}/common", region.name));
    let offset = region.shared_offset.map(|range| common.uniform(range));
    let mirrored =
        region.random_mirror && Stream::new(episode_seed, &format!("{}/side", region.name)).unit() < 0.5;
    let side = if mirrored { -1.0 } else { 1.0 };
    for (spec, body) in specs.iter().zip(bodies) {
        let PlacementSpec::OnSurface { region: of, surface_z_m, origin_z_m, orientation, yaw } =
            spec.placement
        else {
            continue;
        };
        if of != region_idx {
            continue;
        }
        let yaw = Stream::new(episode_seed, &format!("{}/yaw", spec.name)).uniform(yaw);
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * orientation;
        let aabb = body.aabb(&Isometry3::from_parts(Translation3::identity(), rotation));
        let radius = footprint_radius(body, orientation);
        let mut stream = Stream::new(episode_seed, &format!("{}/pose", spec.name));
        let mut draw = || {
            let [x, y] = [region.x, region.y].map(|range| stream.uniform(range));
            [x + offset[0], side * (y + offset[1])]
        };
        let mut xy = draw();
        if let Some(min_gap_m) = region.min_gap_m {
            let is_clear = |xy: [f64; 2]| {
                placed.iter().all(|(other, r)| {
                    libm::hypot(xy[0] - other[0], xy[1] - other[1]) > radius + r + min_gap_m
                })
            };
            let mut draws = 1;
            while !is_clear(xy) && draws < MAX_PLACEMENT_DRAWS {
                xy = draw();
                draws += 1;
            }
        }
        placed.push((xy, radius));
        let resting_z = surface_z_m - aabb.min.z;
        let z = origin_z_m.map_or(resting_z, |z| z.max(resting_z));
        body.pose = Isometry3::from_parts(Translation3::new(xy[0], xy[1], z), rotation);
        body.drop_m = if spec.motion == Motion::Dynamic { z - resting_z } else { 0.0 };
    }
}

/// Sets the pose of body `idx` beside body `neighbour`. `heights` are those of the surface and of the origin
/// at the start, in m. See [`PlacementSpec::Beside`].
fn place_beside(
    idx: usize,
    neighbour: usize,
    x_m: f64,
    min_gap_m: Option<f64>,
    heights: [f64; 2],
    bodies: &mut [Body],
) {
    let [surface_z, origin_z] = heights;
    let own = bodies[idx].aabb(&Isometry3::identity());
    let neighbour = &bodies[neighbour];
    let clear_x = |gap_m| neighbour.aabb(&neighbour.pose).min.x - gap_m - own.max.x;
    let x_m = min_gap_m.map_or(x_m, |gap_m| x_m.min(clear_x(gap_m)));
    let resting_z = surface_z - own.min.z;
    let at = Translation3::new(x_m, neighbour.pose.translation.y, origin_z.max(resting_z));
    bodies[idx].drop_m = at.z - resting_z;
    bodies[idx].pose = Isometry3::from_parts(at, UnitQuaternion::identity());
}

/// Sets the pose of body `idx` above a surface of body `below`. See [`PlacementSpec::Over`].
fn place_over(idx: usize, below: usize, origin_z_m: f64, surface_z_m: f64, bodies: &mut [Body]) {
    let lowest = bodies[idx].aabb(&Isometry3::identity()).min.z;
    let surface = &bodies[below];
    let [touching_z, resting_z] = [&surface.pose, &surface.resting_pose()]
        .map(|pose| pose.translation.z + surface_z_m * surface.scale.z - lowest);
    let z = origin_z_m.max(touching_z);
    let at = Translation3::new(surface.pose.translation.x, surface.pose.translation.y, z);
    bodies[idx].pose = Isometry3::from_parts(at, UnitQuaternion::identity());
    bodies[idx].drop_m = z - resting_z;
}

/// Returns the radius of the circle about the body's origin that contains its footprint at any yaw, in m.
fn footprint_radius(body: &Body, orientation: UnitQuaternion<f64>) -> f64 {
    let aabb = body.aabb(&Isometry3::from_parts(Translation3::identity(), orientation));
    let half = aabb.min.abs().sup(&aabb.max.abs());
    libm::hypot(half.x, half.y)
}

fn draw_camera(spec: &CameraSpec, episode_seed: u64) -> Camera {
    let Jitter { translation, rotation } = spec.jitter;
    let mut stream = Stream::new(episode_seed, &format!("camera/{:?}", spec.slot));
    let [x, y, z] = translation.map(|range| stream.uniform(range));
    let [roll, pitch, yaw] = rotation.map(|range| stream.uniform(range));
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch)
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Camera {
        slot: spec.slot,
        mount: spec.mount.clone(),
        pose_error: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
        fov_y_rad: spec.fov_y_rad,
        clip_m: spec.clip_m,
    }
}
