// Attention of one head: out = softmax(queries · keysᵀ) · values, with the heads of a row side by side. A
// workgroup takes QUERIES queries of a sample, so that it reads the keys and values once for all of them.
override N_QUERIES: u32;
override N_KEYS: u32;
override WIDTH: u32;
override HEAD: u32;
override QUERIES: u32;
// Index of a key that only the samples with a 1 in `present` have; N_KEYS if all have all keys.
override OPTIONAL: u32;
@group(0) @binding(0) var<storage, read> queries: array<f32>;
@group(0) @binding(1) var<storage, read> keys: array<f32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read> present: array<u32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

var<workgroup> scores: array<f32, QUERIES * N_KEYS>;
// One row of 64 partial results per query.
var<workgroup> partial: array<f32, QUERIES * 64>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let blocks = (N_QUERIES + QUERIES - 1u) / QUERIES;
    let sample = group.x / blocks;
    let first = group.x % blocks * QUERIES;
    let column = group.y * HEAD;
    let key_start = sample * N_KEYS * WIDTH + column;
    for (var key = thread; key < N_KEYS; key += 64u) {
        for (var q = 0u; q < QUERIES; q++) {
            let query_start = (sample * N_QUERIES + min(first + q, N_QUERIES - 1u)) * WIDTH + column;
            var score = 0.0;
            for (var i = 0u; i < HEAD; i++) {
                score = fma(queries[query_start + i], keys[key_start + key * WIDTH + i], score);
            }
            if (key == OPTIONAL && present[sample] == 0u) {
                score = -3e38;
            }
            scores[q * N_KEYS + key] = score;
        }
    }
    workgroupBarrier();
    // The largest score of each query, then the exponentials, then their sum.
    for (var q = 0u; q < QUERIES; q++) {
        var largest = -3e38;
        for (var key = thread; key < N_KEYS; key += 64u) {
            largest = max(largest, scores[q * N_KEYS + key]);
        }
        partial[q * 64u + thread] = largest;
    }
    workgroupBarrier();
    for (var half = 32u; half > 0u; half /= 2u) {
        if (thread < half) {
            for (var q = 0u; q < QUERIES; q++) {
                let at = q * 64u + thread;
                partial[at] = max(partial[at], partial[at + half]);
            }
        }
        workgroupBarrier();
    }
    for (var q = 0u; q < QUERIES; q++) {
        let largest = partial[q * 64u];
        for (var key = thread; key < N_KEYS; key += 64u) {
            scores[q * N_KEYS + key] = exp(scores[q * N_KEYS + key] - largest);
        }
    }
    workgroupBarrier();
    for (var q = 0u; q < QUERIES; q++) {
        var sum = 0.0;
        for (var key = thread; key < N_KEYS; key += 64u) {
            sum += scores[q * N_KEYS + key];
        }
        partial[q * 64u + thread] = sum;
    }
    workgroupBarrier();
    for (var half = 32u; half > 0u; half /= 2u) {
        if (thread < half) {
            for (var q = 0u; q < QUERIES; q++) {
                partial[q * 64u + thread] += partial[q * 64u + thread + half];
            }
        }
        workgroupBarrier();
    }
    for (var i = thread; i < HEAD; i += 64u) {
        for (var q = 0u; q < QUERIES && first + q < N_QUERIES; q++) {
            var sum = 0.0;
            for (var key = 0u; key < N_KEYS; key++) {
                sum = fma(scores[q * N_KEYS + key], values[key_start + key * WIDTH + i], sum);
            }
            out[(sample * N_QUERIES + first + q) * WIDTH + column + i] = sum / partial[q * 64u];
        }
    }
}
