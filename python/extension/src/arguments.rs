//! Arguments of Python: options in the words of the command line, names, and numbers that must be finite.

use clap::{Args, Command, FromArgMatches};
use ipc_types::Morphology;
use pyo3::PyResult;
use pyo3::exceptions::PyValueError;
use run_config::RunConfig;
use sim::TaskId;
use sim::perturb::{Composition, Perturbation};

/// Parses options of a run, as its command line does.
pub(crate) fn run_config(words: Vec<String>) -> PyResult<RunConfig> {
    let command = RunConfig::augment_args(Command::new("hypogeum").no_binary_name(true));
    let config = command.try_get_matches_from(words).and_then(|it| RunConfig::from_arg_matches(&it));
    let mut config = config.map_err(|error| {
        let text = error.render().to_string();
        let message = text.trim_start_matches("error: ").lines().take_while(|line| !line.is_empty());
        PyValueError::new_err(message.collect::<Vec<_>>().join("\n"))
    })?;
    config.results.protocol = config.protocol.resolve(None);
    Ok(config)
}

/// Returns the task of this name, ignoring case.
pub(crate) fn task(name: &str) -> PyResult<TaskId> {
    let task = TaskId::ALL.iter().copied().find(|task| task.name().eq_ignore_ascii_case(name));
    task.ok_or_else(|| PyValueError::new_err(format!("unknown task `{name}`")))
}

/// Returns the morphology of this name.
pub(crate) fn morphology(name: &str) -> PyResult<Morphology> {
    let morphology = Morphology::ALL.into_iter().find(|it| it.name() == name);
    morphology.ok_or_else(|| PyValueError::new_err(format!("unknown morphology `{name}`")))
}

/// Returns the perturbation, or the combination, of this name, ignoring case.
pub(crate) fn composition(name: &str) -> PyResult<Composition> {
    let perturbation = |part: &str| {
        let known = Perturbation::ALL.iter().copied().find(|it| it.name().eq_ignore_ascii_case(part));
        known.ok_or_else(|| PyValueError::new_err(format!("unknown perturbation `{part}`")))
    };
    let parts = Composition::split(name).map(perturbation).collect::<PyResult<Vec<_>>>()?;
    Composition::new(&parts).map_err(|error| PyValueError::new_err(error.to_string()))
}

/// Checks that all action rows of the named envs, `[n_envs, n_rows, action_dim]`, are finite.
pub(crate) fn require_finite(actions: &[f32], shape: [usize; 3], envs: &[bool]) -> PyResult<()> {
    let [_, n_rows, dim] = shape;
    let is_wrong = |(i, value): &(usize, &f32)| !value.is_finite() && envs[i / (n_rows * dim)];
    match actions.iter().enumerate().find(is_wrong) {
        None => Ok(()),
        Some((i, value)) => {
            let (env, row, entry) = (i / (n_rows * dim), i / dim % n_rows, i % dim);
            let message = format!(
                "the action of env {env} is {value} in row {row}, entry {entry}, expected finite numbers"
            );
            Err(PyValueError::new_err(message))
        }
    }
}
