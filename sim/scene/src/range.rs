//! Closed intervals, which a scene spec has where a scene has a number.

/// The closed interval [`lo`, `hi`]. A constant has `lo == hi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower bound, included.
    pub lo: f64,
    /// Upper bound, included and not below `lo`.
    pub hi: f64,
}

impl Range {
    /// Creates the interval from `lo` to `hi`.
    ///
    /// # Panics
    /// If `lo > hi`.
    #[must_use]
    pub const fn new(lo: f64, hi: f64) -> Self {
        assert!(lo <= hi, "the lower bound of a range must not exceed the upper bound");
        Self { lo, hi }
    }

    /// Creates the interval that contains only `value`.
    #[must_use]
    pub const fn fixed(value: f64) -> Self {
        Self { lo: value, hi: value }
    }

    /// Creates the interval from `-half` to `half`.
    #[must_use]
    pub const fn symmetric(half: f64) -> Self {
        Self::new(-half, half)
    }

    /// Interpolates linearly from `lo` (`t` = 0) to `hi` (`t` = 1).
    #[must_use]
    pub fn lerp(self, t: f64) -> f64 {
        self.lo + (self.hi - self.lo) * t
    }

    /// Shrinks the interval towards `nominal`: the full interval at strength 1, only `nominal` at strength 0.
    #[must_use]
    pub fn shrunk_to(self, nominal: f64, strength: f64) -> Self {
        self.blended_from(Self::fixed(nominal), strength)
    }

    /// Interpolates both bounds from those of `nominal` (strength 0) to those of this interval (strength 1).
    /// Both ends are exact.
    #[must_use]
    pub fn blended_from(self, nominal: Self, strength: f64) -> Self {
        let bound = |from: f64, to: f64| from * (1.0 - strength) + to * strength;
        Self::new(bound(nominal.lo, self.lo), bound(nominal.hi, self.hi))
    }

    /// Scales the width of the interval by `factor` about its midpoint.
    #[must_use]
    pub fn widened(self, factor: f64) -> Self {
        let (middle, half) = (f64::midpoint(self.lo, self.hi), (self.hi - self.lo) / 2.0);
        Self::new(middle - factor * half, middle + factor * half)
    }

    /// Returns `true` if `value` lies in the interval, bounds included.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        (self.lo..=self.hi).contains(&value)
    }
}
