//! The tensors of a network, by the names the benchmark gives them.

use std::collections::BTreeMap;

/// Tensors, each row-major.
#[derive(Clone, Debug, Default)]
pub struct Weights {
    tensors: BTreeMap<String, Vec<f32>>,
}

impl Weights {
    /// Adds a tensor.
    pub fn insert(&mut self, name: String, numbers: Vec<f32>) {
        self.tensors.insert(name, numbers);
    }

    /// A tensor that the specification says is there.
    ///
    /// # Panics
    /// If it is not: weights are checked before they are used.
    #[must_use]
    pub fn get(&self, name: &str) -> &[f32] {
        self.tensors.get(name).unwrap_or_else(|| panic!("checked weights lack `{name}`"))
    }
}
