//! The video of one episode of a column of images `[H, W, C]`, C being 1 or 3, in every format that has some: how it is
//! encoded, and reading rows of it back. What is deliberately absent: where its bytes are kept.

use std::io::Cursor;

use swm_core::{Dtype, Field};
use swm_media::mp4::{self, Mp4Options, Mp4Reader, Video};

use crate::dataset::{Steps, WriteOptions};
use crate::error::{Result, wrong_type};

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
    /// The field holds no images, or of a size that no video can have.
    pub fn new(field: &Field, encoding: &Mp4Options) -> Result<Self> {
        let &[height, width, channels] = &field.shape[..] else { return Err(wrong_type("no images")) };
        let video = Video::new(height, width, encoding)?;
        Ok(Self { video, shape: [height, width, channels] })
    }

    /// Appends rows, `[T, H, W, C]`.
    ///
    /// # Errors
    ///
    /// Encoding failed.
    pub fn append(&mut self, rows: &[u8]) -> Result<()> {
        let frames = rows.chunks_exact(self.shape.iter().product());
        let added = if self.shape[2] == 1 {
            let colors: Vec<Vec<u8>> =
                frames.map(|frame| frame.iter().flat_map(|&gray| [gray; 3]).collect()).collect();
            self.video.extend(&colors.iter().map(Vec::as_slice).collect::<Vec<_>>())
        } else {
            self.video.extend(&frames.collect::<Vec<_>>())
        };
        Ok(added?)
    }

    /// The bytes of the file.
    ///
    /// # Errors
    ///
    /// Encoding failed, or the video has no frames.
    pub fn finish(self) -> Result<Vec<u8>> {
        Ok(self.video.finish()?)
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
    /// These are no bytes of a video that can be read.
    pub fn new(bytes: Vec<u8>) -> Result<Self> {
        let video = Mp4Reader::new(Cursor::new(bytes))?;
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
    /// The video has images of another size, fewer of them, or is damaged.
    pub fn read(
        &mut self,
        [height, width, channels]: [usize; 3],
        steps: Steps,
        out: &mut [u8],
    ) -> Result<()> {
        let (found, expected) = (self.video.size(), (height, width));
        // Odd sides were grown by one pixel.
        if (found.0 & !1, found.1 & !1) != ((expected.0 + 1) & !1, (expected.1 + 1) & !1) {
            return Err(wrong_type(format!("it has images of {found:?}, not {expected:?}")));
        }
        if channels == 3 && found == expected {
            return Ok(self.video.read(steps.first, steps.stride, out)?);
        }
        self.colors.resize(steps.count * found.0 * found.1 * 3, 0);
        self.video.read(steps.first, steps.stride, &mut self.colors)?;
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
