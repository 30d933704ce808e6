// Right factor of a product: weights [N, K] of 16 bits as PyTorch stores them, two per word. K is even.
// 1 for bf16, the upper half of an f32; 0 for f16.
override IS_BF16: u32;
@group(0) @binding(2) var<storage, read> weights: array<u32>;

// Loads 16 k of 64 columns into the right tile of product.wgsl.
fn load_right(thread: u32, k0: u32, first_col: u32) {
    // Half of the threads load two k of four columns each.
    if (thread >= 128u) {
        return;
    }
    let k = k0 + 2u * (thread % 8u);
    let col = first_col + 4u * (thread / 8u);
    var words = vec4(0u);
    if (k < K) {
        for (var i = 0u; i < 4u && col + i < N; i++) {
            words[i] = weights[((col + i) * K + k) / 2u];
        }
    }
    let at = 2u * (thread % 8u) * PITCH + thread / 8u;
    if (IS_BF16 == 1u) {
        right_tile[at] = bitcast<vec4<f32>>(words << vec4(16u));
        right_tile[at + PITCH] = bitcast<vec4<f32>>(words & vec4(0xffff0000u));
    } else {
        let first = vec4(unpack2x16float(words.x), unpack2x16float(words.y));
        let last = vec4(unpack2x16float(words.z), unpack2x16float(words.w));
        right_tile[at] = vec4(first.xz, last.xz);
        right_tile[at + PITCH] = vec4(first.yw, last.yw);
    }
}
