//! Videos read back: any frame, in any order, and the same frame in whatever order.
//!
//! Reads H.264 (Baseline to High profile, gray or 4:2:0, 8 bits, progressive) and, with the feature `av1`, AV1 (gray or 4:2:0, 8 bits),
//! in plain and fragmented files. Everything else is [`MediaError::Unsupported`], not damage. Frames are those that are shown, numbered in
//! the order of their times: the edit list hides the others. Decoding begins at an IDR picture of H.264 or a key frame of AV1; pictures
//! that files list as key frames and that need earlier ones (open groups of pictures, intra refresh) are decoded from there. Images are as
//! they are stored: a rotation that the file asks for is left to players. Colors follow the matrix and the range that the stream names;
//! BT.601 in studio range where it names none, as players do.

use std::fmt;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

use super::boxes::Wrong;
use super::codec::{Codec, unsupported};
use super::colors::Conversion;
use super::decoders::{FrameDecoder, Image};
use super::demux::Tables;
use crate::error::MediaError;

/// So many samples are looked through for what is not decoded, before any is: with B pictures, each group of them begins earlier.
const LOOKED_THROUGH: usize = 24;

/// An open video.
pub struct Mp4Reader<F> {
    file: F,
    tables: Tables,
    codec: Codec,
    conversion: Conversion,
    /// Of each of [`Tables::starts`]: whether the sample was looked into.
    known_starts: Vec<bool>,
    /// Where decoding stands; none before the first frame and after an error.
    run: Option<Run>,
    /// The coded image that is being decoded.
    packet: Vec<u8>,
}

struct Run {
    decoder: FrameDecoder,
    /// The next sample that the decoder gets.
    sample: usize,
    /// The rank of the image that it gives next.
    rank: usize,
}

impl<F: Read + Seek> Mp4Reader<F> {
    /// Reads the tables of a video.
    ///
    /// # Errors
    ///
    /// [`MediaError::Unsupported`] for a video that this crate does not decode, [`MediaError::Decode`] for what is no MP4 file or was cut
    /// short.
    pub fn new(file: F) -> Result<Self, MediaError> {
        Ok(Self::open(file)?)
    }

    fn open(mut file: F) -> Result<Self, Wrong> {
        let tables = Tables::read(&mut file)?;
        let codec = Codec::read(&tables)?;
        let known_starts = vec![false; tables.starts.len()];
        let conversion = Conversion::new(codec.colors());
        let mut reader =
            Self { file, tables, codec, conversion, known_starts, run: None, packet: Vec::new() };
        if !reader.tables.samples.is_empty() {
            let is_start = reader.load(0)?;
            if !is_start || reader.tables.starts.first() != Some(&0) {
                return Err(unsupported("a video that does not begin with an IDR picture or key frame"));
            }
        }
        if reader.codec.is_in_doubt() {
            (1..reader.tables.samples.len().min(LOOKED_THROUGH))
                .try_for_each(|sample| reader.load(sample).map(drop))?;
        }
        // What is decoded counts: containers round sizes up, or state those at which to show the images.
        if let Some((height, width)) = reader.codec.set().map(|set| (set.height, set.width)) {
            reader.tables.resize(height, width)?;
        }
        reader.conversion = Conversion::new(reader.codec.colors());
        Ok(reader)
    }

    /// Frames in the video: those that are shown.
    pub fn frames(&self) -> usize {
        self.tables.frames.len()
    }

    /// Height and width of a frame in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.tables.height, self.tables.width)
    }

    /// Frames per second on the average; 0 for videos without durations.
    pub fn frames_per_second(&self) -> f64 {
        self.tables.rate
    }

    /// When a frame is shown, in seconds.
    pub fn time(&self, frame: usize) -> Option<f64> {
        self.tables.frames.get(frame).map(|frame| frame.time)
    }

    /// The frame whose time is nearest to this one, in seconds; the earlier one of two. `None`: there is no frame.
    pub fn nearest(&self, seconds: f64) -> Option<usize> {
        let frames = &self.tables.frames;
        let after = frames.partition_point(|frame| frame.time < seconds);
        let distance =
            |frame: &usize| frames.get(*frame).map_or(f64::INFINITY, |at| (at.time - seconds).abs());
        let near = after.saturating_sub(1)..(after + 1).min(frames.len());
        near.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Decodes frames `first`, `first + stride`, …, as many as fit into `out`, `[T, H, W, 3]`.
    ///
    /// Going on where the last call ended costs nothing extra; going elsewhere decodes from the picture before it at which decoding can begin.
    ///
    /// # Errors
    ///
    /// [`MediaError::Decode`] for frames that do not exist, a damaged stream, or images of another size than the
    /// file says; [`MediaError::Unsupported`] for a stream that changes to what this crate does not decode.
    pub fn read(&mut self, first: usize, stride: usize, out: &mut [u8]) -> Result<(), MediaError> {
        self.read_each(&|at| at.saturating_mul(stride.max(1)).saturating_add(first), out)
    }

    /// As [`Mp4Reader::read`], of any frames: `frame` maps places in `out` to them.
    ///
    /// # Errors
    ///
    /// As [`Mp4Reader::read`].
    pub fn read_each(&mut self, frame: &dyn Fn(usize) -> usize, out: &mut [u8]) -> Result<(), MediaError> {
        let result = self.decode_each(frame, out);
        if result.is_err() {
            self.run = None;
        }
        Ok(result?)
    }

    fn decode_each(&mut self, frame: &dyn Fn(usize) -> usize, out: &mut [u8]) -> Result<(), Wrong> {
        let frame_bytes = self.tables.height * self.tables.width * 3;
        let count = out.len() / frame_bytes;
        if (0..count).any(|at| frame(at) >= self.frames()) {
            return Err(format!("it has {} frames, too few for what was asked for", self.frames()).into());
        }
        let mut at = 0;
        while at < count {
            let rank = |at: usize| self.tables.frames[frame(at)].rank;
            if at > 0 && rank(at) == rank(at - 1) {
                out.copy_within((at - 1) * frame_bytes..at * frame_bytes, at * frame_bytes);
                at += 1;
                continue;
            }
            // As far as the decoder can go on.
            let mut end = at + 1;
            while end < count && rank(end) > rank(end - 1) {
                end += 1;
            }
            self.decode(at..end, frame, out)?;
            at = end;
        }
        Ok(())
    }

    /// Decodes images of rising ranks into their places in `out`.
    fn decode(
        &mut self,
        places: Range<usize>,
        frame: &dyn Fn(usize) -> usize,
        out: &mut [u8],
    ) -> Result<(), Wrong> {
        let size @ (height, width) = self.size();
        let mut next = places.start;
        let mut run = self.begin(self.tables.frames[frame(next)].rank)?;
        let (conversion, samples) = (self.conversion, self.tables.samples.len());
        while next < places.end {
            if run.sample < samples {
                self.load(run.sample)?;
            }
            let (frames, Run { decoder, sample, rank }) = (&self.tables.frames, &mut run);
            let mut take = |image: &Image<'_>| {
                let given = *rank;
                *rank += 1;
                if next == places.end || frames[frame(next)].rank != given {
                    return Ok(());
                }
                // An image may be padded to whole blocks, never smaller.
                if image.width < width || image.height < height {
                    let there = (image.height, image.width);
                    return Err(format!(
                        "an image has {}x{} pixels instead of {height}x{width}",
                        there.0, there.1
                    ));
                }
                #[cfg(feature = "av1")]
                let conversion = image.colors.map_or(conversion, Conversion::new);
                let target = out.chunks_exact_mut(height * width * 3).nth(next);
                next += 1;
                target.map_or(Ok(()), |target| conversion.rgb(image, size, target))
            };
            if *sample < samples {
                *sample += 1;
                decoder.decode(&self.packet, &mut take)?;
            } else if decoder.finish(&mut take)? == 0 {
                return Err(format!("only {} of {samples} images can be decoded", run.rank).into());
            }
        }
        let at_end = run.sample == samples;
        self.run = (!at_end).then_some(run);
        Ok(())
    }

    /// A decoder that has not passed this image: the one at work, or a new one at the start before it.
    fn begin(&mut self, rank: usize) -> Result<Run, Wrong> {
        let run = self.run.take().filter(|run| run.rank <= rank);
        let start = self.start(rank)?;
        if let Some(run) = run
            && run.sample > start
        {
            return Ok(run);
        }
        let decoder = self.codec.decoder(self.tables.height.saturating_mul(self.tables.width))?;
        Ok(Run { decoder, sample: start, rank: start })
    }

    /// The last sample before an image at which decoding can begin. What files list as key frames need not be one: those are forgotten.
    fn start(&mut self, rank: usize) -> Result<usize, Wrong> {
        let mut place = self.tables.starts.partition_point(|&start| start <= rank);
        while let Some(at) = place.checked_sub(1) {
            let sample = self.tables.starts[at];
            if self.known_starts[at] || self.load(sample)? {
                self.known_starts[at] = true;
                return Ok(sample);
            }
            self.tables.starts.remove(at);
            self.known_starts.remove(at);
            place = at;
        }
        Ok(0)
    }

    /// Reads a sample into `packet`, as the decoder takes it. Whether decoding can begin at it.
    fn load(&mut self, sample: usize) -> Result<bool, Wrong> {
        let sample = self.tables.samples[sample];
        self.packet.clear();
        self.packet.resize(sample.size, 0);
        let read = self
            .file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut self.packet));
        read.map_err(|error| error.to_string())?;
        self.codec.prepare(&mut self.packet)
    }
}

impl<F> fmt::Debug for Mp4Reader<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rank = self.run.as_ref().map(|run| run.rank);
        f.debug_struct("Mp4Reader").field("tables", &self.tables).field("rank", &rank).finish_non_exhaustive()
    }
}
