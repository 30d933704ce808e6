// Product of the left factor [n_samples · ROWS, K] and the right factor [K, N]. A workgroup computes a tile
// of 64 × 64 values, a thread 4 × 4. Every value is one chain of fused multiply-adds over k, in order.
override N: u32;
// Row i of a sample goes to row OUT_FIRST + i of its OUT_ROWS rows.
override OUT_ROWS: u32;
override OUT_FIRST: u32;
// 1: out = max(sum, 0). 2: out += sum. 3: out = max(out + sum, 0). 4: out = gelu(sum). 5: out *= sum.
// 6: out += gate · product, without a bias. Otherwise out = sum. A sum is a product plus the bias.
override EPILOGUE: u32;
// Bias [N], or the gate [N] of epilogue 6.
@group(0) @binding(3) var<storage, read> bias: array<f32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

// Words from one k to the next in a tile. More than 64, so that threads that store several k of one row or
// column use different banks.
const PITCH = 68u;
// Terms [16, 64] of both factors.
var<workgroup> left_tile: array<f32, 1088>;
var<workgroup> right_tile: array<f32, 1088>;

// Returns x · σ(2√(2/π)·(x + 0.044715 x³)), the GELU in its form with tanh.
fn gelu(x: f32) -> f32 {
    let exponential = exp(-abs(1.5957692 * (x + 0.044715 * x * x * x)));
    return x * select(1.0, exponential, x < 0.0) / (1.0 + exponential);
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let n_rows = batch.n_samples * ROWS;
    let first_row = group.x * 64u;
    let first_col = group.y * 64u;
    // A thread loads one k of rows m, m + 16, m + 32, m + 48.
    let load_k = thread % 16u;
    let load_m = thread / 16u;
    var places: array<Place, 4>;
    for (var i = 0u; i < 4u; i++) {
        places[i] = place(min(first_row + load_m + 16u * i, n_rows - 1u));
    }
    let x = thread % 16u;
    let y = thread / 16u;
    var sums: array<vec4<f32>, 4>;
    for (var k0 = 0u; k0 < K; k0 += 16u) {
        for (var i = 0u; i < 4u; i++) {
            let k = k0 + load_k;
            var value = 0.0;
            if (k < K) {
                value = left(places[i], k);
            }
            left_tile[load_k * PITCH + load_m + 16u * i] = value;
        }
        load_right(thread, k0, first_col);
        workgroupBarrier();
        for (var k = 0u; k < 16u; k++) {
            let r = k * PITCH + 4u * x;
            let right = vec4(right_tile[r], right_tile[r + 1u], right_tile[r + 2u], right_tile[r + 3u]);
            let l = k * PITCH + 4u * y;
            sums[0] = fma(vec4(left_tile[l]), right, sums[0]);
            sums[1] = fma(vec4(left_tile[l + 1u]), right, sums[1]);
            sums[2] = fma(vec4(left_tile[l + 2u]), right, sums[2]);
            sums[3] = fma(vec4(left_tile[l + 3u]), right, sums[3]);
        }
        workgroupBarrier();
    }
    for (var i = 0u; i < 4u; i++) {
        let row = first_row + 4u * y + i;
        if (row >= n_rows) {
            continue;
        }
        let start = ((row / ROWS) * OUT_ROWS + OUT_FIRST + row % ROWS) * N;
        for (var j = 0u; j < 4u; j++) {
            let col = first_col + 4u * x + j;
            if (col >= N) {
                continue;
            }
            out[start + col] = finish(sums[i][j], bias[col], start + col);
        }
    }
}

// Returns the value to store for a product.
fn finish(product: f32, bias: f32, at: u32) -> f32 {
    if (EPILOGUE == 6u) {
        return fma(product, bias, out[at]);
    }
    let sum = product + bias;
    switch EPILOGUE {
        case 1u: { return max(sum, 0.0); }
        case 2u: { return out[at] + sum; }
        case 3u: { return max(out[at] + sum, 0.0); }
        case 4u: { return gelu(sum); }
        case 5u: { return out[at] * sum; }
        default: { return sum; }
    }
}
