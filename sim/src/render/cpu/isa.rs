//! The same code compiled for several instruction sets, the widest the processor has chosen once at the start.
//!
//! (Plain loops compiled for AVX-512 were measured slower than for AVX2: gathers and 64-bit products replace cheap scalar
//! code.) No path may change a byte: all of them do the same IEEE operations in the same order, and the compiler never fuses a
//! multiplication with an addition.

use super::Scratch;
use crate::render::View;
use crate::render::srgb::Encoder;

/// An instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Isa {
    /// What every processor of the compiled-for family has.
    Portable,
    /// Eight numbers at a time.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Isa {
    /// Those that this processor has, the narrowest first.
    pub(super) fn available() -> Vec<Self> {
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            available.push(Self::Avx2);
        }
        available
    }

    /// Name for people.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
        }
    }

    /// Makes one picture.
    pub(super) fn render(self, scratch: &mut Scratch, view: &mut View<'_>, encoder: &Encoder) {
        match self {
            Self::Portable => scratch.render(view, encoder),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `available` lists this instruction set only where the processor has it.
            Self::Avx2 => unsafe { avx2(scratch, view, encoder) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(scratch: &mut Scratch, view: &mut View<'_>, encoder: &Encoder) {
    scratch.render(view, encoder);
}
