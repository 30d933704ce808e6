// Rotary position embedding, in place, of the first HEADS heads of every row of STRIDE values. Entries i of
// both halves of a head are a point, which is turned by an angle proportional to the row's position.
override ROWS: u32;
override STRIDE: u32;
override HEADS: u32;
override HALF: u32;
// Cosine and sine of every angle, [positions, HALF].
@group(0) @binding(1) var<storage, read> angles: array<vec2<f32>>;
// Position of every row, [n_samples · ROWS].
@group(0) @binding(2) var<storage, read> positions: array<u32>;
@group(0) @binding(3) var<storage, read_write> x: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let items = HEADS * HALF;
    let row = id.x / items;
    if (row >= batch.n_samples * ROWS) {
        return;
    }
    let i = id.x % HALF;
    let first = row * STRIDE + id.x % items / HALF * 2u * HALF + i;
    let turn = angles[positions[row] * HALF + i];
    let point = vec2(x[first], x[first + HALF]);
    x[first] = point.x * turn.x - point.y * turn.y;
    x[first + HALF] = point.y * turn.x + point.x * turn.y;
}
