//! A video that grows: frames come in pieces of any size, the bytes of the file at the end. Only what is encoded is held.
//!
//! Frames are encoded in segments of a fixed number, each by an encoder of its own and from a key frame on; so segments
//! are encoded side by side, and the bytes depend neither on the number of threads nor on how the frames came.

use muxide::api::{Muxer, MuxerBuilder, VideoCodec};
use openh264::OpenH264API;
use openh264::encoder::{Encoder, FrameType};
use rayon::prelude::*;

use super::options::{FIX, Mp4Options, SIDES, refused, settings};
use super::planes::Planes;
use crate::clip::{check_frame, check_video};
use crate::error::MediaError;
use crate::format::Format;

/// A segment has at least so many frames: the start of an encoder takes as long as that of a few frames.
const SEGMENT: usize = 40;

/// A video that is being encoded.
pub struct Video {
    height: usize,
    width: usize,
    options: Mp4Options,
    muxer: Muxer<Vec<u8>>,
    /// Frames to a segment: whole periods of key frames.
    segment: usize,
    /// The encoder of the segment that has begun.
    open: Option<Segment>,
    frames: usize,
    /// The first frame, while it is the only one.
    first: Vec<u8>,
}

/// One encoder, and where it takes frames from.
struct Segment {
    encoder: Encoder,
    planes: Planes,
}

/// An encoded frame, and whether it is a key frame.
type Encoded = (Vec<u8>, bool);

impl Video {
    /// A video of frames `[H, W, 3]`.
    ///
    /// # Errors
    ///
    /// A frame rate that is no rate, frames of less than 16 or more than 2,160 pixels a side.
    pub fn new(height: usize, width: usize, options: &Mp4Options) -> Result<Self, MediaError> {
        check_video(Format::Mp4, [height, width], 1, options.frames_per_second, SIDES, FIX)?;
        let period = options.key_frame_period.max(1) as usize;
        Ok(Self {
            height,
            width,
            options: *options,
            muxer: muxer(height, width, options.frames_per_second)?,
            segment: SEGMENT.next_multiple_of(period),
            open: None,
            frames: 0,
            first: Vec::new(),
        })
    }

    /// Appends frames.
    ///
    /// # Errors
    ///
    /// Frames of another length than the first.
    pub fn extend(&mut self, frames: &[&[u8]]) -> Result<(), MediaError> {
        frames.iter().try_for_each(|frame| check_frame(frame, self.height, self.width))?;
        if self.frames == 0
            && let [first, ..] = frames
        {
            self.first = first.to_vec();
        } else if !frames.is_empty() {
            self.first = Vec::new();
        }
        let left = match self.frames % self.segment {
            0 => 0,
            begun => (self.segment - begun).min(frames.len()),
        };
        let (continued, frames_after) = frames.split_at(left);
        if let Some(open) = &mut self.open {
            let encoded = open.encode(continued)?;
            self.write(encoded)?;
        }
        // The last one may go on.
        let segments: Vec<_> =
            frames_after.par_chunks(self.segment).map(|frames| self.segment(frames)).collect();
        for segment in segments {
            let (segment, encoded) = segment?;
            self.write(encoded)?;
            self.open = Some(segment);
        }
        if self.frames.is_multiple_of(self.segment) {
            self.open = None;
        }
        Ok(())
    }

    /// The bytes of the file.
    ///
    /// # Errors
    ///
    /// No frames.
    pub fn finish(mut self) -> Result<Vec<u8>, MediaError> {
        match self.frames {
            0 => return Err(MediaError::EmptyClip),
            // Two equal frames that last half as long, for the duration of a frame is the distance to the next.
            1 => {
                let rate = 2.0 * self.options.frames_per_second;
                let options = Mp4Options { frames_per_second: rate, ..self.options };
                let mut twice = Self::new(self.height, self.width, &options)?;
                twice.extend(&[&self.first, &self.first])?;
                return twice.finish();
            }
            _ => self.muxer.finish_in_place().map_err(refused)?,
        }
        Ok(self.muxer.into_writer())
    }

    /// Encodes the beginning of a segment, or all of it.
    fn segment(&self, frames: &[&[u8]]) -> Result<(Segment, Vec<Encoded>), MediaError> {
        let settings = settings(self.options.frames_per_second, &self.options);
        let encoder = Encoder::with_api_config(OpenH264API::from_source(), settings).map_err(refused)?;
        let mut segment = Segment { encoder, planes: Planes::new(self.height, self.width) };
        let encoded = segment.encode(frames)?;
        Ok((segment, encoded))
    }

    fn write(&mut self, frames: Vec<Encoded>) -> Result<(), MediaError> {
        for (bytes, is_key) in frames {
            let time = self.frames as f64 / self.options.frames_per_second;
            self.muxer.write_video(time, &bytes, is_key).map_err(refused)?;
            self.frames += 1;
        }
        Ok(())
    }
}

impl Segment {
    fn encode(&mut self, frames: &[&[u8]]) -> Result<Vec<Encoded>, MediaError> {
        let encode = |frame: &&[u8]| {
            self.planes.fill(frame);
            let encoded = self.encoder.encode(&self.planes.source()).map_err(refused)?;
            let is_key = matches!(encoded.frame_type(), FrameType::IDR | FrameType::I);
            Ok((encoded.to_vec(), is_key))
        };
        frames.iter().map(encode).collect()
    }
}

fn muxer(height: usize, width: usize, rate: f64) -> Result<Muxer<Vec<u8>>, MediaError> {
    let [height, width] = [height, width].map(|side| side.next_multiple_of(2) as u32);
    let builder = MuxerBuilder::new(Vec::new()).video(VideoCodec::H264, width, height, rate);
    builder.with_fast_start(true).build().map_err(refused)
}
