//! Selection and opening of an adapter, its error state, and waiting with a timeout.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use thiserror::Error;

use super::adapters::{self, DeviceKind, poll_ready};

/// Timeout after which a device that has not finished a batch counts as failed.
const WAIT_TIMEOUT: Duration = Duration::from_secs(300);
/// Largest buffer that a kernel addresses, in bytes: indices are 32-bit.
const MAX_BINDING: u64 = 1 << 31;

/// Message of a device that cannot allocate a buffer.
const OUT_OF_MEMORY: &str = "out of memory";

/// Errors of a device.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum GpuError {
    #[error("found no {wanted} for the policy: {found}")]
    NoAdapter { wanted: String, found: String },
    #[error("failed to compute on {name}: {message}")]
    Device { name: String, message: String },
}

/// An open device and its queue.
pub struct GpuDevice {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    name: String,
    max_binding: u64,
    first_error: DeviceFault,
}

/// The first error that a device callback or a wait has reported. Later errors are ignored.
#[derive(Clone, Default)]
struct DeviceFault(Arc<Mutex<Option<String>>>);

impl GpuDevice {
    /// Opens the first adapter of a kind, discrete GPUs before integrated ones.
    ///
    /// # Errors
    /// See [`Self::open_numbered`].
    pub fn open(kind: DeviceKind) -> Result<Self, GpuError> {
        Self::open_numbered(kind, 0)
    }

    /// Opens an adapter by its index among those of its kind, in the order of [`adapters::adapters`].
    ///
    /// # Errors
    /// If there is none, which lists what was found, or the driver rejects the request.
    pub fn open_numbered(kind: DeviceKind, index: usize) -> Result<Self, GpuError> {
        let (mut found, mut n_before) = (Vec::new(), 0);
        for adapter in adapters::enumerate() {
            let info = adapter.get_info();
            let name = adapters::name(&info);
            if !kind.matches(info.device_type) {
                found.push(format!("{name} is not a {}", kind.description()));
            } else if n_before == index {
                return Self::open_adapter(&adapter, name);
            } else {
                found.push(format!("{name} has index {n_before}"));
                n_before += 1;
            }
        }
        if found.is_empty() {
            found.push("there is no Vulkan driver".to_owned());
        }
        let wanted = match index {
            0 => kind.description().to_owned(),
            _ => format!("{} {index}", kind.description()),
        };
        Err(GpuError::NoAdapter { wanted, found: found.join("; ") })
    }

    fn open_adapter(adapter: &wgpu::Adapter, name: String) -> Result<Self, GpuError> {
        let available = adapter.limits();
        let max_binding =
            available.max_storage_buffer_binding_size.min(available.max_buffer_size).min(MAX_BINDING);
        let required_limits = wgpu::Limits {
            max_storage_buffer_binding_size: max_binding,
            max_buffer_size: max_binding,
            ..wgpu::Limits::defaults()
        };
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("hypogeum policy"),
            required_limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = poll_ready(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::Device { name: name.clone(), message: error.to_string() })?;
        let first_error = DeviceFault::default();
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
        Ok(Self { device, queue, name, max_binding, first_error })
    }

    /// Returns the name of the adapter and its driver. Results computed on devices of different names may
    /// differ in single bits.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the size of the largest buffer that a kernel can use, in bytes.
    #[must_use]
    pub fn max_binding(&self) -> u64 {
        self.max_binding
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
    pub(crate) fn fail(&self, message: &str) {
        self.first_error.set(message.to_owned());
    }

    /// Runs the callbacks of what has completed.
    pub(crate) fn poll(&self) {
        if catch_unwind(AssertUnwindSafe(|| self.device.poll(wgpu::PollType::Poll))).is_err() {
            self.fail("the device was lost while computing");
        }
    }

    /// Waits until a submission has completed and its callbacks have run.
    ///
    /// # Errors
    /// If the device fails, or does not complete within five minutes.
    pub(crate) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let poll_type =
            wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(WAIT_TIMEOUT) };
        // wgpu panics if the driver reports a lost device during a wait.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll_type))) {
            Ok(Ok(_)) => {}
            Ok(Err(wgpu::PollError::Timeout)) => self.fail("the device did not respond within five minutes"),
            Ok(Err(wgpu::PollError::WrongSubmissionIndex(..))) => {
                self.fail("the device was lost and accepts no more work");
            }
            Err(_) => self.fail("the device was lost while computing"),
        }
        self.check()
    }
}

impl std::fmt::Debug for GpuDevice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuDevice").field("name", &self.name).finish_non_exhaustive()
    }
}

impl DeviceFault {
    fn get(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, message: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }
}
