//! Scaling of states and actions, in LeRobot's order of operations: the bins of the prompt depend on the last
//! bit.

/// Element-wise scaling of a vector with `n` entries.
#[derive(Clone, Debug, PartialEq)]
pub enum Scaling {
    /// Leaves values unchanged.
    Identity,
    /// Maps a range to [−1, 1].
    Range {
        /// Lower ends `[n]`.
        low: Vec<f32>,
        /// Widths `[n]`, never zero.
        width: Vec<f32>,
    },
    /// Maps to mean 0 and standard deviation 1.
    MeanStd {
        /// Means `[n]`.
        mean: Vec<f32>,
        /// Standard deviations `[n]`.
        std: Vec<f32>,
        /// Term added to a standard deviation by which inputs are divided.
        epsilon: f32,
    },
}

impl Scaling {
    /// Scales `x [n]` in place.
    pub fn normalise(&self, x: &mut [f32]) {
        match self {
            Self::Identity => {}
            Self::Range { low, width } => {
                for ((x, low), width) in x.iter_mut().zip(low).zip(width) {
                    *x = 2.0 * (*x - low) / width - 1.0;
                }
            }
            Self::MeanStd { mean, std, epsilon } => {
                for ((x, mean), std) in x.iter_mut().zip(mean).zip(std) {
                    *x = (*x - mean) / (std + epsilon);
                }
            }
        }
    }

    /// Applies the inverse to `x [n]` in place.
    pub fn restore(&self, x: &mut [f32]) {
        match self {
            Self::Identity => {}
            Self::Range { low, width } => {
                for ((x, low), width) in x.iter_mut().zip(low).zip(width) {
                    *x = (*x + 1.0) * width / 2.0 + low;
                }
            }
            Self::MeanStd { mean, std, .. } => {
                for ((x, mean), std) in x.iter_mut().zip(mean).zip(std) {
                    *x = *x * std + mean;
                }
            }
        }
    }
}
