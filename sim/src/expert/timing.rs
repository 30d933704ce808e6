//! Time along a path of joint positions: from rest to rest under caps of speed and acceleration.

use super::plan::Config;

/// Caps on every joint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Caps {
    /// rad/s.
    pub(super) speed: f64,
    /// rad/s².
    pub(super) acceleration: f64,
}

/// The path sampled once per control step, its start left out and its end included. Its length is measured by the joint
/// that moves most between waypoints, so that no joint is faster than a trapezoidal profile along it.
pub(super) fn sample(path: &[Config], caps: Caps, dt: f64) -> Vec<Config> {
    let mut lengths = vec![0.0];
    for pair in path.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + pair[0].distance(&pair[1]));
    }
    let total = lengths[lengths.len() - 1];
    let profile = Trapezoid::new(total, caps);
    let n_steps = (profile.duration / dt).ceil();
    // The last sample falls on the end: the profile is slowed by less than one step.
    let mut segment = 0;
    (1..=n_steps as usize)
        .map(|step| {
            let length = profile.at(profile.duration * step as f64 / n_steps);
            while segment + 2 < path.len() && lengths[segment + 1] < length {
                segment += 1;
            }
            let span = lengths[segment + 1] - lengths[segment];
            let part = if span > 0.0 { ((length - lengths[segment]) / span).clamp(0.0, 1.0) } else { 1.0 };
            path[segment].towards(&path[segment + 1], part)
        })
        .collect()
}

/// Speed rises evenly, stays, and falls evenly; without a plateau when the way is short.
struct Trapezoid {
    length: f64,
    ramp: f64,
    acceleration: f64,
    duration: f64,
}

impl Trapezoid {
    fn new(length: f64, Caps { speed, acceleration }: Caps) -> Self {
        let ramp = (speed / acceleration).min((length / acceleration).sqrt());
        let duration = if ramp > 0.0 { ramp + length / (acceleration * ramp) } else { 0.0 };
        Self { length, ramp, acceleration, duration }
    }

    /// Length covered after `time`.
    fn at(&self, time: f64) -> f64 {
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
