//! Run-time dispatch: the same kernels compiled for several instruction sets, of which a renderer uses the
//! widest that the processor has.

#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};

#[cfg(target_arch = "x86_64")]
use super::{Avx2, Avx512};
use super::{Portable, Simd};

/// An instruction set. The variants hold pulp's capability tokens, which only run-time detection can create,
/// so a value of this type proves that the processor has the instruction set.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Isa {
    /// The baseline of the compilation target.
    Portable,
    /// AVX2 and FMA: eight f32 lanes per register.
    #[cfg(target_arch = "x86_64")]
    Avx2(V3),
    /// AVX-512 F, BW, DQ and VL: sixteen f32 lanes per register.
    #[cfg(target_arch = "x86_64")]
    Avx512(V4),
}

impl Isa {
    /// Returns the instruction sets of this processor, the narrowest first.
    pub(crate) fn available() -> Vec<Self> {
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            available.extend(V3::try_new().map(Self::Avx2));
            available.extend(V4::try_new().map(Self::Avx512));
        }
        available
    }

    /// Returns the name to display.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512",
        }
    }

    /// Runs a kernel compiled for this instruction set.
    pub(crate) fn run<K: Kernel>(self, kernel: K) {
        match self {
            Self::Portable => kernel.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the token proves x86-64-v3, which includes every feature that `avx2` enables.
            Self::Avx2(_) => unsafe { avx2(kernel) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the token proves x86-64-v4, which includes every feature that `avx512` enables.
            Self::Avx512(_) => unsafe { avx512(kernel) },
        }
    }
}

/// A piece of work that is compiled once per instruction set. `run` and every function it calls with vector
/// arguments must be `#[inline(always)]`: only what is inlined into the functions below is compiled for their
/// instruction sets.
pub(crate) trait Kernel {
    /// Executes the kernel.
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
