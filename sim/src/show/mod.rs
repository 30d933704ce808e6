//! Renderings for people: the camera images at the starts of episodes, or along one episode, as a contact
//! sheet or a movie, with captions.
//!
//! Owns the colour maps for depth and segmentation and the movie file formats. It does not define what an
//! episode is: it samples scenes and steps worlds as `serve` does, with an actor that needs no policy host.

mod caption;
pub mod contact_sheet;
mod depth;
mod episode;
mod error;
mod frame_renderer;
pub mod movie;
mod scale;
mod segmentation;
mod sequence;
mod status;

pub use depth::DepthRange;
pub use episode::Actor;
pub use error::ShowError;
pub use frame_renderer::{Legend, ViewMode};
pub use scale::{SCALES, scaled};
pub use segmentation::LegendEntry;
pub use sequence::FrameSequence;
pub use status::EpisodeStatus;

/// Text in the first bytes of every image and movie, by which the program recognises its own files.
pub const MARK: &str = "written-by: hypogeum";
