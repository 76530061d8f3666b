//! Which rows of a table are an episode: by the number of the episode in each row, and by where rows are missing. Readers of Lance
//! tables share it.

use std::collections::BTreeSet;

use crate::error::{Result, unsupported};

/// Hands the integers of a column of all rows to a function, block by block. It may be called again.
pub type Blocks<'a> = &'a dyn Fn(&mut dyn FnMut(&[i64]) -> Result<()>) -> Result<()>;

/// The episodes of a table, in which they follow each other by their numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableEpisodes {
    /// Rows of each.
    pub lengths: Vec<usize>,
    /// Its number in the table; parts of one have the same.
    pub numbers: Vec<i64>,
}

impl TableEpisodes {
    /// Finds them by the column `episode`, whose values are `numbers`; `step` has the number of a row in its episode.
    ///
    /// # Errors
    ///
    /// Where numbers fall, or cannot be read.
    pub fn of([episode, step]: [&str; 2], numbers: Blocks<'_>) -> Result<Self> {
        let mut found = Self::default();
        numbers(&mut |block| {
            for &number in block {
                match (found.numbers.last(), found.lengths.last_mut()) {
                    (Some(&last), Some(length)) if last == number => *length += 1,
                    (Some(&last), _) if last > number => {
                        return Err(unsupported(format!(
                            "episode {number} follows episode {last}, and should be before it, as after updates of a table; write it sorted in \
                             Python, with lance.write_dataset(lance.dataset(OLD).to_table().sort_by([(\"{episode}\", \"ascending\"), \
                             (\"{step}\", \"ascending\")]), NEW)"
                        )));
                    }
                    _ => {
                        found.numbers.push(number);
                        found.lengths.push(1);
                    }
                }
            }
            Ok(())
        })?;
        Ok(found)
    }

    /// Divides episodes in front of these rows: what is missing there would be a transition that never was. A note says so.
    pub fn divide(&mut self, gaps: &[usize]) -> Option<String> {
        let whole = self.lengths.len();
        let mut gaps = gaps.iter().peekable();
        let (mut parts, mut part_numbers, mut first) = (Vec::new(), Vec::new(), 0);
        for (length, &number) in std::mem::take(&mut self.lengths).into_iter().zip(&self.numbers) {
            let end = first + length;
            while let Some(gap) = gaps.next_if(|&&gap| gap < end) {
                parts.push(gap - first);
                part_numbers.push(number);
                first = *gap;
            }
            parts.push(end - first);
            part_numbers.push(number);
            first = end;
        }
        let note = (parts.len() > whole).then(|| {
            format!(
                "rows are missing amid its {whole} episodes; what is before and behind is apart, so that they are {}",
                parts.len()
            )
        });
        (self.lengths, self.numbers) = (parts, part_numbers);
        note
    }
}

/// What the column with the number of each row in its episode shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StepNumbers {
    /// Whether it only counts the rows of each episode.
    pub is_index: bool,
    /// Rows of the table, none of them the first of an episode, in front of which some are missing: the number grows by more than
    /// elsewhere, or by more than 1 over deleted rows. Where nothing is counted, those behind deleted rows.
    pub gaps: Vec<usize>,
}

impl StepNumbers {
    /// Of episodes of these lengths. `behind` are the rows that follow deleted ones; `steps` is the column, where it has integers.
    ///
    /// # Errors
    ///
    /// Where it cannot be read.
    pub fn of(lengths: &[usize], mut behind: BTreeSet<usize>, steps: Option<Blocks<'_>>) -> Result<Self> {
        if let Some(steps) = steps {
            let (mut growth, mut is_index) = (Growth::of(lengths), true);
            let mut least = i64::MAX;
            let read = steps(&mut |block| {
                for &number in block {
                    let grown = growth.next(number);
                    is_index &= grown.map_or(number == 0, |grown| grown == 1);
                    least = least.min(grown.unwrap_or(i64::MAX));
                }
                Ok(())
            });
            match read {
                Err(error) if error.is_unsupported() => {}
                Err(error) => return Err(error),
                Ok(()) if is_index => return Ok(Self { is_index, gaps: Vec::new() }),
                Ok(()) if least > 0 => {
                    let (mut growth, mut row, mut gaps) = (Growth::of(lengths), 0, Vec::new());
                    steps(&mut |block| {
                        for &number in block {
                            let is_gap = |&grown: &i64| grown > least || grown > 1 && behind.contains(&row);
                            gaps.extend(growth.next(number).filter(is_gap).map(|_| row));
                            row += 1;
                        }
                        Ok(())
                    })?;
                    return Ok(Self { is_index, gaps });
                }
                Ok(()) => {}
            }
        }
        let mut first = 0;
        for length in lengths {
            behind.remove(&first);
            first += length;
        }
        Ok(Self { is_index: false, gaps: behind.into_iter().collect() })
    }
}

/// By how much a number grows from row to row of an episode.
struct Growth<'a> {
    lengths: std::slice::Iter<'a, usize>,
    /// Rows of the episode that are left, and the number of the last one.
    left: usize,
    last: i64,
}

impl<'a> Growth<'a> {
    fn of(lengths: &'a [usize]) -> Self {
        Self { lengths: lengths.iter(), left: 0, last: 0 }
    }

    /// `None` for the first row of an episode.
    fn next(&mut self, number: i64) -> Option<i64> {
        let last = std::mem::replace(&mut self.last, number);
        if self.left > 0 {
            self.left -= 1;
            return Some(number.saturating_sub(last));
        }
        self.left = self.lengths.next().map_or(0, |length| length - 1);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaps(lengths: &[usize], behind: &[usize], steps: &[i64]) -> StepNumbers {
        let blocks = |take: &mut dyn FnMut(&[i64]) -> Result<()>| steps.chunks(2).try_for_each(take);
        StepNumbers::of(lengths, behind.iter().copied().collect(), Some(&blocks)).unwrap()
    }

    #[test]
    fn episodes_are_runs_of_numbers_that_grow() {
        let of = |numbers: &[i64]| {
            TableEpisodes::of(["e", "s"], &|take| numbers.chunks(2).try_for_each(&mut *take))
        };
        let mut found = of(&[0, 0, 3, 3, 3, 7]).unwrap();
        assert_eq!((&found.lengths[..], &found.numbers[..]), (&[2, 3, 1][..], &[0, 3, 7][..]));
        assert_eq!(found.divide(&[]), None);
        assert!(found.divide(&[3]).unwrap().contains("amid its 3 episodes"));
        assert_eq!((&found.lengths[..], &found.numbers[..]), (&[2, 1, 2, 1][..], &[0, 3, 3, 7][..]));
        assert!(of(&[1, 0]).unwrap_err().to_string().contains("sort_by"));
    }

    #[test]
    fn gaps_are_where_numbers_jump_or_rows_are_deleted() {
        assert_eq!(gaps(&[2, 3], &[3], &[0, 1, 0, 1, 2]), StepNumbers { is_index: true, gaps: vec![] });
        assert_eq!(gaps(&[2, 3], &[], &[0, 1, 0, 1, 4]).gaps, [4]);
        // Every fifth frame was recorded; only over deleted rows it is a gap.
        assert!(gaps(&[3], &[], &[0, 5, 10]).gaps.is_empty());
        assert_eq!(gaps(&[3], &[2], &[0, 5, 10]).gaps, [2]);
        // What counts nothing.
        assert_eq!(gaps(&[3, 2], &[1, 3], &[7, 7, 7, 7, 7]), StepNumbers { is_index: false, gaps: vec![1] });
    }
}
