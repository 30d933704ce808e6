//! Cubic splines through joint positions.

use scene::robot::kinematics::Joints;

/// A twice continuously differentiable curve through points at the parameters 0, 1, 2, …, cubic between them,
/// with "not-a-knot" end conditions.
pub(crate) struct Spline {
    points: Vec<Joints>,
    /// Second derivatives at the points.
    curvatures: Vec<Joints>,
}

impl Spline {
    /// Returns the spline through `points`.
    ///
    /// # Panics
    /// If there are fewer than two.
    pub(crate) fn through(points: Vec<Joints>) -> Self {
        assert!(points.len() >= 2, "a path has a start and an end");
        let last = points.len() - 1;
        let bend = |i: usize| points[i - 1] - points[i] * 2.0 + points[i + 1];
        let mut curvatures = vec![Joints::zeros(); points.len()];
        if last == 2 {
            curvatures.fill(bend(1));
        } else if last > 2 {
            // The end conditions decouple the two outermost inner points. Gaussian elimination solves the
            // rest, in which row i reads c[i − 1] + 4 c[i] + c[i + 1] = 6 bend(i).
            (curvatures[1], curvatures[last - 1]) = (bend(1), bend(last - 1));
            let mut pivots = vec![1.0; points.len()];
            for i in 2..last - 1 {
                let factor = if i == 2 { 0.0 } else { 1.0 / pivots[i - 1] };
                pivots[i] = 4.0 - factor;
                let before = if i == 2 { curvatures[1] } else { curvatures[i - 1] * factor };
                curvatures[i] = bend(i) * 6.0 - before;
            }
            for i in (2..last - 1).rev() {
                curvatures[i] = (curvatures[i] - curvatures[i + 1]) / pivots[i];
            }
            curvatures[0] = curvatures[1] * 2.0 - curvatures[2];
            curvatures[last] = curvatures[last - 1] * 2.0 - curvatures[last - 2];
        }
        Self { points, curvatures }
    }

    /// Returns the parameter of the end.
    pub(crate) fn end(&self) -> f64 {
        (self.points.len() - 1) as f64
    }

    /// Returns the point at a parameter.
    pub(crate) fn at(&self, s: f64) -> Joints {
        let (i, t) = self.segment(s);
        let r = 1.0 - t;
        self.points[i] * r
            + self.points[i + 1] * t
            + (self.curvatures[i] * (r * r * r - r) + self.curvatures[i + 1] * (t * t * t - t)) / 6.0
    }

    /// Returns the first and second derivatives at a parameter.
    pub(crate) fn derivatives(&self, s: f64) -> [Joints; 2] {
        let (i, t) = self.segment(s);
        let r = 1.0 - t;
        let [from, to] = [self.curvatures[i], self.curvatures[i + 1]];
        let slope = self.points[i + 1] - self.points[i]
            + (to * (3.0 * t * t - 1.0) - from * (3.0 * r * r - 1.0)) / 6.0;
        [slope, from * r + to * t]
    }

    /// Returns the segment that contains a parameter, and the position in it.
    fn segment(&self, s: f64) -> (usize, f64) {
        let segment = (s.max(0.0) as usize).min(self.points.len() - 2);
        (segment, s - segment as f64)
    }
}
