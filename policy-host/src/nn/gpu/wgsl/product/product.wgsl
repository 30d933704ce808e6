// Product of the left factor [n_samples · ROWS, K] and the right factor [K, N]. A workgroup computes a tile
// of 64 × 64 values, a thread 4 × 4. Every value is one chain of fused multiply-adds over k, in order.

// Vectors from one k to the next in a tile. More than 16, so that threads that store several k of the same
// rows or columns use different banks.
const PITCH = 17u;
// Terms [16, 64] of both factors, four rows or columns in a vector.
var<workgroup> left_tile: array<vec4<f32>, 272>;
var<workgroup> right_tile: array<vec4<f32>, 272>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let n_rows = batch.n_samples * ROWS;
    let first_row = group.x * 64u;
    let first_col = group.y * 64u;
    // A thread loads one k of four rows.
    let load_k = thread % 16u;
    let load_m = thread / 16u;
    var places: array<Place, 4>;
    for (var i = 0u; i < 4u; i++) {
        places[i] = place(min(first_row + 4u * load_m + i, n_rows - 1u));
    }
    let x = thread % 16u;
    let y = thread / 16u;
    var sums: array<vec4<f32>, 4>;
    for (var k0 = 0u; k0 < K; k0 += 16u) {
        let load = k0 + load_k;
        var terms = vec4(0.0);
        if (load < K) {
            terms.x = left(places[0], load);
            terms.y = left(places[1], load);
            terms.z = left(places[2], load);
            terms.w = left(places[3], load);
        }
        left_tile[load_k * PITCH + load_m] = terms;
        load_right(thread, k0, first_col);
        workgroupBarrier();
        for (var k = 0u; k < 16u; k++) {
            let right = right_tile[k * PITCH + x];
            let rows = left_tile[k * PITCH + y];
            sums[0] = fma(vec4(rows.x), right, sums[0]);
            sums[1] = fma(vec4(rows.y), right, sums[1]);
            sums[2] = fma(vec4(rows.z), right, sums[2]);
            sums[3] = fma(vec4(rows.w), right, sums[3]);
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
