//! The film of one episode of a column of pictures `[H, W, C]`, C being 1 or 3, in every format that has some: how it is
//! encoded, and reading rows of it back. What is deliberately absent: where its bytes are kept.

use std::io::Cursor;

use swm_core::{Dtype, Field};
use swm_media::mp4::{self, Film, Mp4Options, Mp4Reader};

use crate::dataset::{Steps, WriteOptions};

/// Frames per second if nothing says more: the reference's.
pub const FRAMES_PER_SECOND: f64 = 25.0;

/// Quality 1 to 100 on the encoder's scale, on which less is better.
pub fn encoding(options: &WriteOptions) -> Mp4Options {
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

/// Whether the rows of a column can be frames.
pub fn takes(field: &Field) -> bool {
    let (Dtype::U8, &[height, width, 1 | 3]) = (field.dtype, &field.shape[..]) else { return false };
    height.min(width) >= mp4::SIDES[0] && height.max(width) <= mp4::SIDES[1]
}

/// A film that is being written.
pub struct FilmWriter {
    film: Film,
    /// Height, width, channels.
    shape: [usize; 3],
}

impl FilmWriter {
    /// A film of rows of `field`, which [`takes`] accepts.
    ///
    /// # Errors
    ///
    /// A sentence: the field holds no pictures, or of a size that no film can have.
    pub fn new(field: &Field, encoding: &Mp4Options) -> Result<Self, String> {
        let &[height, width, channels] = &field.shape[..] else { return Err("no pictures".to_owned()) };
        let film = Film::new(height, width, encoding).map_err(|error| error.to_string())?;
        Ok(Self { film, shape: [height, width, channels] })
    }

    /// Appends rows, `[T, H, W, C]`.
    ///
    /// # Errors
    ///
    /// A sentence: encoding failed.
    pub fn append(&mut self, rows: &[u8]) -> Result<(), String> {
        let frames = rows.chunks_exact(self.shape.iter().product());
        let added = if self.shape[2] == 1 {
            let colours: Vec<Vec<u8>> =
                frames.map(|frame| frame.iter().flat_map(|&grey| [grey; 3]).collect()).collect();
            self.film.extend(&colours.iter().map(Vec::as_slice).collect::<Vec<_>>())
        } else {
            self.film.extend(&frames.collect::<Vec<_>>())
        };
        added.map_err(|error| error.to_string())
    }

    /// The bytes of the file.
    ///
    /// # Errors
    ///
    /// A sentence: encoding failed, or the film has no frames.
    pub fn finish(self) -> Result<Vec<u8>, String> {
        self.film.finish().map_err(|error| error.to_string())
    }
}

/// A film that is being read; keeps what the next rows need.
#[derive(Debug)]
pub struct FilmReader {
    film: Mp4Reader<Cursor<Vec<u8>>>,
    colours: Vec<u8>,
}

impl FilmReader {
    /// Opens the bytes of a file.
    ///
    /// # Errors
    ///
    /// A sentence: these are no bytes of a film that can be read.
    pub fn new(bytes: Vec<u8>) -> Result<Self, String> {
        let film = Mp4Reader::new(Cursor::new(bytes)).map_err(|error| error.to_string())?;
        Ok(Self { film, colours: Vec::new() })
    }

    /// Height and width of the frames.
    pub fn size(&self) -> (usize, usize) {
        self.film.size()
    }

    /// Reads rows of a column of this shape into `out`, `[steps.count, H, W, C]`.
    ///
    /// # Errors
    ///
    /// A sentence: the film has pictures of another size, fewer of them, or is damaged.
    pub fn read(
        &mut self,
        [height, width, channels]: [usize; 3],
        steps: Steps,
        out: &mut [u8],
    ) -> Result<(), String> {
        let (found, expected) = (self.film.size(), (height, width));
        // Odd sides were grown by one pixel.
        if (found.0 & !1, found.1 & !1) != ((expected.0 + 1) & !1, (expected.1 + 1) & !1) {
            return Err(format!("it has pictures of {found:?}, not {expected:?}"));
        }
        if channels == 3 && found == expected {
            let read = self.film.read(steps.first, steps.stride, out);
            return read.map_err(|error| error.to_string());
        }
        self.colours.resize(steps.count * found.0 * found.1 * 3, 0);
        let read = self.film.read(steps.first, steps.stride, &mut self.colours);
        read.map_err(|error| error.to_string())?;
        let frames = self.colours.chunks_exact(found.0 * found.1 * 3);
        for (out, frame) in out.chunks_exact_mut(height * width * channels).zip(frames) {
            for (out, row) in out.chunks_exact_mut(width * channels).zip(frame.chunks_exact(found.1 * 3)) {
                if channels == 3 {
                    out.copy_from_slice(&row[..width * 3]);
                } else {
                    out.iter_mut().zip(row.iter().skip(1).step_by(3)).for_each(|(out, &grey)| *out = grey);
                }
            }
        }
        Ok(())
    }
}
