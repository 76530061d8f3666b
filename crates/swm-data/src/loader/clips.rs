//! Which clips a dataset has: the windows of rows that lie inside one episode.

/// How the starts of clips are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Clips {
    /// Every row from which a clip fits.
    #[default]
    Every,
    /// 50 starts per episode, evenly spread and rounded down, whatever its length: short episodes give duplicates,
    /// long ones gaps. This is what the paper's loader does; for reproductions of its results.
    Paper,
}

/// Starts per episode in [`Clips::Paper`].
const PAPER_STARTS: usize = 50;

/// Where a clip lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clip {
    /// Its episode.
    pub episode: usize,
    /// Its first row, counted from the start of the episode.
    pub start: usize,
}

/// All clips of a dataset, in the order of episodes and starts.
#[derive(Clone, Debug)]
pub(super) struct ClipIndex {
    clips: Clips,
    span: usize,
    /// For each episode that has clips: how many clips come before it, its number, and its rows.
    episodes: Vec<(usize, usize, usize)>,
    len: usize,
}

impl ClipIndex {
    /// Clips of `span` rows in episodes of these lengths, without those whose episode ends less than `reach` rows after
    /// their start.
    pub(super) fn new(lengths: impl Iterator<Item = usize>, span: usize, reach: usize, clips: Clips) -> Self {
        let reach = reach.max(span);
        let (mut episodes, mut len) = (Vec::new(), 0);
        for (episode, rows) in lengths.enumerate().filter(|&(_, rows)| rows >= reach) {
            episodes.push((len, episode, rows));
            len += match clips {
                Clips::Every => rows - reach + 1,
                // Starts grow with their number, so those that reach far enough come first.
                Clips::Paper => {
                    (0..PAPER_STARTS).filter(|&index| paper_start(index, rows - span) <= rows - reach).count()
                }
            };
        }
        Self { clips, span, episodes, len }
    }

    /// The number of clips.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Clip `index`, if there is one.
    pub(super) fn get(&self, index: usize) -> Option<Clip> {
        if index >= self.len {
            return None;
        }
        let at = self.episodes.partition_point(|&(before, ..)| before <= index) - 1;
        let (before, episode, rows) = self.episodes[at];
        let start = match self.clips {
            Clips::Every => index - before,
            Clips::Paper => paper_start(index - before, rows - self.span),
        };
        Some(Clip { episode, start })
    }
}

/// Element `index` of numpy's `linspace(0, last, 50, dtype=int)`, in the same floating-point operations.
fn paper_start(index: usize, last: usize) -> usize {
    let intervals = (PAPER_STARTS - 1) as f64;
    match index + 1 == PAPER_STARTS {
        true => last,
        false => (index as f64 * (last as f64 / intervals)).floor() as usize,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_start_that_fits_and_no_other() {
        let lengths = [3, 1, 4];
        let index = ClipIndex::new(lengths.into_iter(), 2, 0, Clips::Every);
        let clips: Vec<_> = (0..index.len()).map(|i| index.get(i).unwrap()).collect();
        let expected = [(0, 0), (0, 1), (2, 0), (2, 1), (2, 2)];
        assert_eq!(clips, expected.map(|(episode, start)| Clip { episode, start }));
        assert_eq!(index.get(5), None);
    }

    #[test]
    fn the_paper_takes_fifty_starts_of_any_episode() {
        let index = ClipIndex::new([101, 2].into_iter(), 2, 0, Clips::Paper);
        assert_eq!(index.len(), 100);
        assert_eq!(index.get(49), Some(Clip { episode: 0, start: 99 }));
        assert_eq!(index.get(1), Some(Clip { episode: 0, start: 2 }));
        assert_eq!(index.get(99), Some(Clip { episode: 1, start: 0 }));
    }

    #[test]
    fn clips_without_a_later_row_are_dropped() {
        let index = ClipIndex::new([4, 3].into_iter(), 2, 4, Clips::Every);
        assert_eq!((index.len(), index.get(0)), (1, Some(Clip { episode: 0, start: 0 })));
        let index = ClipIndex::new([101].into_iter(), 2, 3, Clips::Paper);
        assert_eq!(index.len(), 49);
    }
}
