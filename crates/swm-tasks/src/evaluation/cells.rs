//! The ledger of several evaluations on the same pairs (*cells*): one process fills it, or each of several a part of it, which
//! are joined afterwards. Episode `cell` × pairs + `pair` is the pair's episode in that cell.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value as Json;
use swm_core::evaluate::EpisodeResult;
use swm_data::tools::parts;

use super::resume::{Ledger, identity as described};
use crate::error::cannot;
use crate::request::{Fix, Message, TaskError};

/// The folder of parts, in the folder of the result.
const PARTS: &str = "parts";
/// Parts are listed up to this number.
const MAX_LISTED: usize = 8;

/// In which order the episodes of all cells are divided among parts: each part runs a stretch of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Division {
    /// Cell by cell: for cells that cost about the same. A part has few cells, and makes their environments once.
    #[default]
    ByCell,
    /// Pair by pair: every part gets its share of each cell. For cells of policies of which some cost much more than others.
    ByPair,
}

/// Finished episodes, cell by cell.
pub struct CellLedger {
    cells: u64,
    pairs: u64,
    /// The episodes that are to be run here, counted in the order of `division`.
    range: Range<u64>,
    division: Division,
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
        let (known, seconds, division) = (BTreeMap::new(), BTreeMap::new(), Division::default());
        Self {
            cells,
            pairs,
            range: 0..cells * pairs,
            division,
            known,
            seconds,
            ledger: None,
            parts: Vec::new(),
        }
    }

    /// The same in the file `path`, which an interrupted run of the evaluations that `identity` describes may have begun.
    ///
    /// # Errors
    ///
    /// As of [`Ledger::open`].
    pub fn open(path: &Path, identity: &impl Serialize, cells: u64, pairs: u64) -> Result<Self, TaskError> {
        Ok(Self::of(Ledger::open(path, identity)?, cells, pairs))
    }

    /// As [`CellLedger::open`], but a file of other evaluations is replaced.
    ///
    /// # Errors
    ///
    /// As of [`Ledger::open_again`].
    pub fn open_again(
        path: &Path,
        identity: &impl Serialize,
        cells: u64,
        pairs: u64,
    ) -> Result<Self, TaskError> {
        Ok(Self::of(Ledger::open_again(path, identity)?, cells, pairs))
    }

    fn of(ledger: Ledger, cells: u64, pairs: u64) -> Self {
        let mut opened = Self { known: ledger.known.clone(), ..Self::in_memory(cells, pairs) };
        opened.count_seconds(&ledger);
        opened.ledger = Some(ledger);
        opened
    }

    /// Part `shard` (counted from 1) of `of` parts, in a file below the folder `dir`. Where an earlier version of this program, which
    /// divided by cell, began parts, this one is divided as they are.
    ///
    /// # Errors
    ///
    /// The folder cannot be made, or holds parts of another number of parts, which could not be joined with this one; as of [`Ledger::open`].
    pub fn open_part(
        dir: &Path,
        (shard, of): (u64, u64),
        division: Division,
        identity: &impl Serialize,
        cells: u64,
        pairs: u64,
    ) -> Result<Self, TaskError> {
        let path = part_path(dir, shard, of);
        let parts = dir.join(PARTS);
        fs::create_dir_all(&parts).map_err(cannot("write to the folder", &parts))?;
        let there = parts_in(&parts)?;
        if let Some((one, other)) = there.keys().find(|(_, other)| *other != of) {
            let parts = parts.display();
            return Err(format!(
                "{parts} holds part {one}/{other}, and {shard}/{of} would not go with it; run parts of {other}, remove those that are \
                 there, or give another folder"
            )
            .into());
        }
        let range = parts::range(shard, of, cells * pairs);
        let by_cell = Division::ByCell.identity(identity)?;
        let division = match division {
            Division::ByPair if cells > 1 && !there.values().any(|path| Ledger::is_of(path, &by_cell)) => {
                Division::ByPair
            }
            _ => Division::ByCell,
        };
        let opened = Self::open(&path, &division.identity(identity)?, cells, pairs)?;
        Ok(Self { range, division, ..opened })
    }

    /// Joins the parts below `dir`. Nothing is left to be run.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`]: no part is there, parts of several divisions are there, one is of another evaluation, or some are missing or not
    /// finished, which the message names.
    pub fn join(
        dir: &Path,
        division: Division,
        identity: &impl Serialize,
        cells: u64,
        pairs: u64,
    ) -> Result<Self, TaskError> {
        let mut joined = Self { range: 0..0, ..Self::in_memory(cells, pairs) };
        let there = parts_in(&dir.join(PARTS))?;
        let Some(&(_, of)) = there.keys().next() else {
            let dir = dir.join(PARTS);
            let fix = Fix::set_to("shard", "I/N", "to make them");
            return Err(Message::new(format!("{} holds no parts", dir.display())).fix(fix).into());
        };
        if let Some((&(shard, other), path)) = there.iter().find(|((_, other), _)| *other != of) {
            let path = path.display();
            let text = format!(
                "{path} is part {shard}/{other}, others are of {of} parts; remove those of one division"
            );
            return Err(Message::new(text).into());
        }
        let (by_cell, by_pair) = (Division::ByCell.identity(identity)?, Division::ByPair.identity(identity)?);
        let first_of = |identity: &[Json]| there.values().find(|path| Ledger::is_of(path, &identity));
        let is_by_pair = division == Division::ByPair && cells > 1;
        let older = first_of(&by_cell).filter(|_| is_by_pair);
        if let (Some(older), Some(newer)) = (older, first_of(&by_pair)) {
            let (older, newer) = (older.display(), newer.display());
            return Err(Message::new(format!(
                "{older} is a part by an earlier version of swm, which divided the episodes in another order than {newer} has them; \
                 remove the parts of one of the two, and run those shards again"
            ))
            .into());
        }
        let identity = if is_by_pair && older.is_none() { by_pair } else { by_cell };
        let mut missing = Vec::new();
        for shard in 1..=of {
            match there.get(&(shard, of)) {
                // A part without episodes need not be there.
                None if parts::range(shard, of, cells * pairs).is_empty() => {}
                None => missing.push(format!("{shard}/{of} is missing")),
                Some(path) => {
                    let part =
                        Ledger::read(path, &identity).map_err(|error| Message::new(error.to_string()))?;
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
        let text = format!("{} does not hold all parts: {}", dir.join(PARTS).display(), missing.join(", "));
        let fix = Fix::set_to("shard", format!("I/{of}"), "in place of a join, for each of them");
        Err(Message::new(text).fix(fix).into())
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
        // How many pairs of the cell come before an episode.
        let before = |episode: u64| match self.division {
            Division::ByCell => episode.clamp(first, first + self.pairs) - first,
            Division::ByPair => episode.saturating_sub(cell).div_ceil(self.cells),
        };
        before(self.range.start)..before(self.range.end)
    }

    /// Adds the finished episode of a pair in a cell.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn push(&mut self, cell: u64, pair: u64, result: &EpisodeResult) -> Result<(), TaskError> {
        let episode = cell * self.pairs + pair;
        self.known.insert(episode, result.clone());
        self.ledger.as_mut().map_or(Ok(()), |ledger| ledger.push(episode, result))
    }

    /// Marks a part as finished, so that it can be joined.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn finish_part(self) -> Result<(), TaskError> {
        self.ledger.map_or(Ok(()), Ledger::finish)
    }

    /// Removes the files: the result holds everything.
    ///
    /// # Errors
    ///
    /// A file cannot be removed.
    pub fn close(self) -> Result<(), TaskError> {
        for path in &self.parts {
            fs::remove_file(path).map_err(cannot("remove", path))?;
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

impl Division {
    /// What episodes of a part belong to. Another version of this program must not take a part of one division for one of the other.
    fn identity(self, identity: &impl Serialize) -> Result<Vec<Json>, TaskError> {
        let mut all = described(identity, &BTreeMap::new())?;
        all.extend((self == Self::ByPair).then(|| "divided by pair".into()));
        Ok(all)
    }
}

/// `parts/0003-of-0064.jsonl`.
fn part_path(dir: &Path, shard: u64, of: u64) -> PathBuf {
    dir.join(PARTS).join(format!("{shard:04}-of-{of:04}.jsonl"))
}

/// The parts in a folder, by number and count.
fn parts_in(folder: &Path) -> Result<BTreeMap<(u64, u64), PathBuf>, TaskError> {
    let mut parts = BTreeMap::new();
    if !folder.is_dir() {
        return Ok(parts);
    }
    let failed = cannot("read the folder", folder);
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

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: [&str; 2] = ["manifest", "policies"];

    /// The pairs of each cell that each part gets, of 3 cells of 10 pairs.
    fn divided(folder: &Path, of: u64, division: Division) -> Vec<[Range<u64>; 3]> {
        let part = |shard| CellLedger::open_part(folder, (shard, of), division, &IDENTITY, 3, 10).unwrap();
        (1..=of).map(|shard| [0, 1, 2].map(|cell| part(shard).wanted(cell))).collect()
    }

    #[test]
    fn every_part_gets_its_share_of_each_cell() {
        for of in [1, 4, 7, 30, 64] {
            let folder = tempfile::tempdir().unwrap();
            let parts = divided(folder.path(), of, Division::ByPair);
            for cell in 0..3 {
                let pairs: Vec<u64> = parts.iter().flat_map(|part| part[cell].clone()).collect();
                assert_eq!(pairs, (0..10).collect::<Vec<u64>>(), "{of} parts");
            }
            for (shard, part) in (1..).zip(&parts) {
                let counts = part.each_ref().map(|pairs| pairs.end - pairs.start);
                assert_eq!(counts.iter().sum::<u64>(), parts::range(shard, of, 30).count() as u64);
                let [most, least] = [counts.iter().max(), counts.iter().min()].map(|count| count.unwrap());
                assert!(most - least <= 1, "part {shard}/{of}: {counts:?}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(
            divided(folder.path(), 2, Division::ByCell),
            [[0..10, 0..5, 0..0], [10..10, 5..10, 0..10]]
        );
    }

    #[test]
    fn a_part_of_another_number_of_parts_is_refused_before_it_runs() {
        let folder = tempfile::tempdir().unwrap();
        let part = |shard, of| {
            CellLedger::open_part(folder.path(), (shard, of), Division::default(), &IDENTITY, 3, 10)
        };
        part(1, 2).unwrap();
        let message = part(2, 3).err().expect("parts of two divisions").to_string();
        assert!(message.contains("holds part 1/2, and 2/3 would not go with it"), "{message}");
        part(2, 2).unwrap();
    }

    /// Runs part `shard` of 2, as the version does that divides so, up to its end.
    fn run(folder: &Path, shard: u64, division: Division) {
        let mut part = CellLedger::open_part(folder, (shard, 2), division, &IDENTITY, 3, 10).unwrap();
        for cell in 0..3 {
            let known = part.known(cell);
            for pair in part.wanted(cell).filter(|pair| !known.contains_key(pair)) {
                part.push(cell, pair, &EpisodeResult::default()).unwrap();
            }
        }
        part.finish_part().unwrap();
    }

    fn join(folder: &Path) -> Result<CellLedger, String> {
        CellLedger::join(folder, Division::ByPair, &IDENTITY, 3, 10).map_err(|error| error.to_string())
    }

    #[test]
    fn parts_of_an_earlier_version_are_continued_as_they_were_divided() {
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), 1, Division::ByCell);
        assert!(join(folder.path()).err().unwrap().contains("2/2 is missing"));
        run(folder.path(), 2, Division::ByPair);
        let joined = join(folder.path()).unwrap();
        assert_eq!([0, 1, 2].map(|cell| joined.known(cell).len()), [10; 3]);
    }

    #[test]
    fn parts_of_two_divisions_are_not_joined() {
        let [folder, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        run(folder.path(), 1, Division::ByPair);
        run(other.path(), 2, Division::ByCell);
        let part = part_path(folder.path(), 2, 2);
        fs::copy(part_path(other.path(), 2, 2), &part).unwrap();
        let message = join(folder.path()).err().unwrap();
        assert!(message.contains("0002-of-0002.jsonl is a part by an earlier version of swm"), "{message}");
        assert!(message.contains("0001-of-0002.jsonl"), "{message}");
        fs::remove_file(part).unwrap();
        run(folder.path(), 2, Division::ByPair);
        assert_eq!(join(folder.path()).unwrap().known(2).len(), 10);
    }
}
