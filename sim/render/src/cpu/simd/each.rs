//! Arrays of similar expressions, unrolled by a macro.
//!
//! `array::from_fn` and `map` take closures, and a closure is not compiled for the instruction set of the
//! function that contains it, so intrinsics inside would become function calls. For the same reason no code
//! of this renderer passes vectors through other closures.

/// Expands `each!(k in 3 => f(k))` to `[f(0), f(1), f(2)]`. Supports 1, 2, 3, 4, 8 and 16 elements.
macro_rules! each {
    ($k:ident in 1 => $value:expr) => {
        $crate::cpu::simd::each::each!($k of [0] => $value)
    };
    ($k:ident in 2 => $value:expr) => {
        $crate::cpu::simd::each::each!($k of [0, 1] => $value)
    };
    ($k:ident in 3 => $value:expr) => {
        $crate::cpu::simd::each::each!($k of [0, 1, 2] => $value)
    };
    ($k:ident in 4 => $value:expr) => {
        $crate::cpu::simd::each::each!($k of [0, 1, 2, 3] => $value)
    };
    ($k:ident in 8 => $value:expr) => {
        $crate::cpu::simd::each::each!($k of [0, 1, 2, 3, 4, 5, 6, 7] => $value)
    };
    ($k:ident in 16 => $value:expr) => {
        $crate::cpu::simd::each::each!($k of [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15] => $value)
    };
    ($k:ident of [$($i:literal),+] => $value:expr) => {
        [$({
            let $k: usize = $i;
            $value
        }),+]
    };
}

pub(crate) use each;
