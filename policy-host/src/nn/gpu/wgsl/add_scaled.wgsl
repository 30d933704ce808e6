// x += FACTOR · y, over ITEMS values of each sample.
override ITEMS: u32;
// The factor as the bits of an f32.
override FACTOR: u32;
@group(0) @binding(1) var<storage, read> y: array<f32>;
@group(0) @binding(2) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= batch.n_samples * ITEMS) {
        return;
    }
    var factor_bits = FACTOR;
    x[id.x] = fma(bitcast<f32>(factor_bits), y[id.x], x[id.x]);
}
