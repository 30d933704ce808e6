// Right factor of a product: weights [N, K] as PyTorch stores them.
@group(0) @binding(2) var<storage, read> weights: array<f32>;

fn load_right(thread: u32, k0: u32, first_col: u32) {
    // A thread loads one k of columns c, c + 16, c + 32, c + 48.
    let row = thread % 16u;
    for (var i = 0u; i < 4u; i++) {
        let c = thread / 16u + 16u * i;
        var value = 0.0;
        if (k0 + row < K && first_col + c < N) {
            value = weights[(first_col + c) * K + k0 + row];
        }
        right_tile[row * PITCH + c] = value;
    }
}

