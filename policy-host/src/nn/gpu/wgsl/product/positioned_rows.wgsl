// Left factor of a product: rows of a matrix plus position embeddings, which are the same for all samples.
override ROWS: u32;
override K: u32;
override A_ROWS: u32;
override A_FIRST: u32;
@group(0) @binding(1) var<storage, read> a: array<f32>;
@group(0) @binding(5) var<storage, read> positions: array<f32>;

struct Place { start: u32, position: u32 }

fn place(row: u32) -> Place {
    let i = row % ROWS;
    return Place(((row / ROWS) * A_ROWS + A_FIRST + i) * K, i * K);
}

fn left(at: Place, k: u32) -> f32 {
    return a[at.start + k] + positions[at.position + k];
}

