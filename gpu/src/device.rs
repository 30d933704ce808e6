//! An open device, its error state, and waiting with a timeout.

use core::fmt;
use core::time::Duration;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use thiserror::Error;

use super::adapter::{self, AdapterKind, AdapterSummary, poll_ready};

/// Message of a device that cannot allocate a buffer.
const OUT_OF_MEMORY: &str = "out of memory";

/// Errors of a device.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum GpuError {
    #[error("found no {wanted}: {found}")]
    NoAdapter { wanted: String, found: String },
    #[error("failed to compute on {name}: {message}")]
    Device { name: String, message: String },
}

/// Needs of a user of a device.
#[derive(Clone, Copy, Debug)]
pub struct DeviceRequirements {
    /// Features that the adapter must have.
    pub features: wgpu::Features,
    /// Size of the largest buffer that kernels can address, in bytes.
    pub max_buffer_bytes: u64,
    /// Time after which a device that has not finished its work counts as failed.
    pub timeout: Duration,
}

/// An open device and its queue.
pub struct GpuDevice {
    /// Device of all buffers and pipelines.
    pub device: wgpu::Device,
    /// Queue of all work.
    pub queue: wgpu::Queue,
    name: String,
    max_buffer_bytes: u64,
    timeout: Duration,
    first_error: FirstError,
}

/// The first error that a device callback or a wait has reported. Later errors are ignored.
#[derive(Clone, Default)]
struct FirstError(Arc<Mutex<Option<String>>>);

impl GpuDevice {
    /// Opens an adapter of a kind by its index among those of the kind, or the first that meets the
    /// requirements.
    ///
    /// # Errors
    /// If there is none, which lists what was found, or the driver rejects the request.
    pub fn open(
        kind: AdapterKind,
        index: Option<usize>,
        requirements: &DeviceRequirements,
    ) -> Result<Self, GpuError> {
        let mut found = Vec::new();
        for (adapter, summary) in adapter::numbered() {
            let name = &summary.name;
            if summary.kind != kind {
                found.push(format!("{name} is not a {}", kind.description()));
            } else if index.is_some_and(|index| index != summary.index) {
                found.push(format!("{name} has index {}", summary.index));
            } else {
                let missing = requirements.missing(&adapter);
                if missing.is_empty() {
                    return Self::request(&adapter, summary, requirements);
                }
                found.push(format!("{name} lacks {}", missing.join(", ")));
            }
        }
        if found.is_empty() {
            found.push("there is no Vulkan driver".to_owned());
        }
        let index = index.map(|index| format!(" {index}")).unwrap_or_default();
        let wanted = format!("{}{index}", kind.description());
        Err(GpuError::NoAdapter { wanted, found: found.join("; ") })
    }

    fn request(
        adapter: &wgpu::Adapter,
        AdapterSummary { name, max_buffer_bytes, .. }: AdapterSummary,
        requirements: &DeviceRequirements,
    ) -> Result<Self, GpuError> {
        let max_buffer_bytes = max_buffer_bytes.min(requirements.max_buffer_bytes);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("hypogeum"),
            required_features: requirements.features,
            required_limits: wgpu::Limits {
                max_storage_buffer_binding_size: max_buffer_bytes,
                max_buffer_size: max_buffer_bytes,
                ..wgpu::Limits::defaults()
            },
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = poll_ready(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::Device { name: name.clone(), message: error.to_string() })?;
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
        Ok(Self { device, queue, name, max_buffer_bytes, timeout: requirements.timeout, first_error })
    }

    /// Returns the name of the adapter and its driver. Results computed on devices of different names may
    /// differ in single bits.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the size of the largest buffer that a kernel can use, in bytes.
    #[must_use]
    pub fn max_buffer_bytes(&self) -> u64 {
        self.max_buffer_bytes
    }

    /// Returns an encoder of commands.
    #[must_use]
    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    /// Checks the error state.
    ///
    /// # Errors
    /// The first error since the device was opened.
    pub fn check(&self) -> Result<(), GpuError> {
        let Some(message) = self.first_error.get() else { return Ok(()) };
        let report = (message == OUT_OF_MEMORY).then(|| self.device.generate_allocator_report()).flatten();
        Err(match report {
            Some(report) => {
                let n_mib = report.total_allocated_bytes >> 20;
                self.error(&format!("{message}; this process holds {n_mib} MiB of it"))
            }
            None => self.error(&message),
        })
    }

    /// Waits until all uploads so far have completed, which frees the host memory that they passed through.
    ///
    /// # Errors
    /// If the device fails, for example because it is out of memory.
    pub fn finish_uploads(&self) -> Result<(), GpuError> {
        self.wait(self.queue.submit([]))
    }

    /// Returns the error of a device that cannot do what is asked of it.
    #[must_use]
    pub fn error(&self, message: &str) -> GpuError {
        GpuError::Device { name: self.name.clone(), message: message.to_owned() }
    }

    /// Marks the device as failed for good.
    pub fn fail(&self, message: &str) {
        self.first_error.set(message.to_owned());
    }

    /// Runs the callbacks of what has completed.
    pub fn poll(&self) {
        if catch_unwind(AssertUnwindSafe(|| self.device.poll(wgpu::PollType::Poll))).is_err() {
            self.fail("the device was lost while computing");
        }
    }

    /// Waits until a submission has completed and its callbacks have run.
    ///
    /// # Errors
    /// If the device fails, or does not complete in time.
    pub fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let poll_type =
            wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(self.timeout) };
        // wgpu panics if the driver reports a lost device during a wait.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll_type))) {
            Ok(Ok(_)) => {}
            Ok(Err(wgpu::PollError::Timeout)) => {
                self.fail(&format!("the device did not respond within {} s", self.timeout.as_secs()));
            }
            Ok(Err(wgpu::PollError::WrongSubmissionIndex(..))) => {
                self.fail("the device was lost and accepts no more work");
            }
            Err(_) => self.fail("the device was lost while computing"),
        }
        self.check()
    }
}

impl fmt::Debug for GpuDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GpuDevice").field("name", &self.name).finish_non_exhaustive()
    }
}

impl DeviceRequirements {
    /// Lists the features and limits that an adapter lacks.
    fn missing(&self, adapter: &wgpu::Adapter) -> Vec<String> {
        let features = self.features - adapter.features();
        let mut missing: Vec<String> = features.iter_names().map(|(name, _)| name.to_owned()).collect();
        let limits = wgpu::Limits::defaults();
        limits.check_limits_with_fail_fn(&adapter.limits(), false, |name, required, available| {
            missing.push(format!("{name} {required} (available: {available})"));
        });
        missing
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
