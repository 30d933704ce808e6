// Rows of WIDTH values from two tables. Row i of the result is row index[i] / 2 of the first table, or of the
// second one if the index is odd. A workgroup takes a row.
override WIDTH: u32;
@group(0) @binding(0) var<storage, read> first: array<f32>;
@group(0) @binding(1) var<storage, read> second: array<f32>;
@group(0) @binding(2) var<storage, read> index: array<u32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let start = index[group.x] / 2u * WIDTH;
    let is_second = index[group.x] % 2u == 1u;
    for (var i = thread; i < WIDTH; i += 256u) {
        if (is_second) {
            out[group.x * WIDTH + i] = second[start + i];
        } else {
            out[group.x * WIDTH + i] = first[start + i];
        }
    }
}
