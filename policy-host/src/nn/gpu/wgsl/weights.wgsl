// Right factor of a product: weights [K, N].
@group(0) @binding(2) var<storage, read> weights: array<f32>;

fn load_right(thread: u32, k0: u32, first_col: u32) {
    // A thread loads one column of four k.
    let col = first_col + thread % 64u;
    for (var i = 0u; i < 4u; i++) {
        let row = thread / 64u + 4u * i;
        var value = 0.0;
        if (k0 + row < K && col < N) {
            value = weights[(k0 + row) * N + col];
        }
        right_tile[row * PITCH + thread % 64u] = value;
    }
}

