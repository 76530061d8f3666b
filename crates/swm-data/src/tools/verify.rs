//! Proving a dataset sound: every row of every column can be read, checksums are right, episodes have rows, episode
//! columns do not change within an episode, steps count, numbers of recordings of this program are finite.

use rayon::prelude::*;
use serde::Serialize;
use swm_core::env::PIXELS;
use swm_core::{Dtype, Field, FieldKind, Slice};

use super::blocks;
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::recording::EP_IDX;

/// The column that is missing in the last row of an episode, by design.
const ACTION: &str = "action";
/// The column that counts the steps of an episode.
const STEP_IDX: &str = "step_idx";
/// The column of goal images.
const GOAL: &str = "goal";
/// Problems are listed up to this number.
const MAX_PROBLEMS: usize = 100;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Report {
    /// Episodes that were read.
    pub episodes: usize,
    /// Their rows.
    pub rows: usize,
    /// Whether there were checksums to compare.
    pub has_checksums: bool,
    /// What is wrong; the first hundred.
    pub problems: Vec<Problem>,
    /// What is unusual, but may be meant.
    pub notes: Vec<String>,
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Problem {
    /// The episode, where it is one episode's.
    pub episode: Option<usize>,
    /// The column, where it is one column's.
    pub column: Option<String>,
    /// What is wrong.
    pub reason: String,
    /// This program does not read it; the dataset may be sound.
    pub unsupported: bool,
}

/// Episodes that one thread reads before the others are waited for.
const EPISODES_PER_THREAD: usize = 8;

/// Reads everything, the episodes on all threads. `watch` is told of each episode, in order, how many rows it has.
pub fn verify(dataset: &mut dyn Dataset, watch: &mut dyn FnMut(usize)) -> Report {
    let mut report = Report { has_checksums: dataset.info().has_checksums, ..Report::default() };
    let schema = dataset.schema().clone();
    for (name, reason) in &*dataset.info().skipped {
        report.notes.push(format!("`{name}` cannot be read and is left out: {reason}"));
    }
    report.notes.extend(schema.fields().iter().filter_map(no_image));
    if !report.has_checksums {
        report.notes.push("it has no checksums: changed values cannot be noticed".to_owned());
    }
    if let Err(error) = dataset.check_whole() {
        report.problems.push(Problem::of(error, None, None));
    }
    // What other programs wrote is as they wrote it, in copies, too.
    let is_of_others = dataset.info().runs.iter().any(|(_, run)| run.source.is_some());
    let mut missing = vec![0usize; schema.fields().len()];
    let mut infinite: Vec<Option<(usize, usize)>> = vec![None; schema.fields().len()];
    let count = dataset.num_episodes();
    let threads = rayon::current_num_threads().clamp(1, count.max(1));
    let mut handles: Vec<Box<dyn Dataset>> = (0..threads).map(|_| dataset.share()).collect();
    let per_round = threads * EPISODES_PER_THREAD;
    for first in (0..count).step_by(per_round) {
        let end = count.min(first + per_round);
        let look = |(thread, handle): (usize, &mut Box<dyn Dataset>)| -> Vec<(usize, EpisodeCheck)> {
            let own = (first + thread..end).step_by(threads);
            own.map(|episode| (episode, EpisodeCheck::of(handle.as_mut(), episode, is_of_others))).collect()
        };
        let mut checks: Vec<_> = handles.par_iter_mut().enumerate().flat_map_iter(look).collect();
        checks.sort_by_key(|(episode, _)| *episode);
        for (episode, check) in checks {
            let room = MAX_PROBLEMS.saturating_sub(report.problems.len());
            report.problems.extend(check.problems.into_iter().take(room));
            missing.iter_mut().zip(&check.missing).for_each(|(all, more)| *all += more);
            for (first, row) in infinite.iter_mut().zip(check.infinite) {
                *first = first.or(row.map(|row| (episode, row)));
            }
            report.episodes += 1;
            report.rows += check.rows;
            watch(check.rows);
        }
    }
    for ((field, &missing), infinite) in schema.fields().iter().zip(&missing).zip(infinite) {
        if missing > 0 && field.name != ACTION {
            report.notes.push(format!("column `{}` is NaN in {missing} of {} rows", field.name, report.rows));
        }
        if let Some((episode, row)) = infinite {
            let name = &field.name;
            report.notes.push(format!(
                "column `{name}` holds infinite numbers, first in episode {episode}, row {row}"
            ));
        }
    }
    report
}

/// The note of a column that looks like images and is read as numbers: channels first, or of floats.
fn no_image(field: &Field) -> Option<String> {
    let [first, _, last] = field.shape[..] else { return None };
    let has_channels = |len| len == 1 || len == 3;
    let is_like_one = match field.dtype {
        Dtype::U8 => has_channels(first) && !has_channels(last),
        _ => [PIXELS, GOAL].contains(&&*field.name) && (has_channels(first) || has_channels(last)),
    };
    let Field { name, dtype, shape, .. } = field;
    is_like_one.then(|| {
        format!("column `{name}` is {dtype} of shape {shape:?} and read as numbers; images are uint8 of shape [H, W, 3]")
    })
}

/// What was found in one episode.
struct EpisodeCheck {
    rows: usize,
    problems: Vec<Problem>,
    /// By column: rows with a NaN.
    missing: Vec<usize>,
    /// By column: the first row with an infinite number that is no problem.
    infinite: Vec<Option<usize>>,
}

impl EpisodeCheck {
    fn of(dataset: &mut dyn Dataset, episode: usize, is_of_others: bool) -> Self {
        let (rows, schema) = (dataset.episode_len(episode), dataset.schema().clone());
        let columns = schema.fields().len();
        let mut found =
            Self { rows, problems: Vec::new(), missing: vec![0; columns], infinite: vec![None; columns] };
        let mut add = |problem: Problem| {
            if found.problems.len() < MAX_PROBLEMS {
                found.problems.push(problem);
            }
        };
        let wrong = |column: Option<&str>, reason: String| Problem {
            episode: Some(episode),
            column: column.map(str::to_owned),
            reason,
            unsupported: false,
        };
        if rows == 0 {
            add(wrong(None, "it has no rows".to_owned()));
        }
        if let Err(error) = dataset.check_episode(episode) {
            add(Problem::of(error, Some(episode), None));
        }
        for (column, field) in schema.fields().iter().enumerate() {
            let mut column_check = ColumnCheck { rows, width: field.dim(), ..ColumnCheck::default() };
            let mut first: Option<swm_core::Column> = None;
            let mut steps = (field.name == STEP_IDX && field.dim() == 1).then(Steps::default);
            let read = blocks(dataset, column, episode, |start, values| {
                column_check.take(start, values.as_slice());
                if let Some(steps) = &mut steps {
                    steps.take(start, values.as_slice());
                }
                if field.kind == FieldKind::Episode || field.name == EP_IDX {
                    let width = field.dim();
                    let first = first.get_or_insert_with(|| values.as_slice().range(0, width).to_column());
                    for row in 0..values.len() / width.max(1) {
                        let here = values.as_slice().range(row * width, width);
                        let differs = super::compare::difference(&here, &first.as_slice(), 0.0).is_some();
                        // Images may have been stored with loss.
                        if differs && field.shape.len() < 3 {
                            column_check.changes.get_or_insert(start + row);
                        }
                    }
                }
                Ok::<_, DataError>(())
            });
            if let Err(error) = read {
                add(Problem::of(error, Some(episode), Some(&field.name)));
                continue;
            }
            if let Some(row) = column_check.changes {
                let reason = format!("it is constant in an episode, but changes at row {row}");
                add(wrong(Some(&field.name), reason));
            }
            if is_of_others {
                found.infinite[column] = column_check.infinite;
            } else if let Some(row) = column_check.infinite {
                add(wrong(Some(&field.name), format!("row {row} holds an infinite number")));
            }
            if let Some((row, before, number)) = steps.and_then(|steps| steps.wrong) {
                let reason = format!("it does not count: row {row} holds {number} after {before}");
                add(wrong(Some(STEP_IDX), reason));
            }
            found.missing[column] = column_check.missing;
            // Recordings leave out an action at the end, and what a first row cannot have; a column may be unused.
            let everywhere = column_check.missing == column_check.rows && field.name != ACTION;
            if let Some(row) = column_check.missing_within.filter(|_| !everywhere && !is_of_others) {
                add(wrong(Some(&field.name), format!("row {row} holds NaN")));
            }
        }
        found
    }
}

impl Problem {
    /// What an error says, without the place that the report names already.
    fn of(error: DataError, episode: Option<usize>, column: Option<&str>) -> Self {
        let unsupported = matches!(error, DataError::Unsupported { .. });
        let reason = match error {
            DataError::Damaged { column: None, episode: None, reason, .. }
            | DataError::Unsupported { column: None, episode: None, reason, .. } => reason.to_string(),
            DataError::Damaged { column: at, episode: here, reason, .. }
            | DataError::Unsupported { column: at, episode: here, reason, .. }
                if here == episode && at.as_deref() == column =>
            {
                reason.to_string()
            }
            error => error.to_string(),
        };
        Self { episode, column: column.map(str::to_owned), reason, unsupported }
    }
}

/// The numbers of steps, which rise by as much from each row to the next: by 1, or by the frames between two recorded rows.
#[derive(Default)]
struct Steps {
    last: Option<i64>,
    /// By how much the second is above the first.
    stride: Option<i64>,
    /// The first row that does not follow the one before, both numbers.
    wrong: Option<(usize, i64, i64)>,
}

impl Steps {
    fn take(&mut self, start: usize, values: Slice<'_>) {
        let number = |at: usize| match values {
            Slice::I32(values) => Some(i64::from(values[at])),
            Slice::I64(values) => Some(values[at]),
            _ => None,
        };
        for (row, number) in (0..values.len()).map_while(number).enumerate() {
            if let Some(last) = self.last.replace(number) {
                let rise = number.saturating_sub(last);
                if rise < 1 || rise != *self.stride.get_or_insert(rise) {
                    self.wrong.get_or_insert((start + row, last, number));
                }
            }
        }
    }
}

#[derive(Default)]
struct ColumnCheck {
    rows: usize,
    width: usize,
    /// Rows with a NaN.
    missing: usize,
    /// The first of them that is neither the first nor the last of the episode.
    missing_within: Option<usize>,
    infinite: Option<usize>,
    changes: Option<usize>,
}

impl ColumnCheck {
    fn take(&mut self, start: usize, values: Slice<'_>) {
        match values {
            Slice::F32(values) => self.rows_of(start, values.len(), |at| f64::from(values[at])),
            Slice::F64(values) => self.rows_of(start, values.len(), |at| values[at]),
            _ => {}
        }
    }

    fn rows_of(&mut self, start: usize, len: usize, value: impl Fn(usize) -> f64) {
        let width = self.width.max(1);
        for row in 0..len / width {
            let values = || (row * width..(row + 1) * width).map(&value);
            let at = start + row;
            if values().any(f64::is_nan) {
                self.missing += 1;
                if at > 0 && at + 1 < self.rows {
                    self.missing_within.get_or_insert(at);
                }
            }
            if values().any(f64::is_infinite) {
                self.infinite.get_or_insert(at);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::error::{invalid, unsupported};

    #[test]
    fn what_is_not_supported_is_told_from_what_is_wrong() {
        let of = |reason: crate::error::FormatError| {
            Problem::of(DataError::damaged(Path::new("a.h5"), reason), Some(3), None)
        };
        let (damaged, unread) =
            (of(invalid("it ends early").at("row 2")), of(unsupported("12 bits").at("row 2")));
        assert_eq!((damaged.reason.as_str(), damaged.unsupported), ("row 2: it ends early", false));
        assert_eq!((unread.reason.as_str(), unread.unsupported), ("row 2: 12 bits", true));
        assert_eq!(unread.episode, Some(3));
    }
}
