//! The ledger of several evaluations on the same pairs (*cells*): one process fills it, or each of several a part of it, which
//! are joined afterwards. Episode `cell` × pairs + `pair` is the pair's episode in that cell.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Serialize;
use swm_core::error::BoxError;
use swm_core::evaluate::EpisodeResult;
use swm_data::tools::parts;

use super::resume::Ledger;

/// The folder of parts, in the folder of the result.
const PARTS: &str = "parts";
/// Parts are listed up to this number.
const MAX_LISTED: usize = 8;

/// Finished episodes, cell by cell.
pub struct CellLedger {
    pairs: u64,
    /// The episodes that are to be run here.
    range: Range<u64>,
    known: BTreeMap<u64, EpisodeResult>,
    /// Seconds that the known episodes took, by cell.
    seconds: BTreeMap<u64, f64>,
    ledger: Option<Ledger>,
    /// The parts that it was joined from.
    parts: Vec<PathBuf>,
}

impl CellLedger {
    /// A ledger of `cells` cells of `pairs` pairs in memory.
    pub fn in_memory(cells: u64, pairs: u64) -> Self {
        let (known, seconds) = (BTreeMap::new(), BTreeMap::new());
        Self { pairs, range: 0..cells * pairs, known, seconds, ledger: None, parts: Vec::new() }
    }

    /// The same in the file `path`, which an interrupted run of the evaluations that `identity` describes may have begun.
    ///
    /// # Errors
    ///
    /// As of [`Ledger::open`].
    pub fn open(path: &Path, identity: &impl Serialize, cells: u64, pairs: u64) -> Result<Self, BoxError> {
        let ledger = Ledger::open(path, identity)?;
        let mut opened = Self { known: ledger.known.clone(), ..Self::in_memory(cells, pairs) };
        opened.count_seconds(&ledger);
        opened.ledger = Some(ledger);
        Ok(opened)
    }

    /// Part `shard` (counted from 1) of `of` parts, in a file below the folder `dir`.
    ///
    /// # Errors
    ///
    /// The folder cannot be made; as of [`Ledger::open`].
    pub fn open_part(
        dir: &Path,
        (shard, of): (u64, u64),
        identity: &impl Serialize,
        cells: u64,
        pairs: u64,
    ) -> Result<Self, BoxError> {
        let path = part_path(dir, shard, of);
        let parts = dir.join(PARTS);
        fs::create_dir_all(&parts)
            .map_err(|error| format!("cannot write to the folder {}: {error}", parts.display()))?;
        let range = parts::range(shard, of, cells * pairs);
        Ok(Self { range, ..Self::open(&path, identity, cells, pairs)? })
    }

    /// Joins the parts below `dir`. Nothing is left to be run.
    ///
    /// # Errors
    ///
    /// No part is there, parts of several divisions are there, one is of another evaluation, or some are missing or not
    /// finished, which the message names.
    pub fn join(dir: &Path, identity: &impl Serialize, cells: u64, pairs: u64) -> Result<Self, BoxError> {
        let mut joined = Self { range: 0..0, ..Self::in_memory(cells, pairs) };
        let there = parts_in(&dir.join(PARTS))?;
        let Some(&(_, of)) = there.keys().next() else {
            let dir = dir.join(PARTS);
            return Err(format!("{} holds no parts; --shard I/N makes them", dir.display()).into());
        };
        if let Some((&(shard, other), path)) = there.iter().find(|((_, other), _)| *other != of) {
            let path = path.display();
            return Err(format!(
                "{path} is part {shard}/{other}, others are of {of} parts; remove those of one division"
            )
            .into());
        }
        let mut missing = Vec::new();
        for shard in 1..=of {
            match there.get(&(shard, of)) {
                // A part without episodes need not be there.
                None if parts::range(shard, of, cells * pairs).is_empty() => {}
                None => missing.push(format!("{shard}/{of} is missing")),
                Some(path) => {
                    let part = Ledger::read(path, identity)?;
                    if !part.is_finished() {
                        missing.push(format!("{shard}/{of} is not finished"));
                    }
                    joined.count_seconds(&part);
                    joined.known.extend(part.known);
                    joined.parts.push(path.clone());
                }
            }
        }
        if missing.is_empty() {
            return Ok(joined);
        }
        let count = missing.len();
        missing.truncate(MAX_LISTED);
        if count > MAX_LISTED {
            missing.push(format!("{} more", count - MAX_LISTED));
        }
        Err(format!(
            "{} does not hold all parts: {}; run this command with --shard I/{of} in place of --join for each of them",
            dir.join(PARTS).display(),
            missing.join(", ")
        )
        .into())
    }

    /// Seconds that a cell took, as far as its episodes were written to a file.
    pub fn seconds(&self, cell: u64) -> f64 {
        self.seconds.get(&cell).copied().unwrap_or_default()
    }

    /// The known episodes of a cell, by pair.
    pub fn known(&self, cell: u64) -> BTreeMap<u64, EpisodeResult> {
        let first = cell * self.pairs;
        let known = self.known.range(first..first + self.pairs);
        known.map(|(episode, result)| (episode - first, result.clone())).collect()
    }

    /// The pairs of a cell that are to be run here, whether or not they are known.
    pub fn wanted(&self, cell: u64) -> Range<u64> {
        let first = cell * self.pairs;
        let clamp = |episode: u64| episode.clamp(first, first + self.pairs) - first;
        clamp(self.range.start)..clamp(self.range.end)
    }

    /// Adds the finished episode of a pair in a cell.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn push(&mut self, cell: u64, pair: u64, result: &EpisodeResult) -> Result<(), BoxError> {
        let episode = cell * self.pairs + pair;
        self.known.insert(episode, result.clone());
        self.ledger.as_mut().map_or(Ok(()), |ledger| ledger.push(episode, result))
    }

    /// Marks a part as finished, so that it can be joined.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn finish_part(self) -> Result<(), BoxError> {
        self.ledger.map_or(Ok(()), Ledger::finish)
    }

    /// Removes the files: the result holds everything.
    ///
    /// # Errors
    ///
    /// A file cannot be removed.
    pub fn close(self) -> Result<(), BoxError> {
        for path in &self.parts {
            fs::remove_file(path).map_err(|error| format!("cannot remove {}: {error}", path.display()))?;
        }
        if let Some(folder) = self.parts.first().and_then(|part| part.parent()) {
            // What else is in the folder is not ours.
            let _ = fs::remove_dir(folder);
        }
        self.ledger.map_or(Ok(()), Ledger::close)
    }

    fn count_seconds(&mut self, ledger: &Ledger) {
        for (episode, seconds) in &ledger.seconds {
            *self.seconds.entry(episode / self.pairs.max(1)).or_default() += seconds;
        }
    }
}

/// `parts/0003-of-0064.jsonl`.
fn part_path(dir: &Path, shard: u64, of: u64) -> PathBuf {
    dir.join(PARTS).join(format!("{shard:04}-of-{of:04}.jsonl"))
}

/// The parts in a folder, by number and count.
fn parts_in(folder: &Path) -> Result<BTreeMap<(u64, u64), PathBuf>, BoxError> {
    let mut parts = BTreeMap::new();
    if !folder.is_dir() {
        return Ok(parts);
    }
    let failed = |error: std::io::Error| format!("cannot read the folder {}: {error}", folder.display());
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name =
            path.file_name().and_then(|name| name.to_str()).and_then(|name| name.strip_suffix(".jsonl"));
        let numbers = name.and_then(|name| name.split_once("-of-"));
        if let Some((Ok(shard), Ok(of))) = numbers.map(|(shard, of)| (shard.parse(), of.parse())) {
            parts.insert((shard, of), path);
        }
    }
    Ok(parts)
}
