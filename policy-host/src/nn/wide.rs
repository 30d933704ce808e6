//! Loops compiled twice: for any x86-64 processor, and with registers of twice the width for those that have them.
//!
//! Rust never fuses a product and a sum by itself, so both give the same bits.

/// Defines functions as written that run on AVX2 where there is AVX2. What they call must be `#[inline(always)]` to be
/// compiled with them.
macro_rules! wide {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) $body:block)+) => {$(
        $(#[$meta])*
        $vis fn $name($($arg: $type),*) {
            #[inline(always)]
            fn any($($arg: $type),*) $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) {
                    any($($arg),*);
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            any($($arg),*);
        }
    )+};
}

pub(super) use wide;
