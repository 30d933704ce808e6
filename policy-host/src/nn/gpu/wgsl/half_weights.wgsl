// Right factor of a product: weights [N, K] of 16 bits as PyTorch stores them, two per word. K is even.
// 1 for bf16, the upper half of an f32; 0 for f16.
override IS_BF16: u32;
@group(0) @binding(2) var<storage, read> weights: array<u32>;

fn load_right(thread: u32, k0: u32, first_col: u32) {
    // A thread loads two k of columns c and c + 32.
    let row = 2u * (thread % 8u);
    for (var i = 0u; i < 2u; i++) {
        let c = thread / 8u + 32u * i;
        var values = vec2(0.0);
        if (k0 + row < K && first_col + c < N) {
            let word = weights[((first_col + c) * K + k0 + row) / 2u];
            if (IS_BF16 == 1u) {
                values = vec2(bitcast<f32>(word << 16u), bitcast<f32>(word & 0xffff0000u));
            } else {
                values = unpack2x16float(word);
            }
        }
        right_tile[row * PITCH + c] = values.x;
        right_tile[(row + 1u) * PITCH + c] = values.y;
    }
}

