//! Rotary position embedding (Su et al., RoFormer, 2021): queries and keys are rotated by angles proportional
//! to their position, so that their products depend on distances.

/// Sines and cosines of all angles up to a number of positions.
#[derive(Clone, Debug)]
pub struct Rotary {
    /// `[positions, head_width / 2]`.
    cosines: Vec<f32>,
    /// `[positions, head_width / 2]`.
    sines: Vec<f32>,
    head_width: usize,
}

impl Rotary {
    /// Base of the angular frequencies in Gemma: entry `i` rotates by `BASE^(−2i / head_width)` per position.
    pub const BASE: f32 = 10_000.0;

    /// Computes the angles of `n_positions` positions for heads of this width.
    ///
    /// # Panics
    /// If the width is odd.
    #[must_use]
    pub fn new(head_width: usize, n_positions: usize) -> Self {
        assert!(head_width.is_multiple_of(2), "a head of width {head_width}");
        let frequencies: Vec<f32> = (0..head_width / 2)
            .map(|idx| 1.0 / libm::powf(Self::BASE, 2.0 * idx as f32 / head_width as f32))
            .collect();
        let angles = (0..n_positions).flat_map(|position| {
            // The angle is rounded to f32, as in the original.
            frequencies.iter().map(move |frequency| f64::from(position as f32 * frequency))
        });
        Self {
            cosines: angles.clone().map(|angle| libm::cos(angle) as f32).collect(),
            sines: angles.map(|angle| libm::sin(angle) as f32).collect(),
            head_width,
        }
    }

    /// Returns cosine and sine of every angle, `[positions, head_width / 2]`.
    #[must_use]
    pub fn angles(&self) -> Vec<[f32; 2]> {
        self.cosines.iter().zip(&self.sines).map(|(cos, sin)| [*cos, *sin]).collect()
    }

    /// Rotates every head of `row [heads, head_width]`, a query or key at `position`, in place. Entry `i` of
    /// the first half of a head and entry `i` of the second half are the two coordinates of a point.
    ///
    /// # Panics
    /// If the position is out of range.
    pub fn apply(&self, row: &mut [f32], position: usize) {
        let half = self.head_width / 2;
        let cosines = &self.cosines[position * half..][..half];
        let sines = &self.sines[position * half..][..half];
        for head in row.chunks_exact_mut(self.head_width) {
            let (first, second) = head.split_at_mut(half);
            for (((a, b), cos), sin) in first.iter_mut().zip(second).zip(cosines).zip(sines) {
                (*a, *b) = (*a * cos - *b * sin, *b * cos + *a * sin);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_depend_on_distance_alone() {
        let rotary = Rotary::new(8, 64);
        let product = |from: usize, to: usize| {
            let mut query = [0.3, -1.2, 0.7, 0.1, 0.9, 0.4, -0.6, 1.1];
            let mut key = [0.5, 0.2, -0.4, 1.3, -0.8, 0.6, 0.1, -0.2];
            rotary.apply(&mut query, from);
            rotary.apply(&mut key, to);
            query.iter().zip(key).map(|(a, b)| a * b).sum::<f32>()
        };
        assert!((product(3, 10) - product(50, 57)).abs() < 1e-5);
        assert!((product(3, 10) - product(3, 11)).abs() > 1e-2);
    }
}
