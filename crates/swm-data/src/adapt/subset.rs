//! Some episodes of a dataset, and the split into disjoint parts by episode. (Clips of one episode overlap, so a split
//! by clip would show the training data to the test.)

use std::sync::Arc;

use rand::seq::SliceRandom;
use swm_core::seed::keyed;
use swm_core::{Metadata, SliceMut};

use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;

/// The chosen episodes of a dataset, in the chosen order.
pub struct Subset {
    inner: Box<dyn Dataset>,
    episodes: Arc<[usize]>,
    info: DatasetInfo,
}

impl Subset {
    /// Chooses episodes by their numbers; each must exist. Repetitions are allowed.
    ///
    /// # Errors
    ///
    /// [`DataError::Request`]: an episode that does not exist.
    pub fn new(inner: Box<dyn Dataset>, episodes: &[usize]) -> Result<Self, DataError> {
        let count = inner.num_episodes();
        if let Some(wrong) = episodes.iter().find(|&&episode| episode >= count) {
            let reason = format!("there is no episode {wrong}; the dataset holds {count}");
            return Err(DataError::request(inner.path(), reason));
        }
        let mut runs: Vec<(u64, Metadata)> = Vec::new();
        let run_of = |episode: usize| inner.info().runs.iter().rfind(|(first, _)| *first <= episode as u64);
        for (at, &episode) in episodes.iter().enumerate() {
            let Some((_, run)) = run_of(episode) else { continue };
            if runs.last().is_none_or(|(_, last)| last != run) {
                runs.push((at as u64, run.clone()));
            }
        }
        let mut info = inner.info().clone();
        info.lengths = episodes.iter().map(|&episode| inner.episode_len(episode)).collect();
        info.runs = runs.into();
        Ok(Self { inner, episodes: episodes.into(), info })
    }

    /// The episode of the underlying dataset that stands at `episode` here; `None` behind the end.
    pub fn original(&self, episode: usize) -> Option<usize> {
        self.episodes.get(episode).copied()
    }
}

/// Splits `count` episodes at random into parts of these fractions (which need not sum to 1: `[0.9, 0.1]`, `[4, 1]`);
/// a function of `seed`. Parts are disjoint, sorted, and together all episodes.
///
/// # Errors
///
/// [`DataError::Loader`]: a fraction that is negative or not finite, or nothing but zeros.
pub fn split_episodes(count: usize, fractions: &[f64], seed: u64) -> Result<Vec<Vec<usize>>, DataError> {
    let total: f64 = fractions.iter().sum();
    let sound = |fraction: &f64| fraction.is_finite() && *fraction >= 0.0;
    if !fractions.iter().all(sound) || total.is_nan() || total <= 0.0 || total.is_infinite() {
        let reason = format!("fractions {fractions:?}; use numbers of 0 or more that do not all vanish");
        return Err(DataError::Loader { setting: "split", reason });
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(&mut keyed(seed, "split", [0, 0]));
    let (mut sum, mut first) = (0.0, 0);
    let mut parts = Vec::with_capacity(fractions.len());
    for (index, fraction) in fractions.iter().enumerate() {
        sum += fraction;
        let last = index + 1 == fractions.len();
        let end =
            if last { count } else { ((sum / total * count as f64).round() as usize).clamp(first, count) };
        let mut part = order[first..end].to_vec();
        part.sort_unstable();
        parts.push(part);
        first = end;
    }
    Ok(parts)
}

impl Dataset for Subset {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        self.inner.rows(column, self.episodes[episode], steps, out)
    }

    fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), DataError> {
        self.inner.dress(key)
    }

    fn origin(&self) -> Option<Origin> {
        Some(self.inner.origin()?.with(format_args!("episodes {:?}", self.episodes)))
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        self.inner.check_whole()
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        self.inner.check_episode(self.episodes[episode])
    }

    fn share(&self) -> Box<dyn Dataset> {
        let Self { inner, episodes, info } = self;
        Box::new(Self { inner: inner.share(), episodes: episodes.clone(), info: info.clone() })
    }
}
