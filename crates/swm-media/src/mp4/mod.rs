//! Videos: H.264, encoded and decoded by the bundled OpenH264; with the feature `av1`, AV1 is decoded too.
//!
//! What is written: Baseline profile, 4:2:0, BT.709, constant quantizer, a key frame every tenth frame, the index before the images.
//! Videos of this kind play in every browser and editor; colors lose half their resolution, which a drawn scene shows
//! at saturated edges.

mod colors;
mod decoders;
mod demux;
mod parameters;
mod planes;
mod reader;
mod video;

use openh264::encoder::{
    Complexity, EncoderConfig, FrameRate, IntraFramePeriod, Profile, QpRange, RateControlMode, UsageType,
    VuiConfig,
};

pub use self::reader::Mp4Reader;
pub use self::video::Video;

use crate::clip::Clip;
use crate::error::MediaError;
use crate::format::Format;

/// The sides that OpenH264 encodes, in pixels.
pub const SIDES: [usize; 2] = [16, 2160];

/// How a video is encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mp4Options {
    /// Frames per second.
    pub frames_per_second: f64,
    /// The quantizer, constant, on H.264's scale, where 51 is worst. The encoder's best is 12.
    pub quantizer: u8,
    /// Frames from one key frame to the next: decoding any frame decodes at most so many.
    pub key_frame_period: u32,
    /// Searches less for good predictions: about four times as fast.
    pub is_fast: bool,
}

impl Default for Mp4Options {
    fn default() -> Self {
        Self {
            frames_per_second: 25.0,
            quantizer: QUANTIZER,
            key_frame_period: KEY_FRAME_PERIOD,
            is_fast: false,
        }
    }
}

/// The quantizer, on H.264's scale from 0 (best) to 51. Flat scenes lose about 1 dB from here to 26; below, what is
/// lost to the half-resolution colors dominates, and files only grow.
const QUANTIZER: u8 = 18;

/// Below this, the encoder changes nothing.
pub const BEST_QUANTIZER: u8 = 12;

/// Frames from one key frame to the next; a viewer can jump to each of those.
const KEY_FRAME_PERIOD: u32 = 10;

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

/// What to do about frames that are too small.
const FIX: &str = "enlarge small frames with `Clip::upscaled`, or save a .gif";

/// Settings with which OpenH264 has nothing to warn about; it would do so on standard error.
fn settings(frames_per_second: f64, options: &Mp4Options) -> EncoderConfig {
    // To the encoder, 0 means "whatever you like".
    let quantizer = options.quantizer.clamp(BEST_QUANTIZER, 51);
    // What is meant for screens looks for images that were scrolled and for new scenes, which takes half of the time and
    // gains nothing on simulated scenes.
    let (usage, complexity) = match options.is_fast {
        true => (UsageType::CameraVideoRealTime, Complexity::Low),
        false => (UsageType::ScreenContentRealTime, Complexity::High),
    };
    EncoderConfig::new()
        .profile(Profile::Baseline)
        .usage_type(usage)
        .complexity(complexity)
        // `Off` would be a fixed quantizer of 26, the other modes need leave to skip frames.
        .rate_control_mode(RateControlMode::Bufferbased)
        .qp(QpRange::new(quantizer, quantizer))
        .skip_frames(false)
        .scene_change_detect(!options.is_fast)
        .adaptive_quantization(false)
        .background_detection(false)
        .intra_frame_period(IntraFramePeriod::from_num_frames(options.key_frame_period.max(1)))
        .max_frame_rate(FrameRate::from_hz(frames_per_second as f32))
        .num_threads(1)
        .vui(VuiConfig::bt709())
}

#[expect(clippy::needless_pass_by_value, reason = "made for `map_err`, which hands over the error")]
fn refused(error: impl ToString) -> MediaError {
    MediaError::encode(Format::Mp4, &error)
}
