//! The extension module `hypogeum._native`: the simulator inside a Python process.
//!
//! It only converts arguments. `python/hypogeum/envs/vector.py` wraps it in Gymnasium's interface.

mod arguments;
mod simulator;

use pyo3::prelude::*;

/// The simulator inside a Python process.
#[pymodule]
mod _native {
    use pyo3::prelude::*;
    use pyo3::types::PyDict;
    use sim::perturb::{Composition, Perturbation};
    use sim::scene::robot::panda;
    use sim::{Profile, TaskId};

    #[pymodule_export]
    use super::simulator::Simulator;

    /// Returns the tasks of the suite in the benchmark's order, each with what is fixed about it.
    #[pyfunction]
    fn tasks(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
        let describe = |task: &TaskId| {
            let (dict, it) = (PyDict::new(py), task.task());
            dict.set_item("name", task.name())?;
            dict.set_item("env_id", it.env_id)?;
            dict.set_item("category", it.category.name())?;
            dict.set_item("morphology", it.morphology.name())?;
            dict.set_item("max_steps", it.max_steps)?;
            let nominal = (it.nominal)(Profile::Strict);
            let applies = |p: &&Perturbation| Composition::single(**p).applies_to(&nominal).is_ok();
            let perturbations = Perturbation::ALL.iter().filter(applies).map(|it| it.name());
            dict.set_item("perturbations", perturbations.collect::<Vec<_>>())?;
            Ok(dict)
        };
        TaskId::ALL.iter().map(describe).collect()
    }

    /// Returns the limits of the joints of an arm in rad, base to wrist.
    #[pyfunction]
    fn joint_limits() -> Vec<(f64, f64)> {
        panda::LOWER.into_iter().zip(panda::UPPER).collect()
    }

    /// Returns the names of the perturbations, the unperturbed condition first.
    #[pyfunction]
    fn perturbations() -> Vec<&'static str> {
        Perturbation::ALL.iter().map(|it| it.name()).collect()
    }
}
