// What becomes of the products.
override N: u32;
// Row i of a sample goes to row OUT_FIRST + i of its OUT_ROWS rows.
override OUT_ROWS: u32;
override OUT_FIRST: u32;
// 1: out = max(sum, 0). 2: out += sum. 3: out = max(out + sum, 0). 4: out = gelu(sum). 5: out *= sum.
// 6: out += gate · product, without a bias. Otherwise out = sum. A sum is a product plus the bias.
override EPILOGUE: u32;
// Bias [N], or the gate [N] of epilogue 6.
@group(0) @binding(3) var<storage, read> bias: array<f32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

// Returns x · σ(2√(2/π)·(x + 0.044715 x³)), the GELU in its form with tanh.
fn gelu(x: f32) -> f32 {
    let exponential = exp(-abs(1.5957692 * (x + 0.044715 * x * x * x)));
    return x * select(1.0, exponential, x < 0.0) / (1.0 + exponential);
}

// Returns max(x, 0), but NaN for NaN.
fn rectified(x: f32) -> f32 {
    return select(x, 0.0, x < 0.0);
}

// Returns the value to store for a product.
fn finish(product: f32, bias: f32, at: u32) -> f32 {
    if (EPILOGUE == 6u) {
        return fma(product, bias, out[at]);
    }
    let sum = product + bias;
    switch EPILOGUE {
        case 1u: { return rectified(sum); }
        case 2u: { return out[at] + sum; }
        case 3u: { return rectified(out[at] + sum); }
        case 4u: { return gelu(sum); }
        case 5u: { return out[at] * sum; }
        default: { return sum; }
    }
}
