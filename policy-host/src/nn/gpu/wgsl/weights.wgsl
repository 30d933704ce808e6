// Right factor of a product: weights [K, N].
@group(0) @binding(2) var<storage, read> weights: array<f32>;

fn right(k: u32, col: u32) -> f32 {
    return weights[k * N + col];
}

// Returns the k and the column of a term, such that neighbouring terms are neighbours in memory.
fn right_place(term: u32) -> vec2<u32> {
    return vec2(term / 64u, term % 64u);
}
