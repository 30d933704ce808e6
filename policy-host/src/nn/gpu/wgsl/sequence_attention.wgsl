// Attention of sequences of different lengths: out = softmax(queries · keysᵀ / √HEAD) · values. The keys of a
// sample are rows of `prefix`, then its SUFFIX rows of `suffix`; their values lie in the same rows. They pass
// in blocks of 32, first those of the prefix, with a running maximum and sum of the exponentials (Milakov and
// Gimelshein, Online normalizer calculation for softmax, 2018). No block depends on another sample.
override HEAD: u32;
// Heads of a row of queries that share keys: each is a query of its own. 1 if every head has its own keys.
override GROUP: u32;
// Words from one query to the next, and from one row of keys to the next.
override QUERY_STRIDE: u32;
override KEY_STRIDE: u32;
// Words from a row's first key to its first value, and from one head's keys to the next one's.
override VALUES: u32;
override KEY_STEP: u32;
// Blocks of 32 queries of the longest sequence.
override BLOCKS: u32;
override SUFFIX: u32;

// Rows of a sample in the buffers of the queries and of the prefix.
struct Span { first_query: u32, n_queries: u32, first_key: u32, n_keys: u32 }
@group(0) @binding(0) var<storage, read> queries: array<f32>;
@group(0) @binding(1) var<storage, read> prefix: array<f32>;
@group(0) @binding(2) var<storage, read> suffix: array<f32>;
@group(0) @binding(3) var<storage, read> spans: array<Span>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

// Blocks of 32 queries and 32 keys with 32 of their terms, in rows of nine vectors, and 32 × 32 weights, in
// rows of 33 words.
var<workgroup> query_tile: array<vec4<f32>, 288>;
var<workgroup> key_tile: array<vec4<f32>, 288>;
var<workgroup> weights: array<f32, 1056>;
// Partial results of the eight threads of each query.
var<workgroup> partial: array<f32, 256>;
// Factor of each query's earlier sums, and the sum of its weights.
var<workgroup> factors: array<f32, 32>;
var<workgroup> totals: array<f32, 32>;

fn stored(is_prefix: bool, at: u32) -> f32 {
    if (is_prefix) {
        return prefix[at];
    }
    return suffix[at];
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let sample = group.x / BLOCKS;
    let span = spans[sample];
    let n_queries = span.n_queries * GROUP;
    let first = group.x % BLOCKS * 32u;
    if (first >= n_queries) {
        return;
    }
    let query_start = span.first_query * GROUP * QUERY_STRIDE + group.y * HEAD;
    // A thread computes four scores of one query, and the sums of columns x, x + 32 and so on for the four
    // queries from 4 y.
    let query = thread / 8u;
    let lane = thread % 8u;
    let x = thread % 32u;
    let y = thread / 32u;
    var sums: array<vec4<f32>, 8>;
    var largest = -1e30;
    var weight_sum = 0.0;
    let prefix_blocks = (span.n_keys + 31u) / 32u;
    let blocks = prefix_blocks + (SUFFIX + 31u) / 32u;
    for (var block = 0u; block < blocks; block++) {
        let is_prefix = block < prefix_blocks;
        var first_key = block * 32u;
        var n_keys = span.n_keys;
        var first_row = span.first_key;
        if (!is_prefix) {
            first_key -= prefix_blocks * 32u;
            n_keys = SUFFIX;
            first_row = sample * SUFFIX;
        }
        let key_start = first_row * KEY_STRIDE + group.y * KEY_STEP;
        var scores = vec4(0.0);
        for (var i0 = 0u; i0 < HEAD; i0 += 32u) {
            // A thread loads four terms of one query and one key.
            let i = i0 + 4u * lane;
            let query_at = query_start + min(first + query, n_queries - 1u) * QUERY_STRIDE + i;
            let key_at = key_start + min(first_key + query, n_keys - 1u) * KEY_STRIDE + i;
            var query_terms = vec4(0.0);
            var key_terms = vec4(0.0);
            for (var j = 0u; j < 4u && i + j < HEAD; j++) {
                query_terms[j] = queries[query_at + j];
                key_terms[j] = stored(is_prefix, key_at + j);
            }
            query_tile[query * 9u + lane] = query_terms;
            key_tile[query * 9u + lane] = key_terms;
            workgroupBarrier();
            for (var j = 0u; j < 8u; j++) {
                let q = query_tile[query * 9u + j];
                let at = lane * 9u + j;
                // Columns are keys; after the transposition, columns are terms.
                let keys = mat4x4(key_tile[at], key_tile[at + 72u], key_tile[at + 144u], key_tile[at + 216u]);
                let terms = transpose(keys);
                scores = fma(vec4(q.x), terms[0], scores);
                scores = fma(vec4(q.y), terms[1], scores);
                scores = fma(vec4(q.z), terms[2], scores);
                scores = fma(vec4(q.w), terms[3], scores);
            }
            workgroupBarrier();
        }
        scores /= sqrt(f32(HEAD));
        // Keys of this thread: lane, lane + 8, lane + 16, lane + 24.
        let is_key = vec4(lane, lane + 8u, lane + 16u, lane + 24u) + first_key < vec4(n_keys);
        scores = select(vec4(-1e30), scores, is_key);
        partial[thread] = max(max(scores.x, scores.y), max(scores.z, scores.w));
        workgroupBarrier();
        let earlier = largest;
        for (var i = 0u; i < 8u; i++) {
            largest = max(largest, partial[query * 8u + i]);
        }
        workgroupBarrier();
        let exponentials = select(vec4(0.0), exp(scores - largest), is_key);
        for (var i = 0u; i < 4u; i++) {
            weights[query * 33u + lane + 8u * i] = exponentials[i];
        }
        partial[thread] = exponentials.x + exponentials.y + exponentials.z + exponentials.w;
        let factor = exp(earlier - largest);
        factors[query] = factor;
        workgroupBarrier();
        weight_sum *= factor;
        for (var i = 0u; i < 8u; i++) {
            weight_sum += partial[query * 8u + i];
        }
        let q = 4u * y;
        let scale = vec4(factors[q], factors[q + 1u], factors[q + 2u], factors[q + 3u]);
        for (var column = 0u; column < (HEAD + 31u) / 32u; column++) {
            sums[column] *= scale;
        }
        for (var key = 0u; key < min(32u, n_keys - first_key); key++) {
            let w = q * 33u + key;
            let weight = vec4(weights[w], weights[w + 33u], weights[w + 66u], weights[w + 99u]);
            let row = key_start + (first_key + key) * KEY_STRIDE + VALUES;
            for (var column = 0u; column < (HEAD + 31u) / 32u; column++) {
                let value = stored(is_prefix, row + min(column * 32u + x, HEAD - 1u));
                sums[column] = fma(weight, vec4(value), sums[column]);
            }
        }
        workgroupBarrier();
    }
    totals[query] = weight_sum;
    workgroupBarrier();
    for (var i = 0u; i < 4u && first + 4u * y + i < n_queries; i++) {
        let start = query_start + (first + 4u * y + i) * QUERY_STRIDE;
        for (var column = 0u; column * 32u + x < HEAD; column++) {
            out[start + column * 32u + x] = sums[column][i] / totals[4u * y + i];
        }
    }
}
