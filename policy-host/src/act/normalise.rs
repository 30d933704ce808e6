//! Normalisation of network inputs, and its inverse for actions.

/// Element-wise normalisation `(x − shift) / scale`.
#[derive(Clone, Debug, PartialEq)]
pub struct ShiftScale {
    /// Shift `[n]`, for example the mean.
    pub shift: Vec<f32>,
    /// Scale `[n]`, for example the standard deviation. Never zero.
    pub scale: Vec<f32>,
}

/// Normalisation of all inputs and outputs of a network. `None` means identity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Normalisation {
    /// Per camera, over its three channels, whose values are in [0, 1].
    pub images: Vec<Option<ShiftScale>>,
    /// Over the state vector.
    pub state: Option<ShiftScale>,
    /// Over the instruction embedding.
    pub instruction: Option<ShiftScale>,
    /// Over an action; the policy applies its inverse.
    pub action: Option<ShiftScale>,
}

impl ShiftScale {
    /// Returns ImageNet's channel means and standard deviations, as torchvision defines them.
    #[must_use]
    pub fn image_net() -> Self {
        Self { shift: vec![0.485, 0.456, 0.406], scale: vec![0.229, 0.224, 0.225] }
    }

    /// Normalises `x [n]` in place.
    pub fn normalise(&self, x: &mut [f32]) {
        assert_eq!(x.len(), self.shift.len(), "entries to normalise");
        for ((x, shift), scale) in x.iter_mut().zip(&self.shift).zip(&self.scale) {
            *x = (*x - shift) / scale;
        }
    }

    /// Applies the inverse to every row of `x [t, n]` in place.
    pub fn restore(&self, x: &mut [f32]) {
        for row in x.chunks_exact_mut(self.shift.len()) {
            for ((x, shift), scale) in row.iter_mut().zip(&self.shift).zip(&self.scale) {
                *x = *x * scale + shift;
            }
        }
    }
}
