//! The open device, how it fails, and waiting for it with an end.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::adapter::{self, Found};
use super::ready;
use crate::render::RenderError;
use crate::render::open::OpenRendererError;

/// A device that has not finished a chunk after this long is given up.
const PATIENCE: Duration = Duration::from_secs(60);

/// A device and its queue.
pub(super) struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// Name of adapter and driver, for people.
    pub(super) name: String,
    failure: Failure,
}

/// The first thing that went wrong, told by callbacks of the device.
#[derive(Clone, Default)]
struct Failure(Arc<Mutex<Option<String>>>);

impl Gpu {
    /// Opens an adapter.
    ///
    /// # Errors
    /// If the driver refuses.
    pub(super) fn open(found: Found) -> Result<Self, OpenRendererError> {
        let (required_features, required_limits) = adapter::required(found.visibility);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("hypogeum"),
            required_features,
            required_limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = ready(found.adapter.request_device(&descriptor)).map_err(|error| {
            OpenRendererError::Device { name: found.name.clone(), message: error.to_string() }
        })?;
        let failure = Failure::default();
        let (lost, wrong) = (failure.clone(), failure.clone());
        device.set_device_lost_callback(move |reason, message| {
            lost.set(format!("it was lost ({reason:?}): {message}"));
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| wrong.set(error.to_string())));
        Ok(Self { device, queue, name: found.name, failure })
    }

    /// Whether all is well.
    ///
    /// # Errors
    /// The first thing that went wrong since the device was opened.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        match self.failure.get() {
            Some(message) => Err(RenderError::Device { name: self.name.clone(), message }),
            None => Ok(()),
        }
    }

    /// Notes a failure, for good.
    pub(super) fn fail(&self, message: String) {
        self.failure.set(message);
    }

    /// Waits until a submission is done and its callbacks have been called.
    ///
    /// # Errors
    /// If the device fails, or is not done within a minute.
    pub(super) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), RenderError> {
        let poll_type = wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) };
        // wgpu panics when the driver says in the middle of a wait that the device is lost.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll_type))) {
            Ok(Ok(_)) => {}
            Ok(Err(wgpu::PollError::Timeout)) => {
                self.fail(format!("it has not answered for {} s", PATIENCE.as_secs()));
            }
            Ok(Err(wgpu::PollError::WrongSubmissionIndex(..))) => {
                self.fail("it was lost and takes no more work".to_owned());
            }
            Err(_) => self.fail("it was lost while it drew".to_owned()),
        }
        self.check()
    }
}

impl Failure {
    fn get(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, message: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }
}
