//! H.264 films, encoded by the bundled OpenH264 in one thread.
//!
//! Baseline profile, 4:2:0, BT.709, constant quantiser, a key frame every tenth frame, the index before the pictures.
//! Films of this kind play in every browser and editor; colours lose half their resolution, which a drawn scene shows
//! at saturated edges.

mod planes;

use muxide::api::{MuxerBuilder, VideoCodec};
use openh264::OpenH264API;
use openh264::encoder::{
    Complexity, Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, Profile, QpRange,
    RateControlMode, UsageType, VuiConfig,
};

use self::planes::Planes;
use crate::clip::Clip;
use crate::error::MediaError;
use crate::format::Format;

/// The sides that OpenH264 encodes, in pixels.
const SIDES: [usize; 2] = [16, 2160];

/// The quantiser, on H.264's scale from 0 (best) to 51. Flat scenes lose about 1 dB from here to 26; below, what is
/// lost to the half-resolution colours dominates, and files only grow.
const QUANTISER: u8 = 18;

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
    clip.check_film(Format::Mp4, SIDES, "enlarge small frames with `Clip::upscaled`, or save a .gif")?;
    let once = clip.len() == 1;
    let frames = clip.frames().chain(clip.frames().filter(|_| once));
    let rate = if once { 2.0 * clip.frames_per_second() } else { clip.frames_per_second() };

    let mut planes = Planes::new(clip.height(), clip.width());
    let (height, width) = planes.size();
    let mut encoder =
        Encoder::with_api_config(OpenH264API::from_source(), settings(rate)).map_err(refused)?;
    let mut muxer = MuxerBuilder::new(Vec::new())
        .video(VideoCodec::H264, width as u32, height as u32, rate)
        .with_fast_start(true)
        .build()
        .map_err(refused)?;
    for (i, frame) in frames.enumerate() {
        planes.fill(frame);
        let encoded = encoder.encode(&planes.source()).map_err(refused)?;
        let key = matches!(encoded.frame_type(), FrameType::IDR | FrameType::I);
        muxer.write_video(i as f64 / rate, &encoded.to_vec(), key).map_err(refused)?;
    }
    muxer.finish_in_place().map_err(refused)?;
    Ok(muxer.into_writer())
}

/// Settings with which OpenH264 has nothing to warn about; it would do so on standard error.
fn settings(frames_per_second: f64) -> EncoderConfig {
    EncoderConfig::new()
        .profile(Profile::Baseline)
        .usage_type(UsageType::ScreenContentRealTime)
        .complexity(Complexity::High)
        // `Off` would be a fixed quantiser of 26, the other modes need leave to skip frames.
        .rate_control_mode(RateControlMode::Bufferbased)
        .qp(QpRange::new(QUANTISER, QUANTISER))
        .skip_frames(false)
        .scene_change_detect(true)
        .adaptive_quantization(false)
        .background_detection(false)
        .intra_frame_period(IntraFramePeriod::from_num_frames(KEY_FRAME_PERIOD))
        .max_frame_rate(FrameRate::from_hz(frames_per_second as f32))
        .num_threads(1)
        .vui(VuiConfig::bt709())
}

#[expect(clippy::needless_pass_by_value, reason = "made for `map_err`, which hands over the error")]
fn refused(error: impl ToString) -> MediaError {
    MediaError::encode(Format::Mp4, &error)
}
