// Product of the left factor [n_samples · ROWS, K] and weights [K, N], plus a bias [N]. A workgroup computes
// a tile of 64 × 64 values, a thread 4 × 4. Every value is one chain of fused multiply-adds over k, in order.
override N: u32;
// Row i of a sample goes to row OUT_FIRST + i of its OUT_ROWS rows.
override OUT_ROWS: u32;
override OUT_FIRST: u32;
// 1: out = max(sum, 0). 2: out += sum. 3: out = max(out + sum, 0). Otherwise out = sum.
override EPILOGUE: u32;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read> bias: array<f32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

// Terms [16, 64] of both factors.
var<workgroup> left_tile: array<f32, 1024>;
var<workgroup> right_tile: array<f32, 1024>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let n_rows = batch.n_samples * ROWS;
    let first_row = group.x * 64u;
    let first_col = group.y * 64u;
    // A thread loads one k of rows m, m + 16, m + 32, m + 48, and one column of four k.
    let load_k = thread % 16u;
    let load_m = thread / 16u;
    let load_col = first_col + thread % 64u;
    let load_row = thread / 64u;
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
            left_tile[load_k * 64u + load_m + 16u * i] = value;
        }
        for (var i = 0u; i < 4u; i++) {
            let k = k0 + load_row + 4u * i;
            var value = 0.0;
            if (k < K && load_col < N) {
                value = weights[k * N + load_col];
            }
            right_tile[(load_row + 4u * i) * 64u + thread % 64u] = value;
        }
        workgroupBarrier();
        for (var k = 0u; k < 16u; k++) {
            let r = k * 64u + 4u * x;
            let right = vec4(right_tile[r], right_tile[r + 1u], right_tile[r + 2u], right_tile[r + 3u]);
            let l = k * 64u + 4u * y;
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
            var value = sums[i][j] + bias[col];
            if (EPILOGUE >= 2u) {
                value += out[start + col];
            }
            if (EPILOGUE == 1u || EPILOGUE == 3u) {
                value = max(value, 0.0);
            }
            out[start + col] = value;
        }
    }
}
