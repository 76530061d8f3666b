//! The errors of this crate.

use std::path::PathBuf;

use crate::format::Format;

/// Why an image or a video could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MediaError {
    /// A frame is not `[H, W, 3]`.
    #[error(
        "a frame of {height} x {width} pixels has {} bytes (H x W x 3), got {found}; all frames of a clip or sheet have one size",
        .height.saturating_mul(*.width).saturating_mul(3)
    )]
    FrameLength {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
        /// Bytes of the frame that was given.
        found: usize,
    },
    /// There is no frame to write.
    #[error("the clip has no frame; push at least one before it is saved")]
    EmptyClip,
    /// A contact sheet without cells.
    #[error("the contact sheet has no cell; give at least one row with one frame")]
    EmptySheet,
    /// The frames do not fit the format.
    #[error("{format} holds frames of {min} to {max} pixels a side, these have {height} x {width}; {fix}")]
    FrameSize {
        /// The format.
        format: Format,
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
        /// The shortest side that the format can hold, in pixels.
        min: usize,
        /// The longest side that the format can hold, in pixels.
        max: usize,
        /// What to do about it.
        fix: &'static str,
    },
    /// The frame rate is not a finite number above 0.
    #[error("a video needs a frame rate above 0 frames per second, got {frames_per_second}")]
    FrameRate {
        /// What was given.
        frames_per_second: f64,
    },
    /// The file name says no format that we know.
    #[error("{}: no known format; name the file {}", path.display(), Format::known())]
    UnknownFormat {
        /// The file that was asked for.
        path: PathBuf,
    },
    /// The crate was built without the format.
    #[error(
        "this build writes no {format}; build with the feature `mp4` (needs a C++ compiler), or save a .gif"
    )]
    NotBuilt {
        /// The format that was asked for.
        format: Format,
    },
    /// The encoder of the format refused.
    #[error("failed to encode {format}: {reason}")]
    Encode {
        /// The format.
        format: Format,
        /// What the encoder said.
        reason: String,
    },
    /// A file may be valid, but this crate does not read its kind.
    #[error("{format}: {reason}")]
    Unsupported {
        /// The format.
        format: Format,
        /// What is not read, and the fix.
        reason: String,
    },
    /// A file could not be read back.
    #[error("failed to decode {format}: {reason}")]
    Decode {
        /// The format.
        format: Format,
        /// What is wrong with it.
        reason: String,
    },
    /// The file could not be written. What stood at `path` before still stands there, untouched.
    #[error("failed to write {}: {source}", path.display())]
    Write {
        /// The file that was asked for.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl MediaError {
    pub(crate) fn encode(format: Format, reason: &impl ToString) -> Self {
        Self::Encode { format, reason: reason.to_string() }
    }
}
