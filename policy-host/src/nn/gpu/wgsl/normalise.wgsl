// Normalisation of rows of WIDTH values into another buffer, with a scale and a shift [WIDTH]:
// out = (x - mean) / √(variance + ε) · scale + shift. A workgroup takes a row.
override WIDTH: u32;
// 1 for layer normalisation. 0 for RMS normalisation, which takes the mean as 0.
override CENTRES: u32;
// ε as the bits of an f32.
override EPSILON: u32;
@group(0) @binding(0) var<storage, read> x: array<f32>;
@group(0) @binding(1) var<storage, read> scale: array<f32>;
@group(0) @binding(2) var<storage, read> shift: array<f32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let start = group.x * WIDTH;
    var mean = 0.0;
    if (CENTRES == 1u) {
        var sum = 0.0;
        for (var i = thread; i < WIDTH; i += 64u) {
            sum += x[start + i];
        }
        mean = total(thread, sum) / f32(WIDTH);
    }
    var squares = 0.0;
    for (var i = thread; i < WIDTH; i += 64u) {
        let difference = x[start + i] - mean;
        squares += difference * difference;
    }
    var epsilon_bits = EPSILON;
    let inverse = 1.0 / sqrt(total(thread, squares) / f32(WIDTH) + bitcast<f32>(epsilon_bits));
    for (var i = thread; i < WIDTH; i += 64u) {
        out[start + i] = (x[start + i] - mean) * inverse * scale[i] + shift[i];
    }
}
