//! Time parametrisation of joint-space paths: from rest to rest, under speed and acceleration limits.

use scene::robot::kinematics::Joints;

/// A robot configuration: the joint positions of all arms, in rad.
#[derive(Clone, Debug)]
pub(crate) struct Configuration(pub(crate) Vec<Joints>);

impl Configuration {
    /// Returns the maximum difference of any joint to `other`, in rad.
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max)
    }

    /// Interpolates linearly in joint space: `t` = 0 is `self`, 1 is `other`.
    pub(crate) fn lerp(&self, other: &Self, t: f64) -> Self {
        Self(self.0.iter().zip(&other.0).map(|(a, b)| a.lerp(b, t)).collect())
    }
}

/// Limits on every joint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MotionLimits {
    /// Maximum speed in rad/s.
    pub(crate) speed: f64,
    /// Maximum acceleration in rad/s².
    pub(crate) acceleration: f64,
}

/// Samples a path once per control step of `dt` seconds, excluding its start and including its end. The
/// length of a segment is the largest displacement of any joint, so that no joint exceeds the trapezoidal
/// velocity profile along the path.
pub(crate) fn time_parametrise(path: &[Configuration], limits: MotionLimits, dt: f64) -> Vec<Configuration> {
    let mut lengths = vec![0.0];
    for pair in path.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + pair[0].distance(&pair[1]));
    }
    let total = lengths[lengths.len() - 1];
    let profile = TrapezoidalProfile::new(total, limits);
    let n_steps = (profile.duration / dt).ceil();
    // The profile is stretched by less than one step, so that the last sample is the end of the
    // path.
    let mut segment = 0;
    (1..=n_steps as usize)
        .map(|step| {
            let length = profile.length_at(profile.duration * step as f64 / n_steps);
            while segment + 2 < path.len() && lengths[segment + 1] < length {
                segment += 1;
            }
            let span = lengths[segment + 1] - lengths[segment];
            let t = if span > 0.0 { ((length - lengths[segment]) / span).clamp(0.0, 1.0) } else { 1.0 };
            path[segment].lerp(&path[segment + 1], t)
        })
        .collect()
}

/// A trapezoidal velocity profile; triangular if the path is too short to reach the maximum speed.
struct TrapezoidalProfile {
    length: f64,
    ramp: f64,
    acceleration: f64,
    duration: f64,
}

impl TrapezoidalProfile {
    fn new(length: f64, MotionLimits { speed, acceleration }: MotionLimits) -> Self {
        let ramp = (speed / acceleration).min((length / acceleration).sqrt());
        let duration = if ramp > 0.0 { ramp + length / (acceleration * ramp) } else { 0.0 };
        Self { length, ramp, acceleration, duration }
    }

    /// Returns the path length covered after `time` seconds.
    fn length_at(&self, time: f64) -> f64 {
        let ramped = |t: f64| 0.5 * self.acceleration * t * t;
        let left = self.duration - time;
        if time < self.ramp {
            ramped(time)
        } else if left < self.ramp {
            self.length - ramped(left.max(0.0))
        } else {
            ramped(self.ramp) + self.acceleration * self.ramp * (time - self.ramp)
        }
    }
}
