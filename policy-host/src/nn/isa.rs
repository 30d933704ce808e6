//! Instruction sets, each proven by a token that only run-time detection can create (crate `pulp`).
//!
//! A kernel compiled for an instruction set is called only where its token is at hand. No kernel fuses a
//! product and a sum except where it says so, and Rust never does by itself, so the vector width does not
//! change a bit.

#[cfg(target_arch = "x86_64")]
pub(crate) use pulp::x86::{V3, V4};

#[cfg(target_arch = "x86_64")]
pulp::simd_type! {
    /// AVX-512 with the VNNI instructions for dot products of 8-bit integers.
    pub(crate) struct Avx512Vnni {
        avx512f: "avx512f",
        avx512vnni: "avx512vnni",
    }
}

/// Instruction set of the f32 GEMM.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FloatIsa {
    /// Portable code without fused multiply-add.
    Portable,
    /// AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Fma256(V3),
    /// AVX-512 with 512-bit registers.
    #[cfg(target_arch = "x86_64")]
    Fma512(V4),
}

/// Instruction set of the 8-bit GEMM.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Int8Isa {
    /// Portable code, slower than f32.
    Portable,
    /// AVX-512 with VNNI.
    #[cfg(target_arch = "x86_64")]
    Vnni(Avx512Vnni),
}

impl FloatIsa {
    /// Returns the instruction sets of this processor, slowest first.
    pub(crate) fn available() -> Vec<Self> {
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            available.extend(V3::try_new().map(Self::Fma256));
            available.extend(V4::try_new().map(Self::Fma512));
        }
        available
    }

    /// Returns the fastest instruction set of this processor.
    pub(crate) fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Portable)
    }
}

impl Int8Isa {
    /// Returns the instruction sets of this processor, slowest first.
    pub(crate) fn available() -> Vec<Self> {
        let mut available = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        available.extend(Avx512Vnni::try_new().map(Self::Vnni));
        available
    }

    /// Returns the fastest instruction set of this processor.
    pub(crate) fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Portable)
    }
}

/// Defines functions that are compiled twice, for the baseline x86-64 and for AVX2, and dispatch at run time.
/// Functions that they call must be `#[inline(always)]` to be compiled for AVX2 as well.
macro_rules! multiversion {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) $body:block)+) => {$(
        $(#[$meta])*
        $vis fn $name($($arg: $type),*) {
            #[inline(always)]
            fn baseline($($arg: $type),*) $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) {
                    baseline($($arg),*);
                }
                if let Some(_avx2) = $crate::nn::isa::V3::try_new() {
                    // SAFETY: the token proves AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            baseline($($arg),*);
        }
    )+};
}

pub(crate) use multiversion;
