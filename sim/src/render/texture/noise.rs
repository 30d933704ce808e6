//! Value noise on a torus: random numbers at the nodes of a lattice, smoothly joined. The seed decides all of it.

/// A noise that repeats after 1 in both directions.
pub(super) struct Noise {
    nodes: [i32; 2],
    /// Row by row, each row and the whole ending with a copy of its beginning, so that every node in a period has its
    /// neighbours to the right and below.
    values: Vec<f32>,
}

impl Noise {
    /// Noise with this many lattice nodes per period along u and v.
    pub(super) fn new(seed: u64, nodes: [i32; 2]) -> Self {
        let value = |x: i32, y: i32| {
            let node = u64::from(y.cast_unsigned()) << 32 | u64::from(x.cast_unsigned());
            (mix64(seed ^ mix64(node)) >> 40) as f32 / (1_u32 << 24) as f32
        };
        let [cols, rows] = nodes;
        let values = (0..=rows).flat_map(|y| (0..=cols).map(move |x| value(x % cols, y % rows))).collect();
        Self { nodes, values }
    }

    /// Value in [0, 1) at (`u`, `v`).
    pub(super) fn at(&self, u: f32, v: f32) -> f32 {
        self.between(eased(place(u, self.nodes[0])), eased(place(v, self.nodes[1])))
    }

    /// Value between a node and its neighbours to the right and below, at a way along both axes.
    #[inline(always)]
    fn between(&self, (x, fx): Place, (y, fy): Place) -> f32 {
        let pitch = self.nodes[0] as usize + 1;
        let row = |y: usize| {
            let pair = &self.values[y * pitch + x..][..2];
            pair[0] + (pair[1] - pair[0]) * fx
        };
        let (upper, lower) = (row(y), row(y + 1));
        upper + (lower - upper) * fy
    }

    /// Value in [0, 1) at a node; nodes repeat.
    pub(super) fn at_node(&self, x: i32, y: i32) -> f32 {
        let [cols, rows] = self.nodes;
        self.values[within(y, rows) * (cols as usize + 1) + within(x, cols)]
    }
}

/// A node and the way from there to the next, in [0, 1].
type Place = (usize, f32);

/// Where `t` is in a period of `n` nodes.
#[inline(always)]
fn place(t: f32, n: i32) -> Place {
    let x = t * n as f32;
    let cut = x as i32;
    let node = cut - i32::from(x < cut as f32);
    (within(node, n), x - node as f32)
}

/// A node's number in a period of `n`. Few lie outside it, and a predicted branch is far cheaper than a division.
#[inline(always)]
fn within(node: i32, n: i32) -> usize {
    let inside = if (0..n).contains(&node) { node } else { node.rem_euclid(n) };
    inside as usize
}

fn eased((node, way): Place) -> Place {
    (node, way * way * (3.0 - 2.0 * way))
}

/// Nodes along both axes of a sum of noises: as many as a pattern's texels.
const FINEST: i32 = super::SIDE as i32;

/// A weighted sum of noises, taken once on a lattice as fine as a pattern's texels.
pub(super) struct Fbm {
    sum: Noise,
}

impl Fbm {
    /// Fractional Brownian motion: the coarsest noise has `nodes`, each of the others twice the nodes of the one before
    /// and `gain` times its weight.
    pub(super) fn new(seed: u64, nodes: [i32; 2], n_octaves: u32, gain: f32) -> Self {
        let mut weight = 1.0;
        let octaves = (0..n_octaves).map(|i| {
            let octave = (Noise::new(seed + u64::from(i), nodes.map(|n| n << i)), weight);
            weight *= gain;
            octave
        });
        Self::of(&octaves.collect::<Vec<_>>())
    }

    /// The sum of these noises, its weights scaled to a sum of 1.
    pub(super) fn of(noises: &[(Noise, f32)]) -> Self {
        let mut sum = Noise { nodes: [FINEST; 2], values: vec![0.0; (FINEST as usize + 1).pow(2)] };
        let weights: f32 = noises.iter().map(|(_, weight)| weight).sum();
        for (noise, weight) in noises {
            let places = noise.nodes.map(|n| (0..=FINEST).map(move |k| place(k as f32 / FINEST as f32, n)));
            let [columns, rows] = places.map(|places| places.map(eased).collect::<Vec<_>>());
            for (line, row) in sum.values.chunks_exact_mut(columns.len()).zip(rows) {
                for (value, column) in line.iter_mut().zip(&columns) {
                    *value += weight / weights * noise.between(*column, row);
                }
            }
        }
        Self { sum }
    }

    /// Value in [0, 1) at (`u`, `v`), rarely far from 1/2.
    pub(super) fn at(&self, u: f32, v: f32) -> f32 {
        self.sum.between(place(u, FINEST), place(v, FINEST))
    }
}

/// A displacement of the plane that repeats after 1 in both directions.
pub(super) struct Warp {
    fields: [Fbm; 2],
    reach: f32,
}

impl Warp {
    /// Moves no point further than `reach` / 2 along either axis.
    pub(super) fn new(seed: u64, nodes: i32, n_octaves: u32, reach: f32) -> Self {
        let fields = [seed, seed + 16].map(|seed| Fbm::new(seed, [nodes; 2], n_octaves, 0.5));
        Self { fields, reach }
    }

    /// Where (`u`, `v`) goes.
    pub(super) fn at(&self, u: f32, v: f32) -> (f32, f32) {
        let [du, dv] = [0, 1].map(|i| self.reach * (self.fields[i].at(u, v) - 0.5));
        (u + du, v + dv)
    }
}

/// A bijection of 64 bits that scatters neighbours: the finaliser of SplitMix64 (Steele, Lea and Flood, 2014).
fn mix64(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ x >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ x >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ x >> 31
}
