// Right factor of a product: weights [N, K] of 16 bits as PyTorch stores them, two per word. K is even.
// 1 for bf16, the upper half of an f32; 0 for f16.
override IS_BF16: u32;
@group(0) @binding(2) var<storage, read> weights: array<u32>;

fn right(k: u32, col: u32) -> f32 {
    let word = weights[(col * K + k) / 2u] >> (16u * (k % 2u));
    return select(unpack2x16float(word).x, bitcast<f32>(word << 16u), IS_BF16 == 1u);
}

// Returns the k and the column of a term, such that neighbouring terms are neighbours in memory.
fn right_place(term: u32) -> vec2<u32> {
    return vec2(term % 16u, term / 16u);
}
