//! The tensors of a network in memory, keyed by name.

use std::collections::BTreeMap;

/// Tensors by name, each stored row-major as f32, like PyTorch's `state_dict`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StateDict {
    tensors: BTreeMap<String, Vec<f32>>,
}

impl StateDict {
    /// Adds a tensor.
    pub fn insert(&mut self, name: String, values: Vec<f32>) {
        self.tensors.insert(name, values);
    }

    /// Returns the values of a tensor.
    ///
    /// # Panics
    /// If the tensor is missing: callers check the weights file against the architecture first.
    #[must_use]
    pub fn get(&self, name: &str) -> &[f32] {
        self.tensors.get(name).unwrap_or_else(|| panic!("the checked state dict lacks `{name}`"))
    }
}
