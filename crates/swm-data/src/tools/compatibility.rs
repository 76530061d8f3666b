//! Checks whether episodes fit into one dataset: recorded in one environment, under the same settings, at one rate. A copy runs these
//! checks before it writes or replaces anything.

use std::fmt;
use std::path::PathBuf;

use swm_core::{Column, Dtype, Metadata};

use super::copy::Piece;
use crate::dataset::{Dataset, Steps};
use crate::error::DataError;
use crate::recording::difference;

/// How far the rate of timestamps may be from the one that is said of them, as a share: they are stored with 24 bits.
const RATE_TOLERANCE: f64 = 0.01;
/// Rows by which the last one of an episode may be early or late.
const JITTER: f64 = 0.4;
/// Two rates that differ by a smaller share are one, computed in two ways.
const RATE_ROUNDING: f64 = 1e-6;
/// Times of rows in seconds, in LeRobot's tables.
const TIMESTAMP: &str = "timestamp";

/// The record of the run that an episode comes from; `None`: its file has none.
pub(super) fn run_of(source: &dyn Dataset, episode: usize) -> Option<&Metadata> {
    let runs = &source.info().runs;
    runs.iter().rfind(|&&(first, _)| first <= episode as u64).map(|(_, metadata)| metadata)
}

/// Refuses episodes of several environments, settings or frame skips, as no format takes them into one dataset.
///
/// # Errors
///
/// [`DataError::Request`], which names the first source that differs from that of the first piece, and both values.
pub fn check_recordings(sources: &[Box<dyn Dataset>], pieces: &[Piece]) -> Result<(), DataError> {
    let unknown = Metadata::unknown();
    let mut runs = pieces.iter().map(|&(source, episode)| {
        let source = sources[source].as_ref();
        (source, run_of(source, episode).unwrap_or(&unknown))
    });
    let Some((first, wanted)) = runs.next() else { return Ok(()) };
    let different = runs.find_map(|(source, run)| difference(run, wanted).map(|told| (source, told)));
    let Some((source, [here, there])) = different else { return Ok(()) };
    let reason = format!(
        "it {here}, {} {there}; merge only datasets of the same environment, settings and frame skip",
        first.path().display()
    );
    Err(DataError::request(source.path(), reason))
}

/// Why it is not certain at which rate the rows of a copy follow each other, so that its options have to say it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RateDoubt {
    /// The source whose rate is in doubt.
    pub path: PathBuf,
    /// What it says, and what contradicts that.
    pub reason: String,
    /// The rate of the timestamps, where these contradict the dataset.
    pub rate: Option<f64>,
}

impl fmt::Display for RateDoubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.reason)
    }
}

impl From<RateDoubt> for DataError {
    fn from(doubt: RateDoubt) -> Self {
        let fix = match doubt.rate {
            Some(rate) => format!("`fps` {} takes that of the timestamps", rate_text(rate)),
            None => "`fps` decides".to_owned(),
        };
        DataError::request(&doubt.path, format!("{}; {fix}", doubt.reason))
    }
}

/// Looks for sources of different rates, and for timestamps of another rate than a file of another program says.
pub fn rate_doubt(sources: &mut [Box<dyn Dataset>], pieces: &[Piece]) -> Option<RateDoubt> {
    let mut first: Option<(usize, f64)> = None;
    for &(source, episode) in pieces {
        let (info, run) = (sources[source].info(), run_of(sources[source].as_ref(), episode));
        let Some(rate) = run.map_or(info.rows_per_second, |run| run.rows_per_second) else { continue };
        let (other, wanted) = *first.get_or_insert((source, rate));
        if (rate / wanted - 1.0).abs() > RATE_ROUNDING {
            let other = sources[other].path().display();
            let reason = format!("it has {} rows per second, {other} {}", rate_text(rate), rate_text(wanted));
            return Some(RateDoubt { path: sources[source].path().to_owned(), reason, rate: None });
        }
        if run.is_some() && info.rows_per_second.is_none() {
            // Those of this program hold no timestamps beside their rate.
            continue;
        }
        if let Some(found) = rate_of_timestamps(sources[source].as_mut(), episode)
            && let Some(found) = other_rate(found, rate, sources[source].episode_len(episode))
        {
            return Some(RateDoubt {
                path: sources[source].path().to_owned(),
                reason: format!(
                    "`fps` of meta/info.json is {}, the timestamps of episode {episode} are those of {} rows per second",
                    rate_text(rate),
                    rate_text(found)
                ),
                rate: rate_text(found).parse().ok().filter(|&rate| is_rate(rate)),
            });
        }
    }
    None
}

/// The rate of an episode's timestamps. What cannot be read is told where it is copied.
fn rate_of_timestamps(source: &mut dyn Dataset, episode: usize) -> Option<f64> {
    let schema = source.schema().clone();
    let column = schema.index(TIMESTAMP)?;
    let (field, rows) = (&schema.fields()[column], source.episode_len(episode));
    if field.dtype != Dtype::F32 || field.dim() != 1 || rows < 2 {
        return None;
    }
    let mut times = Column::zeros(Dtype::F32, 2);
    let ends = Steps { first: 0, count: 2, stride: rows - 1 };
    source.read_column(column, episode, ends, times.as_slice_mut()).ok()?;
    match times {
        Column::F32(times) => Some(rate(rows, times[0], times[1])),
        _ => None,
    }
}

/// Rows per second of so many rows, by the times of the first and the last in seconds.
#[must_use]
pub fn rate(rows: usize, begin: f32, end: f32) -> f64 {
    rows.saturating_sub(1) as f64 / (f64::from(end) - f64::from(begin))
}

/// The rate of the timestamps of so many rows, if it is not the one that is said of them. Clocks jitter: the last row of a short episode
/// may be early or late by a part of a row.
#[must_use]
pub fn other_rate(found: f64, said: f64, rows: usize) -> Option<f64> {
    // What is no number differs, too.
    let is_near = (found / said - 1.0).abs() <= RATE_TOLERANCE;
    let is_jitter = (said / found - 1.0).abs() * rows.saturating_sub(1) as f64 <= JITTER;
    (!is_near && !is_jitter).then_some(found)
}

/// A rate as people write it: whole where it is nearly so.
#[must_use]
pub fn rate_text(rate: f64) -> String {
    let whole = rate.round();
    match (rate / whole - 1.0).abs() <= RATE_TOLERANCE / 10.0 {
        true => whole.to_string(),
        false => format!("{rate:.4}"),
    }
}

/// Whether the rate of timestamps can be one.
#[must_use]
pub fn is_rate(rate: f64) -> bool {
    rate.is_finite() && rate > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_told_as_people_write_them() {
        assert_eq!(
            ["10", "29.9700", "inf"],
            [10.000_02, 29.97, f64::INFINITY].map(rate_text).each_ref().map(|t| &t[..])
        );
        assert!(is_rate(rate(11, 0.0, 1.0)) && !is_rate(rate(11, 1.0, 1.0)));
        assert_eq!((other_rate(10.09, 10.0, 1000), other_rate(10.2, 10.0, 1000)), (None, Some(10.2)));
        assert_eq!((other_rate(9.6, 10.0, 5), other_rate(9.6, 10.0, 50)), (None, Some(9.6)));
        assert_eq!(other_rate(20.0, 10.0, 2), Some(20.0));
        assert!(other_rate(f64::NAN, 10.0, 5).is_some());
    }
}
