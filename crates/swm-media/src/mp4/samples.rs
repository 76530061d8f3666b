//! The sample tables of a track (`stbl`): where each coded image lies, when it is shown, and which are key frames.

use super::boxes::{Wrong, entries, find, number, signed};

/// One coded image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sample {
    pub(super) offset: u64,
    pub(super) size: usize,
    /// Whether the file lists it as a place to start at. Pictures that are no IDR pictures are listed too.
    pub(super) key: bool,
    /// When it is shown, in units of the track, before the edit list.
    pub(super) time: i64,
}

/// The samples of a track, in the order in which they are decoded.
#[derive(Debug, Default)]
pub(super) struct Samples {
    pub(super) list: Vec<Sample>,
    /// Where the decoding times end, in units of the track.
    pub(super) clock: i64,
    /// Their durations, in units of the track.
    pub(super) duration: u64,
}

impl Samples {
    /// From the box `stbl` of a file of `length` bytes.
    pub(super) fn read(table: &[u8], length: u64) -> Result<Self, Wrong> {
        let sizes = sizes(find(table, b"stsz")?, length)?;
        let mut samples = times(table, &sizes)?;
        place(table, length, &mut samples.list)?;
        if let Ok(keys) = find(table, b"stss") {
            for at in 0..entries(keys, 4, 4)? {
                let key = number(keys, 8 + 4 * at, 4)? as usize;
                match key.checked_sub(1).and_then(|key| samples.list.get_mut(key)) {
                    Some(sample) => sample.key = true,
                    None => return Err(format!("its key frame {key} does not exist").into()),
                }
            }
        } else {
            samples.list.iter_mut().for_each(|sample| sample.key = true);
        }
        Ok(samples)
    }
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

/// Samples of these sizes with the times at which they are shown.
fn times(table: &[u8], sizes: &[usize]) -> Result<Samples, String> {
    let durations = find(table, b"stts")?;
    let mut samples = Samples { list: Vec::with_capacity(sizes.len()), ..Samples::default() };
    for at in 0..entries(durations, 8, 4)? {
        let (run, delta) = (number(durations, 8 + 8 * at, 4)?, number(durations, 12 + 8 * at, 4)? as i64);
        for _ in 0..run {
            let Some(&size) = sizes.get(samples.list.len()) else { break };
            samples.list.push(Sample { offset: 0, size, key: false, time: samples.clock });
            samples.clock += delta;
        }
    }
    if samples.list.len() != sizes.len() {
        return Err(format!("{} of {} images have a time", samples.list.len(), sizes.len()));
    }
    samples.duration = samples.clock.max(0) as u64;
    if let Ok(shifts) = find(table, b"ctts") {
        let mut sample = 0;
        for at in 0..entries(shifts, 8, 4)? {
            // Signed in version 1, and below 2^31 in version 0.
            let (run, shift) = (number(shifts, 8 + 8 * at, 4)?, signed(shifts, 12 + 8 * at)?);
            for sample in samples.list.iter_mut().skip(sample).take(run as usize) {
                sample.time += shift;
            }
            sample = sample.saturating_add(run as usize);
        }
    }
    Ok(samples)
}

/// Fills in where each sample lies: samples come in chunks, of which the file lists the offsets.
fn place(table: &[u8], length: u64, samples: &mut [Sample]) -> Result<(), Wrong> {
    let (offsets, width) = match find(table, b"stco") {
        Ok(offsets) => (offsets, 4),
        Err(_) => (find(table, b"co64")?, 8),
    };
    let chunks = entries(offsets, width, 4)?;
    let runs = find(table, b"stsc")?;
    let runs_count = entries(runs, 12, 4)?;
    let count = samples.len();
    let mut rest = samples.iter_mut().enumerate();
    let mut placed = 0;
    for run in 0..runs_count {
        let field = |run: usize, at: usize| Ok::<_, String>(number(runs, 8 + 12 * run + at, 4)? as usize);
        let (first, per_chunk) = (field(run, 0)?, field(run, 4)?);
        one_description(field(run, 8)? as u64)?;
        let end = if run + 1 < runs_count { field(run + 1, 0)? } else { chunks + 1 };
        if first == 0 || end > chunks + 1 || end < first {
            return Err(format!("it has {chunks} chunks, but a table speaks of {end}").into());
        }
        for chunk in first - 1..end - 1 {
            let mut offset = number(offsets, 8 + width * chunk, width)?;
            for _ in 0..per_chunk {
                let Some((at, sample)) = rest.next() else { break };
                sample.offset = offset;
                offset = end_of(at, sample, length)?;
                placed += 1;
            }
        }
    }
    match placed == count {
        true => Ok(()),
        false => Err(format!("{placed} of {count} images have a place").into()),
    }
}

/// Where a sample ends in a file of `length` bytes.
pub(super) fn end_of(at: usize, sample: &Sample, length: u64) -> Result<u64, String> {
    let end = sample.offset.checked_add(sample.size as u64).filter(|&end| end <= length);
    end.ok_or_else(|| format!("it was cut short: image {at} lies behind its end"))
}

/// Refuses samples that are not of the first description.
pub(super) fn one_description(number: u64) -> Result<(), Wrong> {
    match number {
        0 | 1 => Ok(()),
        _ => Err(Wrong::Unsupported(
            "an MP4 file with several sample descriptions is not decoded; encode the video again".to_owned(),
        )),
    }
}
