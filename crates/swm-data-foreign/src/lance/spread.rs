//! Values that an episode has once, as a row for each of its steps.

use std::sync::Arc;

use swm_core::{Dtype, SliceMut};
use swm_data::dataset::{Steps, copy_rows};
use swm_data::error::Result;

use crate::array::{Array, Scratch, Shared, values};

/// Rows of episodes, end to end.
#[derive(Debug)]
pub(super) struct Spread {
    values: Shared,
    /// Of each episode: the row that has its value; `None`: it is missing.
    rows: Arc<[Option<usize>]>,
    /// Of each episode: the row behind its last one.
    ends: Arc<[usize]>,
}

impl Spread {
    pub(super) fn of(values: Shared, rows: &Arc<[Option<usize>]>, ends: &Arc<[usize]>) -> Shared {
        Arc::new(Self { values, rows: rows.clone(), ends: ends.clone() })
    }
}

impl Array for Spread {
    fn dtype(&self) -> Dtype {
        self.values.dtype()
    }

    fn rows(&self) -> usize {
        self.ends.last().copied().unwrap_or(0)
    }

    fn shape(&self) -> &[usize] {
        self.values.shape()
    }

    fn read(&self, rows: Steps, mut out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        const ONE: Steps = Steps { first: 0, count: 1, stride: 1 };
        let mut last = None;
        for index in 0..rows.count {
            let row = rows.first + index * rows.stride;
            let episode = self.ends.partition_point(|&end| end <= row);
            let (mut here, rest) = out.split_at(self.dim());
            match self.rows.get(episode).copied().flatten() {
                None => here.fill_missing(),
                Some(at) => {
                    let value = match last.take() {
                        Some((there, value)) if there == at => value,
                        _ => values(self.values.as_ref(), Steps { first: at, ..ONE }, scratch)?,
                    };
                    copy_rows(value.as_slice(), self.dim(), ONE, here);
                    last = Some((at, value));
                }
            }
            out = rest;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use swm_core::Column;

    use super::*;
    use crate::array::Memory;

    #[test]
    fn each_step_has_the_value_of_its_episode() {
        let values_of = Memory::of(Column::I32(vec![70, 40]), &[]);
        let spread = Spread::of(values_of, &[Some(1), None, Some(0)].into(), &[3, 4, 6].into());
        let read = |first, count, stride| {
            values(spread.as_ref(), Steps { first, count, stride }, &mut Scratch::default()).unwrap()
        };
        assert_eq!(read(0, 6, 1), Column::I32(vec![40, 40, 40, -1, 70, 70]));
        assert_eq!(read(1, 2, 4), Column::I32(vec![40, 70]));
    }
}
