//! Movies that play at the speed of the simulation, in file formats that play wherever images are displayed.
//!
//! Most pixels do not change from one frame to the next. GIF and animated PNG encode them as transparent,
//! which takes almost no space. MP4 needs the program `ffmpeg`.

mod apng;
mod error;
mod format;
mod gif;
mod mp4;
mod part_file;
#[cfg(test)]
mod tests;
mod writer;

use crate::physics::CONTROL_HZ;

pub use error::{EncodeError, MovieError};
pub use format::{MovieFormat, UnknownFormat};
pub use mp4::Mp4Error;
pub use writer::MovieWriter;

/// Control steps per second, which movies play in real time.
const STEPS_PER_S: u16 = CONTROL_HZ as u16;
