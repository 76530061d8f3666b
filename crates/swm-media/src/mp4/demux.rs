//! Where the images of an MP4 file lie: the tables of its first video track. Nothing is decoded here, and fragmented
//! files are not read.
//!
//! Source of the format: ISO/IEC 14496-12 (boxes, sample tables) and 14496-15 (`avcC`).

use std::io::{Read, Seek, SeekFrom};

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
    /// Frames per second, from the number of samples and their total duration.
    pub(super) rate: f64,
}

/// One coded image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sample {
    pub(super) offset: u64,
    pub(super) size: usize,
    /// Whether decoding can begin here.
    pub(super) key: bool,
    /// Its place in the order in which images are shown.
    pub(super) shown: usize,
}

impl Tables {
    /// Reads the tables of the file's first video track.
    pub(super) fn read(file: &mut (impl Read + Seek)) -> Result<Self, String> {
        let length = file.seek(SeekFrom::End(0)).map_err(|error| error.to_string())?;
        let movie = movie(file, length)?;
        let tracks = boxes(&movie)?.into_iter().filter(|(name, _)| name == b"trak");
        for (_, track) in tracks {
            let media = find(track, b"mdia")?;
            let is_video = find(media, b"hdlr")?.get(8..12) == Some(b"vide");
            if is_video {
                return Self::of_track(media, length);
            }
        }
        Err("it has no video".to_owned())
    }

    fn of_track(media: &[u8], length: u64) -> Result<Self, String> {
        let header = find(media, b"mdhd")?;
        let timescale = match header.first() {
            Some(0) => number(header, 12, 4)?,
            _ => number(header, 20, 4)?,
        };
        let table = find(find(media, b"minf")?, b"stbl")?;
        let entry = boxes(find(table, b"stsd")?.get(8..).unwrap_or_default())?;
        let Some(&(codec, description)) = entry.first() else { return Err("it names no codec".to_owned()) };
        let (width, height) = (number(description, 24, 2)? as usize, number(description, 26, 2)? as usize);
        if width == 0 || height == 0 {
            return Err("its images have no size".to_owned());
        }
        if height * width > MAX_PIXELS {
            return Err(format!("its images have {height} x {width} pixels"));
        }
        let sizes = sizes(find(table, b"stsz")?, length)?;
        let (mut samples, duration) = times(table, sizes.len())?;
        place(table, &sizes, length, &mut samples)?;
        if let Ok(keys) = find(table, b"stss") {
            for at in 0..entries(keys, 4, 4)? {
                let key = number(keys, 8 + 4 * at, 4)? as usize;
                match key.checked_sub(1).and_then(|key| samples.get_mut(key)) {
                    Some(sample) => sample.key = true,
                    None => return Err(format!("its key frame {key} does not exist")),
                }
            }
        } else {
            samples.iter_mut().for_each(|sample| sample.key = true);
        }
        if samples.first().is_some_and(|sample| !sample.key) {
            return Err("it does not begin with a key frame".to_owned());
        }
        let rate = match duration {
            0 => 0.0,
            duration => samples.len() as f64 * timescale as f64 / duration as f64,
        };
        let description = description.get(78..).unwrap_or_default().to_vec();
        Ok(Self { codec, description, height, width, samples, rate })
    }
}

/// The content of the box `moov`.
fn movie(file: &mut (impl Read + Seek), length: u64) -> Result<Vec<u8>, String> {
    let mut at = 0;
    while at + 8 <= length {
        let failed = |error: std::io::Error| error.to_string();
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
        if &head[4..8] == b"moov" {
            if size > MAX_TABLES {
                return Err(format!("its tables have {size} bytes"));
            }
            let mut content = vec![0; (size - header) as usize];
            file.seek(SeekFrom::Start(at + header)).map_err(failed)?;
            file.read_exact(&mut content).map_err(failed)?;
            return Ok(content);
        }
        at = end;
    }
    Err("it has no table of contents (`moov`); was its writing interrupted?".to_owned())
}

/// Name and content.
type NamedBox<'a> = ([u8; 4], &'a [u8]);

/// The boxes in `content`, in order.
fn boxes(mut content: &[u8]) -> Result<Vec<NamedBox<'_>>, String> {
    let mut found = Vec::new();
    while content.len() >= 8 {
        let size = number(content, 0, 4)? as usize;
        let name = [content[4], content[5], content[6], content[7]];
        let size = if size == 0 { content.len() } else { size };
        let Some(inner) = content.get(8..size) else {
            return Err(format!("box `{}` is cut short", name.escape_ascii()));
        };
        found.push((name, inner));
        content = &content[size..];
    }
    Ok(found)
}

/// The first box of this name.
pub(super) fn find<'a>(content: &'a [u8], name: &[u8; 4]) -> Result<&'a [u8], String> {
    let found = boxes(content)?.into_iter().find(|(there, _)| there == name);
    found.map(|(_, inner)| inner).ok_or_else(|| format!("it has no box `{}`", name.escape_ascii()))
}

/// The size of each sample.
fn sizes(table: &[u8], length: u64) -> Result<Vec<usize>, String> {
    let (fixed, count) = (number(table, 4, 4)?, number(table, 8, 4)? as usize);
    if fixed != 0 {
        // Not bounded by the size of the table.
        if fixed.saturating_mul(count as u64) > length {
            return Err(format!("{count} images of {fixed} bytes do not fit into it"));
        }
        return Ok(vec![fixed as usize; count]);
    }
    if table.len() < count.saturating_mul(4).saturating_add(12) {
        return Err("its table of sizes is cut short".to_owned());
    }
    (0..count).map(|at| Ok(number(table, 12 + 4 * at, 4)? as usize)).collect()
}

/// `count` samples with their place in the order of showing, and their total duration.
fn times(table: &[u8], count: usize) -> Result<(Vec<Sample>, u64), String> {
    let durations = find(table, b"stts")?;
    let mut start = 0i64;
    let mut shown_at = Vec::with_capacity(count);
    for at in 0..entries(durations, 8, 4)? {
        let (run, delta) = (number(durations, 8 + 8 * at, 4)?, number(durations, 12 + 8 * at, 4)? as i64);
        for _ in 0..run {
            if shown_at.len() == count {
                break;
            }
            shown_at.push(start);
            start += delta;
        }
    }
    if shown_at.len() != count {
        return Err(format!("{} of {count} images have a time", shown_at.len()));
    }
    if let Ok(shifts) = find(table, b"ctts") {
        let mut sample = 0;
        for at in 0..entries(shifts, 8, 4)? {
            // Signed in version 1, and below 2^31 in version 0.
            let (run, shift) =
                (number(shifts, 8 + 8 * at, 4)?, number(shifts, 12 + 8 * at, 4)? as u32 as i32);
            for time in shown_at.iter_mut().skip(sample).take(run as usize) {
                *time += i64::from(shift);
            }
            sample = sample.saturating_add(run as usize);
        }
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|&sample| (shown_at[sample], sample));
    let mut samples = vec![Sample { offset: 0, size: 0, key: false, shown: 0 }; count];
    for (shown, sample) in order.into_iter().enumerate() {
        samples[sample].shown = shown;
    }
    Ok((samples, start.max(0) as u64))
}

/// Fills in where each sample lies: samples come in chunks, of which the file lists the offsets.
fn place(table: &[u8], sizes: &[usize], length: u64, samples: &mut [Sample]) -> Result<(), String> {
    let (offsets, width) = match find(table, b"stco") {
        Ok(offsets) => (offsets, 4),
        Err(_) => (find(table, b"co64")?, 8),
    };
    let chunks = entries(offsets, width, 4)?;
    let runs = find(table, b"stsc")?;
    let runs_count = entries(runs, 12, 4)?;
    let mut sample = 0;
    for run in 0..runs_count {
        let field = |run: usize, at: usize| Ok::<_, String>(number(runs, 8 + 12 * run + at, 4)? as usize);
        let (first, per_chunk) = (field(run, 0)?, field(run, 4)?);
        let end = if run + 1 < runs_count { field(run + 1, 0)? } else { chunks + 1 };
        if first == 0 || end > chunks + 1 || end < first {
            return Err(format!("it has {chunks} chunks, but a table speaks of {end}"));
        }
        for chunk in first - 1..end - 1 {
            let mut offset = number(offsets, 8 + width * chunk, width)?;
            for _ in 0..per_chunk {
                let (Some(target), Some(&size)) = (samples.get_mut(sample), sizes.get(sample)) else { break };
                let end = offset.checked_add(size as u64).filter(|&end| end <= length);
                let Some(end) = end else {
                    return Err(format!("it was cut short: image {sample} lies behind its end"));
                };
                (target.offset, target.size) = (offset, size);
                offset = end;
                sample += 1;
            }
        }
    }
    match sample == samples.len() {
        true => Ok(()),
        false => Err(format!("{sample} of {} images have a place", samples.len())),
    }
}

/// The number of entries that a table commits, if they are there.
fn entries(table: &[u8], width: usize, at: usize) -> Result<usize, String> {
    let count = number(table, at, 4)? as usize;
    match count.checked_mul(width).and_then(|bytes| bytes.checked_add(at + 4)) {
        Some(needed) if needed <= table.len() => Ok(count),
        _ => Err("a table is cut short".to_owned()),
    }
}

/// A big-endian number of `width` bytes.
pub(super) fn number(bytes: &[u8], at: usize, width: usize) -> Result<u64, String> {
    let bytes = at.checked_add(width).and_then(|end| bytes.get(at..end)).ok_or("a box is cut short")?;
    Ok(bytes.iter().fold(0, |value, &byte| value << 8 | u64::from(byte)))
}
