//! The numbers a network was trained on, from those of an observation, and back.

/// `normalised = (x − shift) / scale`, entry by entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Affine {
    /// `[n]`.
    pub shift: Vec<f32>,
    /// `[n]`, nowhere zero.
    pub scale: Vec<f32>,
}

/// What a network's inputs and outputs go through. `None` leaves numbers as they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Normalisation {
    /// For each camera, over its three channels in [0, 1].
    pub images: Vec<Option<Affine>>,
    /// Over the state.
    pub state: Option<Affine>,
    /// Over the embedding of an instruction.
    pub instruction: Option<Affine>,
    /// Over an action row; used backwards.
    pub action: Option<Affine>,
}

impl Affine {
    /// ImageNet's channel means and standard deviations (spec/eval.md §1.2).
    #[must_use]
    pub fn image_net() -> Self {
        Self { shift: vec![0.485, 0.456, 0.406], scale: vec![0.229, 0.224, 0.225] }
    }

    /// Normalises `x [n]` in place.
    pub fn normalise(&self, x: &mut [f32]) {
        assert_eq!(x.len(), self.shift.len(), "numbers to normalise");
        for ((x, shift), scale) in x.iter_mut().zip(&self.shift).zip(&self.scale) {
            *x = (*x - shift) / scale;
        }
    }

    /// Undoes it for every row of `x [T, n]`, in place.
    pub fn restore(&self, x: &mut [f32]) {
        for row in x.chunks_exact_mut(self.shift.len()) {
            for ((x, shift), scale) in row.iter_mut().zip(&self.shift).zip(&self.scale) {
                *x = *x * scale + shift;
            }
        }
    }
}
