//! The same code compiled for several instruction sets, the widest the processor has chosen once at the start.

#[cfg(target_arch = "x86_64")]
use super::{Avx2, Avx512};
use super::{Portable, Simd};

/// An instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::render::cpu) enum Isa {
    /// What every processor of the compiled-for family has.
    Portable,
    /// Eight numbers at a time.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Sixteen numbers at a time.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Isa {
    /// Those that this processor has, the narrowest first.
    pub(in crate::render::cpu) fn available() -> Vec<Self> {
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            let counts_bits = is_x86_feature_detected!("bmi1") && is_x86_feature_detected!("popcnt");
            if counts_bits && is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                available.push(Self::Avx2);
            }
            if available.contains(&Self::Avx2)
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                available.push(Self::Avx512);
            }
        }
        available
    }

    /// Name for people.
    pub(in crate::render::cpu) const fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "AVX-512",
        }
    }

    /// Does a piece of work with this instruction set.
    pub(in crate::render::cpu) fn run<K: Kernel>(self, kernel: K) {
        match self {
            Self::Portable => kernel.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `available` lists this instruction set only where the processor has it.
            Self::Avx2 => unsafe { avx2(kernel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `available` lists this instruction set only where the processor has it.
            Self::Avx512 => unsafe { avx512(kernel) },
        }
    }
}

/// A piece of work that is compiled once per instruction set. `run` and all that it calls with vectors is
/// `inline(always)`, for only what is inlined into the functions below is compiled for their instruction sets.
pub(in crate::render::cpu) trait Kernel {
    /// Does it.
    fn run<S: Simd>(self);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,popcnt")]
fn avx2<K: Kernel>(kernel: K) {
    kernel.run::<Avx2>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,popcnt")]
fn avx512<K: Kernel>(kernel: K) {
    kernel.run::<Avx512>();
}
