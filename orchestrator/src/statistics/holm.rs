//! Holm's correction for many tests (S. Holm, Scandinavian Journal of Statistics 6:65, 1979).

/// Returns the adjusted p-values, in the order of `p_values`. Rejecting those of at most α keeps the
/// probability of any false rejection at or below α, whatever the dependence of the tests.
#[must_use]
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut adjusted = vec![0.0; p_values.len()];
    let mut largest = 0.0_f64;
    for (rank, &idx) in order.iter().enumerate() {
        largest = largest.max((p_values.len() - rank) as f64 * p_values[idx]).min(1.0);
        adjusted[idx] = largest;
    }
    adjusted
}
