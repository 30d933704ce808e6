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

    /// The interval shrunk about `nominal`: this at strength 1, `nominal` alone at strength 0.
    #[must_use]
    pub fn about(self, nominal: f64, strength: f64) -> Self {
        self.towards(Self::fixed(nominal), strength)
    }

    /// The interval on the way from `nominal`, at strength 0, to this, at strength 1; both exactly.
    #[must_use]
    pub fn towards(self, nominal: Self, strength: f64) -> Self {
        let end = |from: f64, to: f64| from * (1.0 - strength) + to * strength;
        Self::new(end(nominal.lo, self.lo), end(nominal.hi, self.hi))
    }

    /// The interval with the same middle, its width times `factor`.
    #[must_use]
    pub fn widened(self, factor: f64) -> Self {
        let (middle, half) = (f64::midpoint(self.lo, self.hi), (self.hi - self.lo) / 2.0);
        Self::new(middle - factor * half, middle + factor * half)
    }

    /// Whether `value` lies in the interval.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        (self.lo..=self.hi).contains(&value)
    }
}
