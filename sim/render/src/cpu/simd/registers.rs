//! Vectors made of registers: the operations that are one intrinsic per register on every instruction set.

/// Evaluates an expression of intrinsics.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: vectors of an instruction set exist only in code compiled for it, which runs only on
        // processors that have it (see `super::isa`).
        unsafe { $call }
    };
}

/// Implements an operator by a function of registers.
macro_rules! operator {
    ($type:ident [$n:tt], $trait:ident, $method:ident, $function:ident) => {
        impl core::ops::$trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(each!(k in $n => intrinsic!($function(self.0[k], other.0[k]))))
            }
        }
    };
}

/// Implements methods by functions of registers.
macro_rules! methods {
    ($n:tt: $($method:ident($($other:ident),*) -> $type:ident = $function:ident;)+) => {
        $(
            #[inline(always)]
            fn $method(self $(, $other: Self)*) -> $type {
                $type(each!(k in $n => intrinsic!($function(self.0[k] $(, $other.0[k])*))))
            }
        )+
    };
}

/// Declares the vector types of an instruction set and implements their traits, except [`super::Simd`].
///
/// The functions of registers that occur below are those of the calling module, which imports the intrinsics
/// under names without the width. `also` holds integer methods that override defaults.
macro_rules! vectors {
    (
        $isa:ident, $n:tt registers,
        $f:ident of $floats:ty, $i:ident of $ints:ty, $m:ident of $bools:ty,
        also { $($also:tt)* }
    ) => {
        /// Sixteen floats.
        #[derive(Clone, Copy)]
        pub(crate) struct $f([$floats; $n]);

        /// Sixteen integers.
        #[derive(Clone, Copy)]
        pub(crate) struct $i([$ints; $n]);

        /// Sixteen booleans.
        #[derive(Clone, Copy)]
        pub(crate) struct $m([$bools; $n]);

        /// Lanes of a register.
        const LANES: usize = N_LANES / $n;

        operator!($f[$n], Add, add, add_ps);
        operator!($f[$n], Sub, sub, sub_ps);
        operator!($f[$n], Mul, mul, mul_ps);
        operator!($f[$n], Div, div, div_ps);
        operator!($i[$n], Add, add, add_epi32);
        operator!($i[$n], Sub, sub, sub_epi32);
        operator!($i[$n], BitAnd, bitand, and_si);
        operator!($i[$n], BitOr, bitor, or_si);
        operator!($m[$n], BitAnd, bitand, and_mask);
        operator!($m[$n], BitOr, bitor, or_mask);

        impl FloatLike for $f {
            #[inline(always)]
            fn splat(x: f32) -> Self {
                Self(intrinsic!([set1_ps(x); $n]))
            }

            methods! { $n:
                mul_add(factor, term) -> Self = fmadd_ps;
                sqrt() -> Self = sqrt_ps;
                max(other) -> Self = max_ps;
                min(other) -> Self = min_ps;
            }
        }

        impl Broadcast<$isa> for $f {
            #[inline(always)]
            fn broadcast(self) -> Self {
                self
            }
        }

        impl SimdF32 for $f {
            type I = $i;
            type M = $m;

            #[inline(always)]
            fn load(from: &F32x16) -> Self {
                Self(each!(k in $n => intrinsic!(load_ps(from.0[k * LANES..].as_ptr()))))
            }

            #[inline(always)]
            fn load_i16(from: &I16x16) -> Self {
                Self(each!(k in $n => intrinsic!({
                    cvtepi32_ps(cvtepi16_epi32(load_half(from.0[k * LANES..].as_ptr().cast())))
                })))
            }

            #[inline(always)]
            fn store(self, to: &mut F32x16) {
                each!(k in $n => intrinsic!(store_ps(to.0[k * LANES..].as_mut_ptr(), self.0[k])));
            }

            #[inline(always)]
            fn select_or(self, mask: $m, other: Self) -> Self {
                Self(each!(k in $n => intrinsic!(blend_ps(other.0[k], self.0[k], mask.0[k]))))
            }

            methods! { $n:
                gt(other) -> $m = cmpgt_ps;
                round_to_i32() -> $i = cvtps_epi32;
                truncate_to_i32() -> $i = cvttps_epi32;
                bitcast_i32() -> $i = castps_si;
            }
        }

        impl SimdI32 for $i {
            type F = $f;
            type M = $m;

            #[inline(always)]
            fn splat(x: i32) -> Self {
                Self(intrinsic!([set1_epi32(x); $n]))
            }

            #[inline(always)]
            fn load(from: &I32x16) -> Self {
                Self(each!(k in $n => intrinsic!(load_si(from.0[k * LANES..].as_ptr().cast()))))
            }

            #[inline(always)]
            fn store(self, to: &mut I32x16) {
                each!(k in $n => intrinsic!(store_si(to.0[k * LANES..].as_mut_ptr().cast(), self.0[k])));
            }

            #[inline(always)]
            fn select_or(self, mask: $m, other: Self) -> Self {
                Self(each!(k in $n => intrinsic!(blend_epi32(other.0[k], self.0[k], mask.0[k]))))
            }

            #[inline(always)]
            fn shr_arithmetic<const BITS: u32>(self) -> Self {
                self.shr_arithmetic_by(BITS)
            }

            shift! { $n: shl<BITS>() = sll_epi32 }
            shift! { $n: shr_logical<BITS>() = srl_epi32 }
            shift! { $n: shr_logical_u16<BITS>() = srl_epi16 }
            shift! { $n: shr_arithmetic_by(bits) = sra_epi32 }

            methods! { $n:
                mul(other) -> Self = mullo_epi32;
                mul_i16(other) -> Self = mullo_epi16;
                dot_i16(other) -> Self = madd_epi16;
                max(other) -> Self = max_epi32;
                min(other) -> Self = min_epi32;
                gt(other) -> $m = cmpgt_epi32;
                eq(other) -> $m = cmpeq_epi32;
                to_f32() -> $f = cvtepi32_ps;
                bitcast_f32() -> $f = castsi_ps;
            }

            $($also)*
        }

        impl SimdMask for $m {
            #[inline(always)]
            fn to_bits(self) -> u16 {
                let bits = each!(k in $n => intrinsic!(mask_to_bits(self.0[k])) << (k * LANES));
                bits.into_iter().fold(0, core::ops::BitOr::bitor)
            }

            #[inline(always)]
            fn from_bits(bits: u16) -> Self {
                Self(each!(k in $n => intrinsic!(mask_from_bits(bits >> (k * LANES)))))
            }

            #[inline(always)]
            fn and_not(self, other: Self) -> Self {
                Self(each!(k in $n => intrinsic!(andnot_mask(other.0[k], self.0[k]))))
            }
        }
    };
}

/// Implements a shift by the number of bits in a register, which compiles to an immediate if it is a
/// constant.
macro_rules! shift {
    ($n:tt: $method:ident $(<$constant:ident>)? ($($bits:ident)?) = $function:ident) => {
        #[inline(always)]
        fn $method $(<const $constant: u32>)? (self $(, $bits: u32)?) -> Self {
            let count = intrinsic!(_mm_cvtsi32_si128(($($constant)? $($bits)?).cast_signed()));
            Self(each!(k in $n => intrinsic!($function(self.0[k], count))))
        }
    };
}

pub(crate) use {intrinsic, methods, operator, shift, vectors};
