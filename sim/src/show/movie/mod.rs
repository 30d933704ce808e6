//! Movies that play at the speed of the simulation, in file formats that play wherever images are displayed.
//!
//! Most pixels do not change from one frame to the next. They are encoded as transparent, which takes almost
//! no space in either format.

mod apng;
mod error;
mod format;
mod gif;
mod part_file;
#[cfg(test)]
mod tests;
mod writer;

use crate::physics::CONTROL_HZ;

pub use error::{EncodeError, MovieError};
pub use format::{MovieFormat, UnknownFormat};
pub use writer::MovieWriter;

/// Control steps per second, which movies play in real time.
const STEPS_PER_S: u16 = CONTROL_HZ as u16;
