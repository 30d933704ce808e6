// Right factor of a product: weights [N, K] as PyTorch stores them.
@group(0) @binding(2) var<storage, read> weights: array<f32>;

// Loads 16 k of 64 columns into the right tile of product.wgsl.
fn load_right(thread: u32, k0: u32, first_col: u32) {
    // A thread loads one k of four columns.
    let k = k0 + thread % 16u;
    let col = first_col + 4u * (thread / 16u);
    var terms = vec4(0.0);
    if (k < K) {
        for (var i = 0u; i < 4u && col + i < N; i++) {
            terms[i] = weights[(col + i) * K + k];
        }
    }
    right_tile[thread % 16u * PITCH + thread / 16u] = terms;
}
