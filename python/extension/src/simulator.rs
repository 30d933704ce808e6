//! The class `Simulator`: envs whose observations are written into numpy arrays.

#![expect(clippy::needless_pass_by_value, reason = "PyO3 passes arguments by value")]

use std::process;
use std::sync::{Mutex, MutexGuard, TryLockError};

use ipc_types::Morphology;
use numpy::{
    PyArray1, PyReadonlyArray1, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray4, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use run_config::error_chain;
use sim::episode::vector::{EpisodeProgress, EpisodeStart, VectorEnv, VectorError, VectorOptions};
use sim::trajectory::TrajectoryFile;

use super::arguments::{composition, morphology, require_finite, run_config, task};

/// Envs of one morphology, stepped and rendered in parallel outside the interpreter's lock.
#[pyclass(frozen)]
pub(crate) struct Simulator {
    envs: Mutex<VectorEnv>,
    n_envs: usize,
    morphology: Morphology,
    action_dim: usize,
    control_mode: &'static str,
    /// Name, height and width of each camera.
    cameras: Vec<(&'static str, usize, usize)>,
    renderer: Option<String>,
    /// Process in which the worker threads run.
    process: u32,
}

#[pymethods]
impl Simulator {
    /// Creates envs without episodes. `words` are options in the form of the command line.
    #[new]
    fn new(
        py: Python<'_>,
        num_envs: usize,
        morphology_name: &str,
        images: bool,
        words: Vec<String>,
    ) -> PyResult<Self> {
        let config = run_config(words)?;
        let morphology = morphology(morphology_name)?;
        let image_size = config.results.protocol.image_size;
        let options = VectorOptions {
            n_envs: num_envs,
            morphology,
            images: images.then_some(config.rendering),
            gpu: config.resources.gpu,
            n_threads: config.resources.n_threads() as usize,
            results: config.results,
        };
        let envs = py.detach(|| VectorEnv::new(options)).map_err(|error| to_python(&error))?;
        let camera = |(i, name): (usize, &&'static str)| {
            let size = image_size.of_camera(morphology, i);
            (*name, size.height, size.width)
        };
        Ok(Self {
            n_envs: num_envs,
            morphology,
            action_dim: envs.action_dim(),
            control_mode: envs.control_mode().name(),
            cameras: morphology.camera_names().iter().enumerate().map(camera).collect(),
            renderer: envs.renderer_name(),
            process: process::id(),
            envs: Mutex::new(envs),
        })
    }

    #[getter]
    fn state_dim(&self) -> usize {
        self.morphology.state_dim()
    }

    #[getter]
    fn action_dim(&self) -> usize {
        self.action_dim
    }

    #[getter]
    fn control_mode(&self) -> &'static str {
        self.control_mode
    }

    #[getter]
    fn cameras(&self) -> Vec<(&'static str, usize, usize)> {
        self.cameras.clone()
    }

    #[getter]
    fn renderer(&self) -> Option<&str> {
        self.renderer.as_deref()
    }

    /// Starts episodes: of each, the env, task, perturbation and index. The suite seed is that of all.
    fn reset(&self, py: Python<'_>, starts: Vec<(usize, String, String, u32)>, seed: u64) -> PyResult<()> {
        let start = |(env, task_name, perturbation, episode): &(usize, String, String, u32)| {
            let (task, perturbation) = (task(task_name)?, composition(perturbation)?);
            self.require_env(*env)?;
            Ok((*env, EpisodeStart { task, perturbation, episode: *episode, suite_seed: seed }))
        };
        let starts = starts.iter().map(start).collect::<PyResult<Vec<_>>>()?;
        let mut guard = self.lock()?;
        let envs = &mut *guard;
        py.detach(|| envs.reset(&starts)).map_err(|error| to_python(&error))
    }

    /// Executes `actions`, `[num_envs, n_rows, action_dim]` f32, in the envs whose entry of `envs` is true,
    /// each until its episode is over.
    fn step(
        &self,
        py: Python<'_>,
        envs: PyReadonlyArray1<'_, bool>,
        actions: PyReadonlyArray3<'_, f32>,
    ) -> PyResult<()> {
        let [n, n_rows, dim]: [usize; 3] = actions.shape().try_into().expect("the array has three axes");
        if (n, dim) != (self.n_envs, self.action_dim) || n_rows == 0 {
            let (n_envs, action_dim) = (self.n_envs, self.action_dim);
            let message = format!(
                "actions are of shape [{n}, {n_rows}, {dim}], expected [{n_envs}, rows, {action_dim}] with \
                 at least one row"
            );
            return Err(PyValueError::new_err(message));
        }
        let (named, rows) = (self.mask(&envs)?, actions.as_slice()?);
        require_finite(rows, [n, n_rows, dim], named)?;
        let mut guard = self.lock()?;
        let envs = &mut *guard;
        py.detach(|| envs.step(named, rows, n_rows)).map_err(|error| to_python(&error))
    }

    /// Writes the observations of the envs whose entry of `envs` is true into arrays of all envs: `states`,
    /// `[num_envs, state_dim]` f32, and for each wanted camera its index and `[num_envs, height, width, 3]`
    /// u8.
    fn observe(
        &self,
        py: Python<'_>,
        envs: PyReadonlyArray1<'_, bool>,
        mut states: PyReadwriteArray2<'_, f32>,
        mut images: Vec<(usize, PyReadwriteArray4<'_, u8>)>,
    ) -> PyResult<()> {
        let state_shape = [self.n_envs, self.morphology.state_dim()];
        if states.shape() != state_shape {
            let message = format!("states are of shape {:?}, expected {state_shape:?}", states.shape());
            return Err(PyValueError::new_err(message));
        }
        for (camera, array) in &images {
            let known = self.cameras.get(*camera);
            let (_, height, width) =
                known.ok_or_else(|| PyValueError::new_err(format!("there is no camera {camera}")))?;
            let shape = [self.n_envs, *height, *width, 3];
            if array.shape() != shape {
                let message = format!("images are of shape {:?}, expected {shape:?}", array.shape());
                return Err(PyValueError::new_err(message));
            }
        }
        let named = self.mask(&envs)?;
        let states = states.as_slice_mut()?;
        let views = images.iter_mut().map(|(camera, array)| Ok((*camera, array.as_slice_mut()?)));
        let mut views = views.collect::<PyResult<Vec<_>>>()?;
        let mut guard = self.lock()?;
        let envs = &mut *guard;
        py.detach(|| envs.observe(named, states, &mut views)).map_err(|error| to_python(&error))
    }

    /// Returns whether the episode of each env has succeeded, is over, and has ended by its success: three
    /// arrays of `[num_envs]` bool.
    fn progress<'py>(&self, py: Python<'py>) -> PyResult<[Bound<'py, PyArray1<bool>>; 3]> {
        let envs = self.lock()?;
        let all = (0..self.n_envs).map(|env| envs.progress(env)).collect::<Result<Vec<_>, _>>();
        let all = all.map_err(|error| to_python(&error))?;
        let flags = |flag: fn(&EpisodeProgress) -> bool| PyArray1::from_iter(py, all.iter().map(flag));
        Ok([flags(|it| it.first_success_step.is_some()), flags(|it| it.is_over), flags(|it| it.is_won)])
    }

    /// Returns the identity, the progress and the fingerprint of the episode in an env.
    fn info<'py>(&self, py: Python<'py>, env: usize) -> PyResult<Bound<'py, PyDict>> {
        let envs = self.lock()?;
        let (start, instruction) = envs.episode(env).map_err(|error| to_python(&error))?;
        let progress = envs.progress(env).map_err(|error| to_python(&error))?;
        let fingerprint = envs.fingerprint(env).map_err(|error| to_python(&error))?;
        let dict = PyDict::new(py);
        dict.set_item("task", start.task.name())?;
        dict.set_item("perturbation", start.perturbation.name())?;
        dict.set_item("episode", start.episode)?;
        dict.set_item("seed", start.seed())?;
        dict.set_item("instruction", instruction)?;
        dict.set_item("steps", progress.steps)?;
        dict.set_item("is_success", progress.first_success_step.is_some() && progress.error.is_none())?;
        dict.set_item("success_at_end", progress.unmet.is_none() && progress.error.is_none())?;
        dict.set_item("first_success_step", progress.first_success_step)?;
        dict.set_item("failed_predicate", progress.unmet)?;
        dict.set_item("fingerprint", format!("{fingerprint:016x}"))?;
        dict.set_item("error", progress.error.map(|error| error.to_string()))?;
        Ok(dict)
    }

    /// Returns the state of an env as JSON in the format of `replay --start`.
    fn state(&self, env: usize) -> PyResult<String> {
        let file = self.lock()?.state(env).map_err(|error| to_python(&error))?;
        serde_json::to_string(&file).map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }

    /// Puts an env into a state, given as JSON in the format of `replay --start`.
    fn set_state(&self, env: usize, state: &str) -> PyResult<()> {
        self.require_env(env)?;
        let file: TrajectoryFile = serde_json::from_str(state).map_err(|error| {
            PyValueError::new_err(format!("the state is not one of docs/trajectories.md: {error}"))
        })?;
        self.lock()?.set_state(env, &file).map_err(|error| to_python(&error))
    }
}

impl Simulator {
    fn lock(&self) -> PyResult<MutexGuard<'_, VectorEnv>> {
        if process::id() != self.process {
            let message = "the env was made in another process, and its threads do not survive a fork; make it \
                           in the child, or start processes with `spawn`";
            return Err(PyRuntimeError::new_err(message));
        }
        self.envs.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => {
                PyRuntimeError::new_err("another thread is using this env; give each thread its own")
            }
            TryLockError::Poisoned(_) => {
                PyRuntimeError::new_err("an earlier call has failed inside the simulator; make a new env")
            }
        })
    }

    fn mask<'a>(&self, envs: &'a PyReadonlyArray1<'_, bool>) -> PyResult<&'a [bool]> {
        let named = envs.as_slice()?;
        if named.len() != self.n_envs {
            let message = format!("the mask has {} entries, expected {}", named.len(), self.n_envs);
            return Err(PyValueError::new_err(message));
        }
        Ok(named)
    }

    fn require_env(&self, env: usize) -> PyResult<()> {
        if env < self.n_envs {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "there is no env {env}, only 0 to {}",
            self.n_envs.wrapping_sub(1)
        )))
    }
}

fn to_python(error: &VectorError) -> PyErr {
    let message = error_chain(error);
    match error {
        VectorError::Memory { .. } => PyMemoryError::new_err(message),
        VectorError::NotReset { .. }
        | VectorError::Threads { .. }
        | VectorError::OpenRenderer(_)
        | VectorError::Render(_)
        | VectorError::NoImages => PyRuntimeError::new_err(message),
        VectorError::Sentences(_)
        | VectorError::Morphology { .. }
        | VectorError::NotApplicable { .. }
        | VectorError::State(_)
        | VectorError::OtherTask { .. }
        | VectorError::OtherSizes { .. } => PyValueError::new_err(message),
    }
}
