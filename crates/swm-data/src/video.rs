//! The video of one episode of a column of images `[H, W, C]`, C being 1 or 3, in every format that has some: how it is
//! encoded, and reading rows of it back. What is deliberately absent: where its bytes are kept.

use std::io::Cursor;

use swm_core::{Dtype, Field};
use swm_media::mp4::{self, Mp4Options, Mp4Reader, Video};

use crate::dataset::{Steps, WriteOptions};

/// Frames per second if nothing says more: the reference's.
pub const FRAMES_PER_SECOND: f64 = 25.0;

/// Quality 1 to 100 on the encoder's scale, on which less is better.
pub fn encoding(options: &WriteOptions) -> Mp4Options {
    let default = Mp4Options::default();
    let range = 51 - u32::from(mp4::BEST_QUANTIZER);
    let quantizer = |quality: u8| 51 - (u32::from(quality.clamp(1, 100)) * range + 50) / 100;
    Mp4Options {
        frames_per_second: options.frames_per_second.unwrap_or(FRAMES_PER_SECOND),
        quantizer: options.quality.map_or(default.quantizer, |quality| quantizer(quality) as u8),
        key_frame_period: options.key_frame_period.unwrap_or(default.key_frame_period),
        is_fast: true,
    }
}

/// Whether the rows of a column can be frames.
pub fn takes(field: &Field) -> bool {
    let (Dtype::U8, &[height, width, 1 | 3]) = (field.dtype, &field.shape[..]) else { return false };
    height.min(width) >= mp4::SIDES[0] && height.max(width) <= mp4::SIDES[1]
}

/// A video that is being written.
pub struct VideoWriter {
    video: Video,
    /// Height, width, channels.
    shape: [usize; 3],
}

impl VideoWriter {
    /// A video of rows of `field`, which [`takes`] accepts.
    ///
    /// # Errors
    ///
    /// A sentence: the field holds no images, or of a size that no video can have.
    pub fn new(field: &Field, encoding: &Mp4Options) -> Result<Self, String> {
        let &[height, width, channels] = &field.shape[..] else { return Err("no images".to_owned()) };
        let video = Video::new(height, width, encoding).map_err(|error| error.to_string())?;
        Ok(Self { video, shape: [height, width, channels] })
    }

    /// Appends rows, `[T, H, W, C]`.
    ///
    /// # Errors
    ///
    /// A sentence: encoding failed.
    pub fn append(&mut self, rows: &[u8]) -> Result<(), String> {
        let frames = rows.chunks_exact(self.shape.iter().product());
        let added = if self.shape[2] == 1 {
            let colors: Vec<Vec<u8>> =
                frames.map(|frame| frame.iter().flat_map(|&gray| [gray; 3]).collect()).collect();
            self.video.extend(&colors.iter().map(Vec::as_slice).collect::<Vec<_>>())
        } else {
            self.video.extend(&frames.collect::<Vec<_>>())
        };
        added.map_err(|error| error.to_string())
    }

    /// The bytes of the file.
    ///
    /// # Errors
    ///
    /// A sentence: encoding failed, or the video has no frames.
    pub fn finish(self) -> Result<Vec<u8>, String> {
        self.video.finish().map_err(|error| error.to_string())
    }
}

/// A video that is being read; keeps what the next rows need.
#[derive(Debug)]
pub struct VideoReader {
    video: Mp4Reader<Cursor<Vec<u8>>>,
    colors: Vec<u8>,
}

impl VideoReader {
    /// Opens the bytes of a file.
    ///
    /// # Errors
    ///
    /// A sentence: these are no bytes of a video that can be read.
    pub fn new(bytes: Vec<u8>) -> Result<Self, String> {
        let video = Mp4Reader::new(Cursor::new(bytes)).map_err(|error| error.to_string())?;
        Ok(Self { video, colors: Vec::new() })
    }

    /// Height and width of the frames.
    pub fn size(&self) -> (usize, usize) {
        self.video.size()
    }

    /// Reads rows of a column of this shape into `out`, `[steps.count, H, W, C]`.
    ///
    /// # Errors
    ///
    /// A sentence: the video has images of another size, fewer of them, or is damaged.
    pub fn read(
        &mut self,
        [height, width, channels]: [usize; 3],
        steps: Steps,
        out: &mut [u8],
    ) -> Result<(), String> {
        let (found, expected) = (self.video.size(), (height, width));
        // Odd sides were grown by one pixel.
        if (found.0 & !1, found.1 & !1) != ((expected.0 + 1) & !1, (expected.1 + 1) & !1) {
            return Err(format!("it has images of {found:?}, not {expected:?}"));
        }
        if channels == 3 && found == expected {
            let read = self.video.read(steps.first, steps.stride, out);
            return read.map_err(|error| error.to_string());
        }
        self.colors.resize(steps.count * found.0 * found.1 * 3, 0);
        let read = self.video.read(steps.first, steps.stride, &mut self.colors);
        read.map_err(|error| error.to_string())?;
        let frames = self.colors.chunks_exact(found.0 * found.1 * 3);
        for (out, frame) in out.chunks_exact_mut(height * width * channels).zip(frames) {
            for (out, row) in out.chunks_exact_mut(width * channels).zip(frame.chunks_exact(found.1 * 3)) {
                if channels == 3 {
                    out.copy_from_slice(&row[..width * 3]);
                } else {
                    out.iter_mut().zip(row.iter().skip(1).step_by(3)).for_each(|(out, &gray)| *out = gray);
                }
            }
        }
        Ok(())
    }
}
