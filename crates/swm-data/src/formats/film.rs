//! How films of datasets are encoded, in every format that has some.

use swm_media::mp4::{self, Mp4Options};

use crate::dataset::WriteOptions;

/// Frames per second if nothing says more: the reference's.
pub(super) const FRAMES_PER_SECOND: f64 = 25.0;

/// Quality 1 to 100 on the encoder's scale, on which less is better.
pub(super) fn encoding(options: &WriteOptions) -> Mp4Options {
    let default = Mp4Options::default();
    let range = 51 - u32::from(mp4::BEST_QUANTISER);
    let quantiser = |quality: u8| 51 - (u32::from(quality.clamp(1, 100)) * range + 50) / 100;
    Mp4Options {
        frames_per_second: options.frames_per_second.unwrap_or(FRAMES_PER_SECOND),
        quantiser: options.quality.map_or(default.quantiser, |quality| quantiser(quality) as u8),
        key_frame_period: options.key_frame_period.unwrap_or(default.key_frame_period),
        is_fast: true,
    }
}
