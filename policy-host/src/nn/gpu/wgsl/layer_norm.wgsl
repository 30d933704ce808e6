// Layer normalisation of rows of WIDTH values in place. A workgroup takes a row.
override WIDTH: u32;
@group(0) @binding(0) var<storage, read> weight: array<f32>;
@group(0) @binding(1) var<storage, read> bias: array<f32>;
@group(0) @binding(2) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let start = group.x * WIDTH;
    var sum = 0.0;
    for (var i = thread; i < WIDTH; i += 64u) {
        sum += x[start + i];
    }
    let mean = total(thread, sum) / f32(WIDTH);
    var squares = 0.0;
    for (var i = thread; i < WIDTH; i += 64u) {
        let difference = x[start + i] - mean;
        squares += difference * difference;
    }
    // `LayerNorm::EPSILON` is added to the variance.
    let inverse = 1.0 / sqrt(total(thread, squares) / f32(WIDTH) + 1e-5);
    for (var i = thread; i < WIDTH; i += 64u) {
        x[start + i] = (x[start + i] - mean) * inverse * weight[i] + bias[i];
    }
}
