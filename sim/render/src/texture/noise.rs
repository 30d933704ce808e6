//! Periodic value noise and what is derived from it: fractional Brownian motion and domain warping.
//!
//! Everything is a pure function of its seed.

/// Value noise with period 1 in both directions: random values at lattice nodes, interpolated smoothly.
pub(crate) struct Noise {
    nodes: [i32; 2],
    /// Node values in row-major order. Each row ends with a copy of its first value and the last row repeats
    /// the first, so that every node of the period has neighbours to the right and below.
    values: Vec<f32>,
}

impl Noise {
    /// Creates noise with `nodes` lattice nodes per period along u and v.
    pub(crate) fn new(seed: u64, nodes: [i32; 2]) -> Self {
        let value = |x: i32, y: i32| {
            let node = u64::from(y.cast_unsigned()) << 32 | u64::from(x.cast_unsigned());
            (mix64(seed ^ mix64(node)) >> 40) as f32 / (1_u32 << 24) as f32
        };
        let [cols, rows] = nodes;
        let values = (0..=rows).flat_map(|y| (0..=cols).map(move |x| value(x % cols, y % rows))).collect();
        Self { nodes, values }
    }

    /// Returns the value in [0, 1) at (`u`, `v`).
    pub(crate) fn at(&self, u: f32, v: f32) -> f32 {
        self.interpolate(smoothed(lattice_coord(u, self.nodes[0])), smoothed(lattice_coord(v, self.nodes[1])))
    }

    /// Interpolates bilinearly between a node and its neighbours to the right and below.
    #[inline(always)]
    fn interpolate(&self, (x, fx): LatticeCoord, (y, fy): LatticeCoord) -> f32 {
        let pitch = self.nodes[0] as usize + 1;
        let row = |y: usize| {
            let pair = &self.values[y * pitch + x..][..2];
            pair[0] + (pair[1] - pair[0]) * fx
        };
        let (upper, lower) = (row(y), row(y + 1));
        upper + (lower - upper) * fy
    }

    /// Returns the value in [0, 1) at a node. Node indices wrap around.
    pub(crate) fn at_node(&self, x: i32, y: i32) -> f32 {
        let [cols, rows] = self.nodes;
        self.values[wrap(y, rows) * (cols as usize + 1) + wrap(x, cols)]
    }
}

/// A node index and the fraction of the way to the next node, in [0, 1].
type LatticeCoord = (usize, f32);

/// Returns the lattice coordinate of `t` in a period of `n` nodes.
#[inline(always)]
fn lattice_coord(t: f32, n: i32) -> LatticeCoord {
    let x = t * n as f32;
    let cut = x as i32;
    let node = cut - i32::from(x < cut as f32);
    (wrap(node, n), x - node as f32)
}

/// Returns `node` modulo `n`. Few nodes lie outside the period, and a predicted branch is far cheaper than a
/// division.
#[inline(always)]
fn wrap(node: i32, n: i32) -> usize {
    let inside = if (0..n).contains(&node) { node } else { node.rem_euclid(n) };
    inside as usize
}

/// Applies the Hermite step to the fraction.
fn smoothed((node, t): LatticeCoord) -> LatticeCoord {
    (node, t * t * (3.0 - 2.0 * t))
}

/// Resolution at which a sum of noises is sampled: that of a texture.
const RESOLUTION: i32 = super::size::SIDE as i32;

/// Fractional Brownian motion: a weighted sum of noises, precomputed on a lattice with the resolution of a
/// texture.
pub(crate) struct Fbm {
    sum: Noise,
}

impl Fbm {
    /// Creates fBm whose first octave has `nodes` lattice nodes. Each further octave has twice the nodes and
    /// `gain` times the weight of the one before.
    pub(crate) fn new(seed: u64, nodes: [i32; 2], n_octaves: u32, gain: f32) -> Self {
        let mut weight = 1.0;
        let octaves = (0..n_octaves).map(|i| {
            let octave = (Noise::new(seed + u64::from(i), nodes.map(|n| n << i)), weight);
            weight *= gain;
            octave
        });
        Self::weighted_sum(&octaves.collect::<Vec<_>>())
    }

    /// Creates the weighted sum of some noises, with the weights normalised to a sum of 1.
    pub(crate) fn weighted_sum(noises: &[(Noise, f32)]) -> Self {
        let mut sum = Noise { nodes: [RESOLUTION; 2], values: vec![0.0; (RESOLUTION as usize + 1).pow(2)] };
        let weights: f32 = noises.iter().map(|(_, weight)| weight).sum();
        for (noise, weight) in noises {
            let coords = noise
                .nodes
                .map(|n| (0..=RESOLUTION).map(move |k| lattice_coord(k as f32 / RESOLUTION as f32, n)));
            let [columns, rows] = coords.map(|axis| axis.map(smoothed).collect::<Vec<_>>());
            for (values, row) in sum.values.chunks_exact_mut(columns.len()).zip(rows) {
                for (value, column) in values.iter_mut().zip(&columns) {
                    *value += weight / weights * noise.interpolate(*column, row);
                }
            }
        }
        Self { sum }
    }

    /// Value in [0, 1) at (`u`, `v`), mostly close to 1/2.
    pub(crate) fn at(&self, u: f32, v: f32) -> f32 {
        self.sum.interpolate(lattice_coord(u, RESOLUTION), lattice_coord(v, RESOLUTION))
    }
}

/// Domain warp: a displacement of the plane with period 1 in both directions.
pub(crate) struct Warp {
    fields: [Fbm; 2],
    amplitude: f32,
}

impl Warp {
    /// Creates a warp that moves no point by more than `amplitude` / 2 along either axis.
    pub(crate) fn new(seed: u64, nodes: i32, n_octaves: u32, amplitude: f32) -> Self {
        let fields = [seed, seed + 16].map(|seed| Fbm::new(seed, [nodes; 2], n_octaves, 0.5));
        Self { fields, amplitude }
    }

    /// Returns the displaced point.
    pub(crate) fn at(&self, u: f32, v: f32) -> (f32, f32) {
        let [du, dv] = [0, 1].map(|i| self.amplitude * (self.fields[i].at(u, v) - 0.5));
        (u + du, v + dv)
    }
}

/// 64-bit mixing function: the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
fn mix64(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ x >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ x >> 31
}
