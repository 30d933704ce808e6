//! The open device, its error state, and waiting with a timeout.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::adapter::{self, SelectedAdapter, poll_ready};
use crate::renderer::{OpenRendererError, RenderError};

/// Timeout after which a device that has not finished a chunk counts as failed.
const WAIT_TIMEOUT: Duration = Duration::from_secs(60);

/// Message of a device that cannot allocate a buffer or texture.
const OUT_OF_MEMORY: &str = "out of memory";

/// A device and its queue.
pub(crate) struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    /// Name of the adapter and its driver, for messages.
    pub(crate) name: String,
    /// Maximum size of a storage buffer that is bound as a whole.
    pub(crate) max_buffer_bytes: u64,
    /// Maximum number of layers of a texture.
    pub(crate) max_texture_layers: u32,
    first_error: FirstError,
}

/// The first error that a device callback or a wait has reported. Later errors are ignored.
#[derive(Clone, Default)]
struct FirstError(Arc<Mutex<Option<String>>>);

impl Gpu {
    /// Opens an adapter.
    ///
    /// # Errors
    /// If the driver rejects the request.
    pub(crate) fn open(selected: SelectedAdapter) -> Result<Self, OpenRendererError> {
        let (required_features, mut required_limits) = adapter::required(selected.visibility);
        let available = selected.adapter.limits();
        let max_buffer_bytes = available.max_storage_buffer_binding_size.min(available.max_buffer_size);
        required_limits.max_storage_buffer_binding_size = available.max_storage_buffer_binding_size;
        required_limits.max_buffer_size = available.max_buffer_size;
        required_limits.max_texture_array_layers = available.max_texture_array_layers;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("hypogeum"),
            required_features,
            required_limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = poll_ready(selected.adapter.request_device(&descriptor)).map_err(|error| {
            OpenRendererError::Device { name: selected.name.clone(), message: error.to_string() }
        })?;
        let first_error = FirstError::default();
        let (on_lost, on_error) = (first_error.clone(), first_error.clone());
        device.set_device_lost_callback(move |reason, message| {
            on_lost.set(format!("the device was lost ({reason:?}): {message}"));
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            on_error.set(match error {
                wgpu::Error::OutOfMemory { .. } => OUT_OF_MEMORY.to_owned(),
                other => other.to_string(),
            });
        }));
        let max_texture_layers = available.max_texture_array_layers;
        Ok(Self { device, queue, name: selected.name, max_buffer_bytes, max_texture_layers, first_error })
    }

    /// Checks the error state.
    ///
    /// # Errors
    /// The first error since the device was opened.
    pub(crate) fn check(&self) -> Result<(), RenderError> {
        let Some(mut message) = self.first_error.get() else { return Ok(()) };
        if message == OUT_OF_MEMORY
            && let Some(report) = self.device.generate_allocator_report()
        {
            message += &format!("; this process holds {} MiB of it", report.total_allocated_bytes >> 20);
        }
        Err(RenderError::Device { name: self.name.clone(), message })
    }

    /// Marks the device as failed permanently.
    pub(crate) fn fail(&self, message: String) {
        self.first_error.set(message);
    }

    /// Waits until a submission has completed and its callbacks have run.
    ///
    /// # Errors
    /// If the device fails, or does not complete within [`WAIT_TIMEOUT`].
    pub(crate) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), RenderError> {
        let poll_type =
            wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(WAIT_TIMEOUT) };
        // wgpu panics if the driver reports a lost device during a wait.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll_type))) {
            Ok(Ok(_)) => {}
            Ok(Err(wgpu::PollError::Timeout)) => {
                self.fail(format!("the device did not respond within {} s", WAIT_TIMEOUT.as_secs()));
            }
            Ok(Err(wgpu::PollError::WrongSubmissionIndex(..))) => {
                self.fail("the device was lost and accepts no more work".to_owned());
            }
            Err(_) => self.fail("the device was lost while rendering".to_owned()),
        }
        self.check()
    }
}

impl FirstError {
    fn get(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, message: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }
}
