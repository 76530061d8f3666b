//! Files with changed bytes: every file of every sample is cut, flipped and overwritten at many places, always the same ones, and read by
//! the command. Whatever comes of it must be an error in a sentence or other values.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;

use anyhow::{Context as _, Result, bail};

use super::samples::{self, Sample, copy, files};
use super::table::{Line, Table};
use super::trial::{Fault, Swm, words};

/// Numbers that sizes, counts and offsets are overwritten with.
const WORDS: [u32; 6] = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x0100_0000];
/// The same in texts.
const TEXTS: [&str; 6] = ["18446744073709551615", "-1", "1e999", "[]", "null", "\"../../x\""];

/// One file to damage, in one way.
struct Case<'a> {
    sample: &'a Sample,
    /// Below the sample's folder.
    file: &'a Path,
    number: usize,
}

/// Damages files of all samples, as many times each, and adds a line for each kind to the table.
pub(crate) fn run(swm: &Swm, damaged: usize, threads: usize, filter: &str, table: &mut Table) -> Result<()> {
    let folder = tempfile::tempdir().context("no folder for what is damaged")?;
    let mut all = samples::all(swm, folder.path())?;
    all.retain(|sample| sample.kind.contains(filter));
    if all.is_empty() {
        return Ok(());
    }
    for (index, sample) in all.iter().enumerate() {
        let count = damaged / all.len() + usize::from(index < damaged % all.len());
        let line = damage_each(swm, sample, count, threads)?;
        let Line { kind, tried, hit, longest_s, .. } = &line;
        eprintln!("{kind}: {hit} of {tried} noticed, {} failures, at most {longest_s:.2} s", line.failures());
        table.push(line);
    }
    Ok(())
}

/// Damages the files of a sample in turn.
fn damage_each(swm: &Swm, sample: &Sample, count: usize, threads: usize) -> Result<Line> {
    let of = files(&sample.folder.join(&sample.name))?;
    let of: Vec<PathBuf> =
        of.iter().filter_map(|file| file.strip_prefix(&sample.folder).ok().map(Path::to_owned)).collect();
    if of.is_empty() {
        bail!("{} has no files", sample.kind);
    }
    let total = Mutex::new(Line::new("damage", sample.kind.as_str()));
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let work = || -> Result<()> {
                    let place = Place::new(swm, sample)?;
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        if index >= count {
                            return Ok(());
                        }
                        let case = Case { sample, file: &of[index % of.len()], number: index / of.len() };
                        let line = place.play(swm, &case)?;
                        drop(total.lock().map(|mut total| total.add(&line)));
                    }
                };
                if let Err(error) = work() {
                    drop(failure.lock().map(|mut failure| *failure = Some(error)));
                }
            });
        }
    });
    if let Some(error) = failure.into_inner().unwrap_or_default() {
        return Err(error.context(sample.kind.clone()));
    }
    Ok(total.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// A copy of a sample that one thread damages.
struct Place(tempfile::TempDir);

impl Place {
    /// Copies it. Undamaged, every command on it must succeed.
    fn new(swm: &Swm, sample: &Sample) -> Result<Self> {
        let place = Self(tempfile::tempdir().context("no folder for what is damaged")?);
        for line in &sample.commands {
            // Commands that go on with what is there change it.
            place.restore(sample)?;
            swm.ok(place.0.path(), &line.replace("IN", &sample.name))?;
        }
        Ok(place)
    }

    fn restore(&self, sample: &Sample) -> Result<()> {
        for entry in samples::names(self.0.path())? {
            let path = self.0.path().join(entry);
            match path.is_dir() {
                true => fs::remove_dir_all(&path)?,
                false => fs::remove_file(&path)?,
            }
        }
        copy(&sample.folder, self.0.path())
    }

    /// Damages a file and runs the commands.
    fn play(&self, swm: &Swm, case: &Case<'_>) -> Result<Line> {
        let Case { sample, file, number } = case;
        self.restore(sample)?;
        let path = self.0.path().join(file);
        let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        fs::write(&path, damaged(&bytes, *number))?;
        let mut line = Line { tried: 1, ..Line::default() };
        for command in &sample.commands {
            let ended = swm.run(self.0.path(), &words(&command.replace("IN", &sample.name)))?;
            line.longest_s = line.longest_s.max(ended.took.as_secs_f64());
            if ended.code != Some(0) {
                line.hit = 1;
            }
            let Some(fault) = ended.fault() else { continue };
            let name = &sample.kind;
            eprintln!(
                "{name}: {}, damage {number}: `swm {command}`: {fault:?}: {}",
                file.display(),
                ended.text()
            );
            match fault {
                Fault::Panic => line.panics += 1,
                Fault::Hang => line.hangs += 1,
                Fault::Memory => line.memory += 1,
            }
        }
        Ok(line)
    }
}

/// Damage `number` of some bytes: a function of both.
fn damaged(bytes: &[u8], number: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    // Heads and ends decide most: half of the damage is there.
    let spread = (number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
    let at = match number % 4 {
        0 => spread as usize % bytes.len().clamp(1, 256),
        1 => bytes.len().saturating_sub(1 + spread as usize % bytes.len().clamp(1, 256)),
        _ => spread as usize % bytes.len().max(1),
    };
    if bytes.is_empty() {
        return b"\0".to_vec();
    }
    match number % 6 {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << (number % 8),
        2 => {
            let end = (at + 40).min(bytes.len());
            let copy = bytes[at..end].to_vec();
            bytes.splice(at..at, copy);
        }
        3 => other_value(&mut bytes, at, number),
        _ => {
            let word = WORDS[number / 6 % WORDS.len()];
            let word = if number.is_multiple_of(2) { word.to_le_bytes() } else { word.to_be_bytes() };
            for (byte, value) in bytes[at..].iter_mut().zip(word) {
                *byte = value;
            }
        }
    }
    bytes
}

/// Puts another value in the place of the next number of a text. Bytes that are no text are overwritten with one.
fn other_value(bytes: &mut Vec<u8>, at: usize, number: usize) {
    let is_digit = |byte: &u8| byte.is_ascii_digit();
    let start = bytes[at..].iter().position(is_digit).map_or(at, |offset| at + offset);
    let end =
        bytes[start..].iter().position(|byte| !is_digit(byte)).map_or(bytes.len(), |offset| start + offset);
    bytes.splice(start..end.max(start + 1), TEXTS[number / 6 % TEXTS.len()].bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_is_repeatable_and_changes_something() {
        let bytes: Vec<u8> = (0..=255).cycle().take(3000).collect();
        let changed = (0..600).filter(|&number| damaged(&bytes, number) != bytes).count();
        assert!(changed > 550, "{changed}");
        assert!((0..600).all(|number| damaged(&bytes, number) == damaged(&bytes, number)));
        let few: Vec<Vec<u8>> = (0..60).map(|number| damaged(b"{", number)).collect();
        assert!(few.iter().any(Vec::is_empty));
        assert_eq!(damaged(b"", 3), b"\0");
    }

    #[test]
    fn numbers_of_texts_become_other_values() {
        let mut text = b"{\"budget\": 200}".to_vec();
        other_value(&mut text, 2, 0);
        assert_eq!(text, b"{\"budget\": 18446744073709551615}");
        let mut text = b"{}".to_vec();
        other_value(&mut text, 1, 3 * 6);
        assert_eq!(text, b"{[]");
    }
}
