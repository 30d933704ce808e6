//! Scaling of images, states and actions, as a checkpoint stores it, and its inverse for actions.

/// Element-wise normalisation `(x − shift) / scale + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct ShiftScale {
    /// Shift `[n]`, for example the mean.
    pub shift: Vec<f32>,
    /// Scale `[n]`, for example the standard deviation. Never zero.
    pub scale: Vec<f32>,
    /// Offset `[n]`: zero, but −1 for an entry whose statistics leave it no range. Next to its shift, the
    /// scale of such an entry vanishes in rounding.
    pub offset: Vec<f32>,
}

impl ShiftScale {
    /// Returns the normalisation `(x − shift) / scale`.
    #[must_use]
    pub fn new(shift: Vec<f32>, scale: Vec<f32>) -> Self {
        let offset = vec![0.0; shift.len()];
        Self { shift, scale, offset }
    }

    /// Returns ImageNet's channel means and standard deviations, as torchvision defines them.
    #[must_use]
    pub fn image_net() -> Self {
        Self::new(vec![0.485, 0.456, 0.406], vec![0.229, 0.224, 0.225])
    }

    /// Normalises `x [n]` in place.
    pub fn normalise(&self, x: &mut [f32]) {
        assert_eq!(x.len(), self.shift.len(), "entries to normalise");
        for (x, (shift, scale, offset)) in x.iter_mut().zip(self.entries()) {
            *x = (*x - shift) / scale + offset;
        }
    }

    /// Applies the inverse to every row of `x [t, n]` in place.
    pub fn restore(&self, x: &mut [f32]) {
        for row in x.chunks_exact_mut(self.shift.len()) {
            for (x, (shift, scale, offset)) in row.iter_mut().zip(self.entries()) {
                *x = (*x - offset) * scale + shift;
            }
        }
    }

    /// Returns the shift, scale and offset of each entry.
    fn entries(&self) -> impl Iterator<Item = (f32, f32, f32)> {
        let pairs = self.shift.iter().zip(&self.scale).zip(&self.offset);
        pairs.map(|((&shift, &scale), &offset)| (shift, scale, offset))
    }
}

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
