//! Videos: H.264, encoded and decoded by the bundled OpenH264; with the feature `av1`, AV1 is decoded too.
//!
//! What is written: Baseline profile, 4:2:0, BT.601, constant quantizer, a key frame every tenth frame, the index before the images.
//! Videos of this kind play in every browser and editor; colors lose half their resolution, which a drawn scene shows
//! at saturated edges.

mod boxes;
mod codec;
mod colors;
mod decoders;
mod demux;
mod edits;
mod fragments;
mod options;
mod parameters;
mod planes;
mod reader;
mod samples;
mod slices;
mod video;

pub use self::options::{BEST_QUANTIZER, Mp4Options, SIDES};
pub use self::reader::Mp4Reader;
pub use self::video::Video;

use crate::clip::Clip;
use crate::error::MediaError;

/// The bytes of an MP4 file.
///
/// Odd sides grow by one pixel, a copy of the last row or column. A clip of one frame is stored as two equal ones that
/// last half as long, for the duration of a frame is the distance to the next.
///
/// # Errors
///
/// An empty clip, a frame rate that is no rate, frames of less than 16 or more than 2,160 pixels a side.
pub fn encode(clip: &Clip) -> Result<Vec<u8>, MediaError> {
    let options = Mp4Options { frames_per_second: clip.frames_per_second(), ..Mp4Options::default() };
    encode_frames(clip.frames(), clip.height(), clip.width(), &options)
}

/// The bytes of an MP4 file of `frames`, `[H, W, 3]` each. As [`encode`], without a clip and with options.
///
/// # Errors
///
/// As [`encode`], and frames of another length.
pub fn encode_frames<'a>(
    frames: impl Iterator<Item = &'a [u8]>,
    height: usize,
    width: usize,
    options: &Mp4Options,
) -> Result<Vec<u8>, MediaError> {
    let mut video = Video::new(height, width, options)?;
    let frames: Vec<&[u8]> = frames.collect();
    video.extend(&frames)?;
    video.finish()
}
