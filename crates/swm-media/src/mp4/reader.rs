//! Videos read back: any frame, in any order, decoded from the key frame before it.
//!
//! Reads what this crate and x264 write (H.264, Baseline to High profile, 4:2:0, 8 bits, B-frames) and, with the feature
//! `av1`, AV1 (4:2:0, 8 bits), not fragmented files. Frames are numbered in the order in which they are shown. Colors
//! follow the matrix and the range that the stream names; BT.601 in studio range where it names none, as players do.

use std::fmt;
use std::io::{Read, Seek, SeekFrom};

use super::colors::Conversion;
use super::decoders::{FrameDecoder, Image};
use super::demux::{Tables, find, number};
use super::parameters::Colors;
use crate::error::MediaError;
use crate::format::Format;

/// An open video.
pub struct Mp4Reader<F> {
    file: F,
    tables: Tables,
    codec: Codec,
    conversion: Conversion,
    /// Where decoding stands; none before the first frame and after an error.
    run: Option<Run>,
    /// The coded image that is being decoded.
    packet: Vec<u8>,
}

/// What the samples are.
enum Codec {
    /// Bytes of the length before each unit of a sample, and the parameter sets, each behind a start code.
    H264 { length_size: usize, head: Vec<u8> },
    #[cfg(feature = "av1")]
    Av1,
}

struct Run {
    decoder: FrameDecoder,
    /// The next sample that the decoder gets.
    sample: usize,
    /// The frame that it gives next.
    frame: usize,
}

impl<F: Read + Seek> Mp4Reader<F> {
    /// Reads the tables of a video.
    ///
    /// # Errors
    ///
    /// [`MediaError::Decode`] for what is no MP4 file, was cut short, or is of another codec.
    pub fn new(mut file: F) -> Result<Self, MediaError> {
        let tables = Tables::read(&mut file).map_err(wrong)?;
        let (codec, colors) = match &tables.codec {
            b"avc1" | b"avc3" => {
                let settings = find(&tables.description, b"avcC").map_err(wrong)?;
                let (length_size, head, colors) = settings_of(settings).map_err(wrong)?;
                (Codec::H264 { length_size, head }, colors)
            }
            #[cfg(feature = "av1")]
            b"av01" => (Codec::Av1, Colors::of(&[])),
            codec => {
                let (codec, more) =
                    (codec.escape_ascii(), if cfg!(feature = "av1") { " and AV1 (`av01`)" } else { "" });
                return Err(wrong(format!(
                    "its codec is `{codec}`; only H.264 (`avc1`){more} can be decoded"
                )));
            }
        };
        let conversion = Conversion::new(colors);
        Ok(Self { file, tables, codec, conversion, run: None, packet: Vec::new() })
    }

    /// Frames in the video.
    pub fn frames(&self) -> usize {
        self.tables.samples.len()
    }

    /// Height and width of a frame in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.tables.height, self.tables.width)
    }

    /// Frames per second on the average; 0 for videos without durations.
    pub fn frames_per_second(&self) -> f64 {
        self.tables.rate
    }

    /// Decodes frames `first`, `first + stride`, …, as many as fit into `out`, `[T, H, W, 3]`.
    ///
    /// Going on where the last call ended costs nothing extra; going elsewhere decodes from the key frame before it.
    ///
    /// # Errors
    ///
    /// [`MediaError::Decode`] for frames that do not exist, a damaged stream, or images of another size than the
    /// file says.
    pub fn read(&mut self, first: usize, stride: usize, out: &mut [u8]) -> Result<(), MediaError> {
        let result = self.decode(first, stride.max(1), out);
        if result.is_err() {
            self.run = None;
        }
        result.map_err(wrong)
    }

    fn decode(&mut self, first: usize, stride: usize, out: &mut [u8]) -> Result<(), String> {
        let size @ (height, width) = self.size();
        let frame_bytes = height * width * 3;
        let count = out.len() / frame_bytes;
        if count == 0 {
            return Ok(());
        }
        let last = (count - 1).checked_mul(stride).and_then(|rows| rows.checked_add(first));
        let Some(last) = last.filter(|&last| last < self.frames()) else {
            return Err(format!("it has {} frames, too few for what was asked for", self.frames()));
        };
        let mut run = self.begin(first)?;
        let (own, frames) = (self.conversion, self.tables.samples.len());
        while run.frame <= last {
            let Run { decoder, sample, frame } = &mut run;
            let mut take = |image: &Image<'_>| {
                let at = *frame;
                *frame += 1;
                if at < first || !(at - first).is_multiple_of(stride) {
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
                let own = image.colors.map_or(own, Conversion::new);
                match out.chunks_exact_mut(frame_bytes).nth((at - first) / stride) {
                    Some(target) => own.rgb(image, size, target),
                    None => Ok(()),
                }
            };
            if *sample < frames {
                load(&mut self.file, &self.tables, &self.codec, *sample, &mut self.packet)?;
                *sample += 1;
                decoder.decode(&self.packet, &mut take)?;
            } else if decoder.finish(&mut take)? == 0 {
                return Err(format!("only {} of {frames} frames can be decoded", run.frame));
            }
        }
        let at_end = run.sample == self.tables.samples.len();
        self.run = (!at_end).then_some(run);
        Ok(())
    }

    /// A decoder that has not passed frame `first`: the one at work, or a new one at the key frame before it.
    fn begin(&mut self, first: usize) -> Result<Run, String> {
        let samples = &self.tables.samples;
        let key = samples.iter().rposition(|sample| sample.key && sample.shown <= first).unwrap_or(0);
        if let Some(run) = self.run.take()
            && run.frame <= first
            && run.sample > key
        {
            return Ok(run);
        }
        let decoder = match &self.codec {
            Codec::H264 { head, .. } => FrameDecoder::h264(head)?,
            #[cfg(feature = "av1")]
            Codec::Av1 => FrameDecoder::av1(self.tables.height.saturating_mul(self.tables.width))?,
        };
        Ok(Run { decoder, sample: key, frame: samples.get(key).map_or(0, |sample| sample.shown) })
    }
}

/// Reads a sample; in H.264, puts start codes in the place of lengths.
fn load(
    file: &mut (impl Read + Seek),
    tables: &Tables,
    codec: &Codec,
    sample: usize,
    packet: &mut Vec<u8>,
) -> Result<(), String> {
    let sample = tables.samples[sample];
    packet.clear();
    packet.resize(sample.size, 0);
    let read = file.seek(SeekFrom::Start(sample.offset)).and_then(|_| file.read_exact(packet));
    read.map_err(|error| error.to_string())?;
    let length_size = match *codec {
        Codec::H264 { length_size, .. } => length_size,
        #[cfg(feature = "av1")]
        Codec::Av1 => return Ok(()),
    };
    if length_size == 4 {
        let mut at = 0;
        while at < packet.len() {
            let length = number(packet, at, 4)? as usize;
            packet[at..at + 4].copy_from_slice(&[0, 0, 0, 1]);
            at = (at + 4)
                .checked_add(length)
                .filter(|&end| end <= packet.len())
                .ok_or("an image is cut short")?;
        }
        return Ok(());
    }
    let (mut units, mut at) = (Vec::with_capacity(packet.len() + 64), 0);
    while at < packet.len() {
        let length = number(packet, at, length_size)? as usize;
        let unit = packet.get(at + length_size..at + length_size + length).ok_or("an image is cut short")?;
        units.extend([0, 0, 0, 1]);
        units.extend(unit);
        at += length_size + length;
    }
    *packet = units;
    Ok(())
}

/// What `avcC` says: the size of lengths, the parameter sets, and the colors in the first of them.
fn settings_of(settings: &[u8]) -> Result<(usize, Vec<u8>, Colors), String> {
    let length_size = number(settings, 4, 1)? as usize % 4 + 1;
    let (mut at, mut head, mut colors) = (5, Vec::new(), Colors::of(&[]));
    for kind in 0..2 {
        let count = number(settings, at, 1)? & if kind == 0 { 0x1f } else { 0xff };
        at += 1;
        for unit in 0..count {
            let length = number(settings, at, 2)? as usize;
            let set = settings.get(at + 2..at + 2 + length).ok_or("its parameter sets are cut short")?;
            if kind == 0 && unit == 0 {
                colors = Colors::of(set);
            }
            head.extend([0, 0, 0, 1]);
            head.extend(set);
            at += 2 + length;
        }
    }
    Ok((length_size, head, colors))
}

impl<F> fmt::Debug for Mp4Reader<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frame = self.run.as_ref().map(|run| run.frame);
        f.debug_struct("Mp4Reader")
            .field("tables", &self.tables)
            .field("frame", &frame)
            .finish_non_exhaustive()
    }
}

fn wrong(reason: impl Into<String>) -> MediaError {
    MediaError::Decode { format: Format::Mp4, reason: reason.into() }
}
