//! A closed interval: what a spec holds where a scene holds a number.

/// All values between `lo` and `hi`, both included; a fixed value has `lo == hi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Least value.
    pub lo: f64,
    /// Greatest value, not below `lo`.
    pub hi: f64,
}

impl Range {
    /// The interval from `lo` to `hi`.
    #[must_use]
    pub const fn new(lo: f64, hi: f64) -> Self {
        assert!(lo <= hi, "a range runs upwards");
        Self { lo, hi }
    }

    /// The interval that holds only `value`.
    #[must_use]
    pub const fn fixed(value: f64) -> Self {
        Self { lo: value, hi: value }
    }

    /// The interval from `-half` to `half`.
    #[must_use]
    pub const fn symmetric(half: f64) -> Self {
        Self::new(-half, half)
    }

    /// The point at fraction `unit` of the way from `lo` to `hi`.
    #[must_use]
    pub fn at(self, unit: f64) -> f64 {
        self.lo + (self.hi - self.lo) * unit
    }

    /// Whether `value` lies in the interval.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        (self.lo..=self.hi).contains(&value)
    }
}
