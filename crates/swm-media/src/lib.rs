//! Images and videos: PNG, GIF, MP4, contact sheets.
//!
//! A [`Clip`] collects `[H, W, 3]` u8 RGB frames and saves them in the format that the file name asks for:
//!
//! ```
//! use swm_media::Clip;
//!
//! let mut clip = Clip::new(16, 24, 10.0);
//! for level in [0, 128, 255] {
//!     clip.push(&[level; 16 * 24 * 3])?;
//! }
//! # let folder = tempfile::tempdir().expect("a temporary folder");
//! # let path = folder.path().join("fade.gif");
//! clip.upscaled(224).save(&path)?;
//! # Ok::<(), swm_media::MediaError>(())
//! ```
//!
//! | extension | what a clip becomes |
//! |---|---|
//! | `.png` | its frame, or all of them side by side |
//! | `.gif` | a video that loops for ever; exact while all frames together have at most 256 colors |
//! | `.mp4` | an H.264 video; lossy; feature `mp4` |
//!
//! Equal frames give equal bytes: no clock, thread count or hash order reaches a file. A file appears whole or not at
//! all, see [`MediaError::Write`].
//!
//! Datasets also read videos and images back: [`mp4::Mp4Reader`], [`jpeg`], [`png::decode_into`].
//!
//! What is deliberately absent: sound, text, resampling other than [`Clip::upscaled`], and any
//! knowledge of environments or episodes.

mod clip;
mod error;
mod file;
mod format;
pub mod gif;
#[cfg(feature = "jpeg")]
pub mod jpeg;
#[cfg(feature = "mp4")]
pub mod mp4;
pub mod planar;
pub mod png;
mod save;
pub mod sheet;

pub use clip::Clip;
pub use error::MediaError;
pub use format::Format;
pub use sheet::{contact_sheet, framed};
