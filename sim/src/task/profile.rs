//! The differences between the two readings of the benchmark, [`Profile::Strict`] and [`Profile::Paper`].

pub use run_config::Profile;

use scene::{DistractorPlacement, Range};

/// The rules that depend on the profile. Each difference is one named method, so that no other file matches
/// on [`Profile`].
pub trait ProfileRules {
    /// Returns the range of the vertical camera jitter under Camera-Pose, in m: ±0.03, as on the other axes.
    /// In the released code both bounds are +0.03.
    fn camera_jitter_z(self) -> Range;

    /// Returns the placement of distractor objects: at rest, clear of everything. The released code drops
    /// them from the air wherever they fall, even onto the manipulated object or the hand.
    fn distractor_placement(self) -> DistractorPlacement;

    /// Returns `true` if bodies start clear of one another and of the arms, and at rest where a drop could
    /// end on another body. The released code draws every body from the whole of its region, so that
    /// bodies may start inside others.
    fn separates_starts(self) -> bool;

    /// Returns `true` if Pose-Randomization widens every range that is a single value. In the released code,
    /// rounding excludes two of them: the cabinet's y in OpenCabinet, and the pan's region in CookItemInPan.
    fn widens_all_points(self) -> bool;

    /// Returns `true` if a draw of Language-Paraphrase may be the training sentence, which most lists of the
    /// original contain.
    fn repeats_training_sentence(self) -> bool;

    /// Returns `true` if a body that has to rise by some height also succeeds by sinking as far, as in the
    /// released code.
    fn counts_sinking(self) -> bool;

    /// Returns `true` if the head of an inserted peg must be inside the box. In the released code any
    /// position behind the entry of the hole succeeds, if it is in line with the hole.
    fn bounds_insertion(self) -> bool;

    /// Returns `true` if a peg is upright by its third Euler angle alone, as in the released code: it may
    /// lean to the side, up to the limit on its height. Otherwise its axis must be vertical.
    fn judges_third_euler_angle(self) -> bool;

    /// Returns `true` if a rotated arrow has to point away from the world's x axis, as in the released code,
    /// whose Euler angle jumps there. Otherwise its rotation is measured from its own start.
    fn judges_absolute_yaw(self) -> bool;

    /// Returns the distance in m by which the needle's success region lies below the true centre of the ring;
    /// the released code misplaces it.
    fn ring_error_m(self) -> f64;

    /// Returns `true` if a can that fell off the table or stands on the lowest shelf counts as taken out, as
    /// in the released code.
    fn counts_anywhere_low(self) -> bool;

    /// Returns `true` if it suffices that the pan is near the stove and the apple near the pan, at any
    /// height, as in the released code. Otherwise the pan must stand on the stove and the apple lie in the
    /// pan.
    fn counts_near_misses(self) -> bool;

    /// Returns `true` if success thresholds follow the sampled size of an object. The released code keeps the
    /// nominal ones.
    fn scales_thresholds(self) -> bool;
}

impl ProfileRules for Profile {
    fn camera_jitter_z(self) -> Range {
        match self {
            Self::Strict => Range::symmetric(0.03),
            Self::Paper => Range::fixed(0.03),
        }
    }

    fn distractor_placement(self) -> DistractorPlacement {
        match self {
            Self::Strict => DistractorPlacement::Resting,
            Self::Paper => DistractorPlacement::Dropped,
        }
    }

    fn separates_starts(self) -> bool {
        matches!(self, Self::Strict)
    }

    fn widens_all_points(self) -> bool {
        matches!(self, Self::Strict)
    }

    fn repeats_training_sentence(self) -> bool {
        matches!(self, Self::Paper)
    }

    fn counts_sinking(self) -> bool {
        matches!(self, Self::Paper)
    }

    fn bounds_insertion(self) -> bool {
        matches!(self, Self::Strict)
    }

    fn judges_third_euler_angle(self) -> bool {
        matches!(self, Self::Paper)
    }

    fn judges_absolute_yaw(self) -> bool {
        matches!(self, Self::Paper)
    }

    fn ring_error_m(self) -> f64 {
        match self {
            Self::Strict => 0.0,
            Self::Paper => 0.015,
        }
    }

    fn counts_anywhere_low(self) -> bool {
        matches!(self, Self::Paper)
    }

    fn counts_near_misses(self) -> bool {
        matches!(self, Self::Paper)
    }

    fn scales_thresholds(self) -> bool {
        matches!(self, Self::Strict)
    }
}
