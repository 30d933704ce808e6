//! Counter-based pseudo-random numbers, computed from a stream name and an index: identical in every language
//! and on every machine.
//!
//! Element `i` of stream `s` is a 24-bit fraction, the upper bits of splitmix64's mixing function applied to
//! `s + i·γ`, where γ is the generator's odd increment. A named stream starts at the 64-bit FNV-1a hash of
//! its name.

/// splitmix64's increment γ, 2⁶⁴ divided by the golden ratio.
pub const SPLITMIX_GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// Applies splitmix64's mixing function (Steele, Lea, Flood: Fast splittable pseudorandom number generators,
/// 2014).
#[must_use]
pub const fn splitmix64(mut z: u64) -> u64 {
    z ^= z >> 30;
    z = z.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^= z >> 27;
    z = z.wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Returns the 64-bit FNV-1a hash of a name.
#[must_use]
pub fn fnv1a64(name: &str) -> u64 {
    let step = |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
    name.bytes().fold(0xCBF2_9CE4_8422_2325, step)
}

/// Returns element `idx` of a stream, in [0, 1).
#[must_use]
pub fn unit(stream: u64, idx: usize) -> f32 {
    let bits = splitmix64(stream.wrapping_add((idx as u64).wrapping_mul(SPLITMIX_GAMMA))) >> 40;
    bits as f32 / (1 << 24) as f32
}

/// Returns element `idx` of a stream, in [−bound, bound).
#[must_use]
pub fn sym(stream: u64, idx: usize, bound: f32) -> f32 {
    (2.0 * unit(stream, idx) - 1.0) * bound
}
