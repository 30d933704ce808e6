// Left factor of a product: rows of a matrix. Row i of a sample is row A_FIRST + i of its A_ROWS rows.
override ROWS: u32;
override K: u32;
override A_ROWS: u32;
override A_FIRST: u32;
@group(0) @binding(1) var<storage, read> a: array<f32>;

struct Place { start: u32 }

fn place(row: u32) -> Place {
    return Place(((row / ROWS) * A_ROWS + A_FIRST + row % ROWS) * K);
}

fn left(at: Place, k: u32) -> f32 {
    return a[at.start + k];
}

