//! Time-optimal parametrisation of one arm's path, from rest to rest.

use super::spline::Spline;
use super::timing::MotionLimits;
use scene::robot::kinematics::Joints;
use scene::robot::panda::N_JOINTS;

/// Number of intervals into which [`time_optimal`] divides a path.
const N_INTERVALS: usize = 128;
/// Maximum duration of a motion in s, longer than any episode. Near a singularity the speed may tend to zero.
const MAX_DURATION_S: f64 = 60.0;
/// Slope below which a joint's acceleration does not depend on the acceleration along the path.
const MIN_SLOPE: f64 = 1e-9;

/// Samples the fastest motion along a path about once every `dt` seconds. As in the original, the samples
/// include start and end, and their number is the duration divided by `dt`, rounded down: the motion is
/// executed slightly faster than it was planned. A motion that takes less than `dt` has no samples.
/// Returns `None` for one that takes longer than an episode.
///
/// The speeds follow from reachability analysis: Pham and Pham, "A New Approach to Time-Optimal Path
/// Parameterization Based on Reachability Analysis" (2018).
pub(crate) fn time_optimal(path: &Spline, limits: MotionLimits, dt: f64) -> Option<Vec<Joints>> {
    let grid = PathGrid::new(path, limits);
    let mut max_squares = vec![0.0; N_INTERVALS + 1];
    for i in (0..N_INTERVALS).rev() {
        max_squares[i] = grid.max_square_speed(i, max_squares[i + 1]);
    }
    // (time, speed) at the start of each interval, and the acceleration in it.
    let mut knots = vec![(0.0, 0.0)];
    let mut accelerations = Vec::with_capacity(N_INTERVALS);
    let mut square = 0.0_f64;
    for i in 0..N_INTERVALS {
        let [_, (acceleration, _)] = grid.acceleration_bounds(i, square, max_squares[i + 1]);
        let next = (square + 2.0 * grid.step * acceleration).clamp(0.0, max_squares[i + 1]);
        let (time, speed) = knots[i];
        let next_speed = next.sqrt();
        if speed + next_speed <= 0.0 {
            return None;
        }
        accelerations.push((next - square) / (2.0 * grid.step));
        knots.push((time + 2.0 * grid.step / (speed + next_speed), next_speed));
        square = next;
    }
    let (duration, _) = knots[N_INTERVALS];
    if duration > MAX_DURATION_S {
        return None;
    }
    let n_samples = (duration / dt) as usize;
    let mut i = 0;
    let samples = (0..n_samples)
        .map(|sample| {
            let time = duration * sample as f64 / (n_samples - 1).max(1) as f64;
            while i + 1 < N_INTERVALS && knots[i + 1].0 <= time {
                i += 1;
            }
            let (start, speed) = knots[i];
            let t = time - start;
            path.at(i as f64 * grid.step + speed * t + 0.5 * accelerations[i] * t * t)
        })
        .collect();
    Some(samples)
}

/// A path divided into equal intervals.
struct PathGrid {
    limits: MotionLimits,
    /// Length of an interval in the path's parameter.
    step: f64,
    /// First and second derivatives of the path at the interval boundaries.
    derivatives: Vec<[Joints; 2]>,
}

/// A bound on the acceleration along the path and its derivative with respect to the squared speed.
type AccelerationBound = (f64, f64);

impl PathGrid {
    fn new(path: &Spline, limits: MotionLimits) -> Self {
        let step = path.end() / N_INTERVALS as f64;
        let derivatives = (0..=N_INTERVALS).map(|i| path.derivatives(i as f64 * step)).collect();
        Self { limits, step, derivatives }
    }

    /// Returns the maximum squared speed at the start of an interval from which a squared speed of at most
    /// `next_max` can be reached at its end.
    fn max_square_speed(&self, i: usize, next_max: f64) -> f64 {
        let [slope, _] = self.derivatives[i];
        let fastest = slope.amax().max(MIN_SLOPE);
        let mut square = (self.limits.speed / fastest) * (self.limits.speed / fastest);
        for [slope, bend] in self.acceleration_terms(i) {
            for joint in (0..N_JOINTS).filter(|joint| slope[*joint].abs() < MIN_SLOPE) {
                square = square.min(self.limits.acceleration / bend[joint].abs().max(1e-12));
            }
        }
        // The gap between the bounds is concave in the squared speed and not negative at zero, so that
        // Newton's method finds the end of the admissible range from above.
        for _ in 0..4 * N_JOINTS {
            let [(lower, lower_slope), (upper, upper_slope)] = self.acceleration_bounds(i, square, next_max);
            let (gap, gap_slope) = (upper - lower, upper_slope - lower_slope);
            if gap >= 0.0 || gap_slope >= 0.0 {
                break;
            }
            square = (square - gap / gap_slope).max(0.0);
        }
        square
    }

    /// Returns the lower and upper bound on the acceleration in an interval that starts with a squared speed
    /// and ends with one of at most `next_max`.
    fn acceleration_bounds(&self, i: usize, square: f64, next_max: f64) -> [AccelerationBound; 2] {
        let twice = 2.0 * self.step;
        let mut lower = (-square / twice, -1.0 / twice);
        let mut upper = ((next_max - square) / twice, -1.0 / twice);
        for [slope, bend] in self.acceleration_terms(i) {
            for joint in (0..N_JOINTS).filter(|joint| slope[*joint].abs() >= MIN_SLOPE) {
                let per_square = -bend[joint] / slope[joint];
                let reach = self.limits.acceleration / slope[joint].abs();
                let centre = per_square * square;
                if centre - reach > lower.0 {
                    lower = (centre - reach, per_square);
                }
                if centre + reach < upper.0 {
                    upper = (centre + reach, per_square);
                }
            }
        }
        [lower, upper]
    }

    /// Returns the coefficients of acceleration and squared speed in the joint accelerations at the start and
    /// at the end of an interval.
    fn acceleration_terms(&self, i: usize) -> [[Joints; 2]; 2] {
        let [slope, bend] = self.derivatives[i + 1];
        [self.derivatives[i], [slope + bend * (2.0 * self.step), bend]]
    }
}
