// Product of the left factor [n_samples · ROWS, K] and the right factor [K, N] on cooperative matrices of
// 16-bit floats, with the accuracy of f32: H. Ootomo and R. Yokota, "Recovering single precision accuracy
// from Tensor Cores while surpassing the FP32 theoretical peak performance" (2022). Terms are split into
// high + low / 2048 and must be smaller than 65,504. Products of two high parts are added up in f32, outside
// of the matrix units, which may round towards zero; products of a high and a low part are added up inside.
// Those of two low parts are below the rounding error.
//
// A workgroup computes a tile of 64 × 64 values, a subgroup 2 × 2 matrices. Every value is a sum over k in
// one order, which depends on the shape of the matrices alone.

// Terms from one row of a factor's tile to the next: a multiple of 16 bytes, as matrices require, and such
// that rows start in different banks.
const LEFT_PITCH = 24u;
const RIGHT_PITCH = 72u;
// Subgroups per row of the tile.
const GRID = 32u / SIDE;
const MATRIX = SIDE * SIDE;

// Tiles [64, 16] of the left factor and [16, 64] of the right one.
var<workgroup> left_high: array<f16, 1536>;
var<workgroup> left_low: array<f16, 1536>;
var<workgroup> right_high: array<f16, 1152>;
var<workgroup> right_low: array<f16, 1152>;
// A matrix per subgroup, on its way to the output.
var<workgroup> finished: array<f32, 1024>;

// Returns the high and the low part of a term. The high part is never subnormal, which devices may replace by
// zero; a compiler may take f32(f16(x)) for x.
fn split(x: f32) -> vec2<f16> {
    let high = quantizeToF16(x);
    return vec2(f16(high), f16((x - high) * 2048.0));
}

// Writes the matrices of all subgroups, which are those of their row i and column j.
fn write_out(first: vec2<u32>, i: u32, j: u32, n_rows: u32, thread: u32) {
    for (var at = thread; at < 1024u; at += 128u) {
        let subgroup = at / MATRIX;
        let row = first.x + (subgroup / GRID * 2u + i) * SIDE + at % MATRIX / SIDE;
        let col = first.y + (subgroup % GRID * 2u + j) * SIDE + at % SIDE;
        if (row < n_rows && col < N) {
            let to = ((row / ROWS) * OUT_ROWS + OUT_FIRST + row % ROWS) * N + col;
            out[to] = finish(finished[at], bias[col], to);
        }
    }
}

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_id) subgroup: u32,
) {
    let n_rows = batch.n_samples * ROWS;
    let first = 64u * group.xy;
    let load_k = thread % 16u;
    var places: array<Place, 8>;
    for (var i = 0u; i < 8u; i++) {
        places[i] = place(min(first.x + thread / 16u + 8u * i, n_rows - 1u));
    }
    let row = subgroup / GRID * 2u * SIDE;
    let col = subgroup % GRID * 2u * SIDE;
    var zero: Sums;
    var sum_00: Sums;
    var sum_01: Sums;
    var sum_10: Sums;
    var sum_11: Sums;
    var cross_00: Sums;
    var cross_01: Sums;
    var cross_10: Sums;
    var cross_11: Sums;
    for (var k0 = 0u; k0 < K; k0 += 16u) {
        for (var i = 0u; i < 8u; i++) {
            var x = 0.0;
            if (k0 + load_k < K) {
                x = left(places[i], k0 + load_k);
            }
            let at = (thread / 16u + 8u * i) * LEFT_PITCH + load_k;
            let parts = split(x);
            left_high[at] = parts.x;
            left_low[at] = parts.y;
        }
        for (var i = 0u; i < 8u; i++) {
            let term = right_place(thread + 128u * i);
            var x = 0.0;
            if (k0 + term.x < K && first.y + term.y < N) {
                x = right(k0 + term.x, first.y + term.y);
            }
            let at = term.x * RIGHT_PITCH + term.y;
            let parts = split(x);
            right_high[at] = parts.x;
            right_low[at] = parts.y;
        }
        workgroupBarrier();
        for (var k = 0u; k < 16u; k += SIDE) {
            let left_0 = row * LEFT_PITCH + k;
            let left_1 = left_0 + SIDE * LEFT_PITCH;
            let right_0 = k * RIGHT_PITCH + col;
            let right_1 = right_0 + SIDE;
            let high_0x = coopLoadT<Left>(&left_high[left_0], LEFT_PITCH);
            let high_1x = coopLoadT<Left>(&left_high[left_1], LEFT_PITCH);
            let high_x0 = coopLoadT<Right>(&right_high[right_0], RIGHT_PITCH);
            let high_x1 = coopLoadT<Right>(&right_high[right_1], RIGHT_PITCH);
            let low_0x = coopLoadT<Left>(&left_low[left_0], LEFT_PITCH);
            let low_1x = coopLoadT<Left>(&left_low[left_1], LEFT_PITCH);
            let low_x0 = coopLoadT<Right>(&right_low[right_0], RIGHT_PITCH);
            let low_x1 = coopLoadT<Right>(&right_low[right_1], RIGHT_PITCH);
            sum_00 = sum_00 + coopMultiplyAdd(high_0x, high_x0, zero);
            sum_01 = sum_01 + coopMultiplyAdd(high_0x, high_x1, zero);
            sum_10 = sum_10 + coopMultiplyAdd(high_1x, high_x0, zero);
            sum_11 = sum_11 + coopMultiplyAdd(high_1x, high_x1, zero);
            cross_00 = coopMultiplyAdd(low_0x, high_x0, coopMultiplyAdd(high_0x, low_x0, cross_00));
            cross_01 = coopMultiplyAdd(low_0x, high_x1, coopMultiplyAdd(high_0x, low_x1, cross_01));
            cross_10 = coopMultiplyAdd(low_1x, high_x0, coopMultiplyAdd(high_1x, low_x0, cross_10));
            cross_11 = coopMultiplyAdd(low_1x, high_x1, coopMultiplyAdd(high_1x, low_x1, cross_11));
        }
        workgroupBarrier();
    }
    let scale = 1.0 / 2048.0;
    let total_00 = sum_00 + cross_00 * scale;
    let total_01 = sum_01 + cross_01 * scale;
    let total_10 = sum_10 + cross_10 * scale;
    let total_11 = sum_11 + cross_11 * scale;
    let own = subgroup * MATRIX;
    let stride = SIDE;
    coopStoreT(total_00, &finished[own], stride);
    workgroupBarrier();
    write_out(first, 0u, 0u, n_rows, thread);
    workgroupBarrier();
    coopStoreT(total_01, &finished[own], stride);
    workgroupBarrier();
    write_out(first, 0u, 1u, n_rows, thread);
    workgroupBarrier();
    coopStoreT(total_10, &finished[own], stride);
    workgroupBarrier();
    write_out(first, 1u, 0u, n_rows, thread);
    workgroupBarrier();
    coopStoreT(total_11, &finished[own], stride);
    workgroupBarrier();
    write_out(first, 1u, 1u, n_rows, thread);
}
