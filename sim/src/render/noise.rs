//! Value noise on a torus: random numbers at the nodes of a lattice, smoothly joined. The seed decides all of it.

/// A noise that repeats after 1 in both directions.
pub(super) struct Noise {
    seed: u64,
    nodes: [u32; 2],
}

impl Noise {
    /// Noise with this many lattice nodes per period along u and v.
    pub(super) fn new(seed: u64, nodes: [u32; 2]) -> Self {
        Self { seed, nodes }
    }

    /// Value in [0, 1) at (`u`, `v`), both at least 0.
    pub(super) fn at(&self, u: f32, v: f32) -> f32 {
        let [x, y] = [(u, self.nodes[0]), (v, self.nodes[1])].map(|(t, n)| t * n as f32);
        let ease = |t: f32| t * t * (3.0 - 2.0 * t);
        let (fx, fy) = (ease(x - x as u32 as f32), ease(y - y as u32 as f32));
        let (x, y) = (x as u32, y as u32);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let row = |y| mix(self.at_node(x, y), self.at_node(x + 1, y), fx);
        mix(row(y), row(y + 1), fy)
    }

    /// Value in [0, 1) at a node; nodes repeat.
    pub(super) fn at_node(&self, x: u32, y: u32) -> f32 {
        let node = u64::from(y % self.nodes[1]) << 32 | u64::from(x % self.nodes[0]);
        (mix64(self.seed ^ mix64(node)) >> 40) as f32 / (1_u32 << 24) as f32
    }
}

/// A bijection of 64 bits that scatters neighbours: the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
fn mix64(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ x >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ x >> 31
}
