//! Where the images of an MP4 file lie and when they are shown: the tables of its first video track, in `moov` and in fragments.
//! Nothing is decoded here.
//!
//! Source of the format: ISO/IEC 14496-12 (boxes, sample tables, fragments, edit lists) and 14496-15 (`avcC`).

use std::io::{Read, Seek, SeekFrom};

use super::boxes::{Wrong, boxes, find, number};
use super::edits::{self, Frame};
use super::fragments::Defaults;
use super::samples::{Sample, Samples};

/// Tables above this size are taken for damage: 64 MiB describe a video of weeks.
const MAX_TABLES: u64 = 64 << 20;

/// Images of more pixels are taken for damage: 8192 x 8192.
const MAX_PIXELS: usize = 1 << 26;

/// The samples of a video, in the order in which they are decoded.
#[derive(Debug)]
pub(super) struct Tables {
    /// Four letters: `avc1` is H.264, `av01` is AV1.
    pub(super) codec: [u8; 4],
    /// What the sample description holds behind its fixed part: boxes such as `avcC`.
    pub(super) description: Vec<u8>,
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) samples: Vec<Sample>,
    /// What is shown, in the order of the times.
    pub(super) frames: Vec<Frame>,
    /// Samples before which everything is shown that was decoded before them, and nothing that is decoded later; so a decoder may start
    /// there, if the codec agrees. The rank of each is its own number.
    pub(super) starts: Vec<usize>,
    /// Frames per second, from the number of samples and their total duration.
    pub(super) rate: f64,
}

impl Tables {
    /// Reads the tables of the file's first video track.
    pub(super) fn read(file: &mut (impl Read + Seek)) -> Result<Self, Wrong> {
        let length = file.seek(SeekFrom::End(0)).map_err(|error| error.to_string())?;
        let Movie { tables, fragments } = Movie::read(file, length)?;
        for (_, track) in boxes(&tables)?.into_iter().filter(|(name, _)| name == b"trak") {
            let media = find(track, b"mdia")?;
            let is_video = find(media, b"hdlr")?.get(8..12) == Some(b"vide");
            if is_video {
                return Self::of_track(&tables, track, media, &fragments, length);
            }
        }
        Err("it has no video".into())
    }

    fn of_track(
        movie: &[u8],
        track: &[u8],
        media: &[u8],
        fragments: &[(u64, Vec<u8>)],
        length: u64,
    ) -> Result<Self, Wrong> {
        let scale = time_scale(find(media, b"mdhd")?)?;
        let table = find(find(media, b"minf")?, b"stbl")?;
        let entry = boxes(find(table, b"stsd")?.get(8..).unwrap_or_default())?;
        let Some(&(codec, description)) = entry.first() else { return Err("it names no codec".into()) };
        let (width, height) = (number(description, 24, 2)? as usize, number(description, 26, 2)? as usize);
        let mut samples = Samples::read(table, length)?;
        let head = find(track, b"tkhd")?;
        let number_of_track = number(head, if number(head, 0, 1)? == 1 { 20 } else { 12 }, 4)?;
        if let Some(defaults) = Defaults::read(movie, number_of_track)? {
            for (at, fragment) in fragments {
                defaults.append((fragment, *at), length, &mut samples)?;
            }
        }
        let Samples { list: samples, duration, .. } = samples;
        if samples.first().is_some_and(|sample| !sample.key) {
            return Err("it does not begin with a key frame".into());
        }
        let rate = match duration {
            0 => 0.0,
            duration => samples.len() as f64 * scale as f64 / duration as f64,
        };
        let order = edits::order(&samples);
        let times: Vec<i64> = order.iter().map(|&sample| samples[sample].time).collect();
        let movie_scale = find(movie, b"mvhd").and_then(time_scale).unwrap_or(scale);
        let frames = edits::frames(track, &times, [scale, movie_scale], !fragments.is_empty())?;
        let starts = starts(&samples, &order);
        let description = description.get(78..).unwrap_or_default().to_vec();
        let mut tables = Self { codec, description, height: 0, width: 0, samples, frames, starts, rate };
        tables.resize(height, width)?;
        Ok(tables)
    }

    /// Sets the size of the images.
    pub(super) fn resize(&mut self, height: usize, width: usize) -> Result<(), String> {
        if width == 0 || height == 0 {
            return Err("its images have no size".to_owned());
        }
        if height.saturating_mul(width) > MAX_PIXELS {
            return Err(format!("its images have {height} x {width} pixels"));
        }
        (self.height, self.width) = (height, width);
        Ok(())
    }
}

/// See [`Tables::starts`].
fn starts(samples: &[Sample], order: &[usize]) -> Vec<usize> {
    // One more than the last of the samples that are shown so far: no more than those, if none is shown later.
    let mut end = 0;
    let is_start = |(at, &shown): (usize, &usize)| {
        let is_between = end == at && shown == at;
        end = end.max(shown + 1);
        (is_between && samples[at].key).then_some(at)
    };
    order.iter().enumerate().filter_map(is_start).collect()
}

/// Units per second, of the boxes `mdhd` and `mvhd`.
fn time_scale(header: &[u8]) -> Result<u64, String> {
    match header.first() {
        Some(0) => number(header, 12, 4),
        _ => number(header, 20, 4),
    }
}

/// The tables of a file.
struct Movie {
    /// The content of the box `moov`.
    tables: Vec<u8>,
    /// The contents of the boxes `moof`, and where each box lies.
    fragments: Vec<(u64, Vec<u8>)>,
}

impl Movie {
    fn read(file: &mut (impl Read + Seek), length: u64) -> Result<Self, String> {
        let failed = |error: std::io::Error| error.to_string();
        let (mut at, mut bytes) = (0, 0);
        let mut movie: Option<Self> = None;
        while at + 8 <= length {
            file.seek(SeekFrom::Start(at)).map_err(failed)?;
            let mut head = [0; 16];
            let available = (length - at).min(16) as usize;
            file.read_exact(&mut head[..available]).map_err(failed)?;
            let (mut size, mut header) = (number(&head, 0, 4)?, 8);
            match size {
                0 => size = length - at,
                1 => (size, header) = (number(&head, 8, 8)?, 16),
                _ => {}
            }
            let end = at.checked_add(size).filter(|&end| end <= length && size >= header);
            let Some(end) = end else { return Err(format!("a box at byte {at} reaches behind its end")) };
            let is_fragment = &head[4..8] == b"moof" && movie.is_some();
            if is_fragment || &head[4..8] == b"moov" && movie.is_none() {
                bytes += size;
                if bytes > MAX_TABLES {
                    return Err(format!("its tables have {bytes} bytes"));
                }
                let mut content = vec![0; (size - header) as usize];
                file.seek(SeekFrom::Start(at + header)).map_err(failed)?;
                file.read_exact(&mut content).map_err(failed)?;
                match &mut movie {
                    Some(movie) => movie.fragments.push((at, content)),
                    None if find(&content, b"mvex").is_ok() => {
                        movie = Some(Self { tables: content, fragments: Vec::new() });
                    }
                    None => return Ok(Self { tables: content, fragments: Vec::new() }),
                }
            }
            at = end;
        }
        movie.ok_or_else(|| "it has no table of contents (`moov`); was its writing interrupted?".to_owned())
    }
}
