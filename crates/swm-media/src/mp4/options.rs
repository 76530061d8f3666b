//! How a video is encoded: what callers choose, and what OpenH264 is told.

use openh264::encoder::{
    Complexity, EncoderConfig, FrameRate, IntraFramePeriod, MatrixCoefficients, Profile, QpRange,
    RateControlMode, UsageType, VuiConfig,
};

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

/// The fix for frames that are too small.
pub(super) const FIX: &str = "enlarge small frames with `Clip::upscaled`, or save a .gif";

/// Settings with which OpenH264 has nothing to warn about; it would do so on standard error.
pub(super) fn settings(frames_per_second: f64, options: &Mp4Options) -> EncoderConfig {
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
        // Luma and chroma as readers take them that know no labels (PyAV before 17, which LeRobot 0.6 reads by); primaries of sRGB.
        .vui(VuiConfig::bt709().matrix_coefficients(MatrixCoefficients::Smpte170M))
}

#[expect(clippy::needless_pass_by_value, reason = "made for `map_err`, which hands over the error")]
pub(super) fn refused(error: impl ToString) -> MediaError {
    MediaError::encode(Format::Mp4, &error)
}
