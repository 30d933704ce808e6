//! MP4 encoder: `ffmpeg`, which reads raw frames from a pipe.

use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use thiserror::Error;

use super::STEPS_PER_S;
use crate::show::MARK;
use crate::show::contact_sheet::RgbImage;

/// The program, on the `PATH`.
pub(crate) const FFMPEG: &str = "ffmpeg";
/// Arguments that set the codec. Players expect chroma at half the resolution, hence even sizes, and the
/// index before the frames.
const CODEC: &str =
    "-vf pad=ceil(iw/2)*2:ceil(ih/2)*2 -c:v libx264 -crf 20 -pix_fmt yuv420p -movflags +faststart";

/// Errors that can occur while `ffmpeg` encodes a movie.
#[derive(Debug, Error)]
pub enum Mp4Error {
    /// The program is not installed.
    #[error(
        "ffmpeg, which writes .mp4, is not installed: install it, for example with `apt install ffmpeg`, or \
         choose a name that ends in .gif, .png or .apng, which need no other program"
    )]
    Missing,
    /// The program could not be started, or its output could not be read.
    #[error("failed to run ffmpeg")]
    Run(#[source] io::Error),
    /// The program ended with an error.
    #[error("ffmpeg failed: {message}")]
    Failed {
        /// Text that it printed.
        message: String,
    },
}

/// An MP4 file that is being written. Dropping the value ends the program.
pub(crate) struct Mp4(Child);

impl Mp4 {
    /// Starts the program, which writes to `path`, and passes the first frame.
    pub(crate) fn begin(
        program: &Path,
        path: &Path,
        steps_per_frame: u16,
        first: &RgbImage,
    ) -> Result<Self, Mp4Error> {
        let [width, height] = first.size();
        let input = format!(
            "-y -loglevel error -f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {STEPS_PER_S}/{steps_per_frame} -i -"
        );
        // A name may look like an option or a URL.
        let mut output = OsString::from("file:");
        output.push(path);
        let child = Command::new(program)
            .args(input.split(' ').chain(CODEC.split(' ')))
            .args(["-metadata", &format!("comment={MARK}"), "-f", "mp4"])
            .arg(output)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| match error.kind() {
                io::ErrorKind::NotFound => Mp4Error::Missing,
                _ => Mp4Error::Run(error),
            })?;
        let mut movie = Self(child);
        movie.push(first)?;
        Ok(movie)
    }

    /// Passes a frame.
    pub(crate) fn push(&mut self, frame: &RgbImage) -> Result<(), Mp4Error> {
        let bytes: Vec<u8> = frame.pixels().flatten().collect();
        let Some(pipe) = &mut self.0.stdin else { return Ok(()) };
        // A program that ends early says why.
        pipe.write_all(&bytes).or_else(|error| self.close().and(Err(Mp4Error::Run(error))))
    }

    /// Waits for the program to complete the file.
    pub(crate) fn finish(mut self) -> Result<(), Mp4Error> {
        self.close()
    }

    fn close(&mut self) -> Result<(), Mp4Error> {
        drop(self.0.stdin.take());
        let mut message = String::new();
        if let Some(stderr) = &mut self.0.stderr {
            stderr.read_to_string(&mut message).map_err(Mp4Error::Run)?;
        }
        if self.0.wait().map_err(Mp4Error::Run)?.success() {
            return Ok(());
        }
        Err(Mp4Error::Failed { message: message.trim().to_owned() })
    }
}

impl Drop for Mp4 {
    fn drop(&mut self) {
        // Neither has an effect on a program that has ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
