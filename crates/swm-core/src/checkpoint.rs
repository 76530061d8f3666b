//! Saved states among the rows of a dataset, so that images can be rendered from any row on without having been recorded.
//!
//! The state saved at row `r`, a multiple of `every`, is cut into `every` pieces, and row `r + i` holds piece `i` in the
//! column `checkpoint`. So the column is narrow, every row of it is used, and any format can hold it. The pieces
//! together are the length of the state (u32, little-endian), the state, and zeros.

use crate::batch::{Dtype, Field, Schema};
use crate::env::EnvState;

/// The column of the pieces.
pub const CHECKPOINT: &str = "checkpoint";
/// Bytes of the length.
const LENGTH: usize = 4;

/// How saved states lie in the column `checkpoint`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checkpoints {
    /// Rows from one to the next, at least 1.
    every: usize,
    /// Bytes per row.
    piece: usize,
}

impl Checkpoints {
    /// One every `every` rows (at least 1), with room for states somewhat larger than `state` bytes: lengths vary by a
    /// few bytes within and between episodes.
    pub fn for_states_of(state: usize, every: usize) -> Self {
        let every = every.max(1);
        Self { every, piece: (LENGTH + state + state / 8 + 64).div_ceil(every) }
    }

    /// Those of a dataset that saved a state every `every` rows; `None` if it has none.
    pub fn of(schema: &Schema, every: Option<u32>) -> Option<Self> {
        let field = &schema.fields()[schema.index(CHECKPOINT)?];
        let (&[piece], Dtype::U8) = (&field.shape[..], field.dtype) else { return None };
        let every = usize::try_from(every?).ok()?;
        (every > 0 && piece > 0).then_some(Self { every, piece })
    }

    /// The column.
    pub fn field(&self) -> Field {
        Field::step(CHECKPOINT, Dtype::U8, &[self.piece])
    }

    /// Rows from one checkpoint to the next.
    pub fn every(&self) -> usize {
        self.every
    }

    /// Whether a state is saved at this row.
    pub fn is_at(&self, row: u64) -> bool {
        row.is_multiple_of(self.every as u64)
    }

    /// The last row up to `row` whose state is whole in an episode of `len` rows.
    pub fn before(&self, row: usize, len: usize) -> Option<usize> {
        let at = row - row % self.every;
        if at + self.every <= len { Some(at) } else { at.checked_sub(self.every) }
    }

    /// Writes into `out`, the value of `row`, its piece of `state`, which was saved at the checkpoint before. A state
    /// that is too large leaves zeros: then there is no checkpoint.
    pub fn write(&self, state: &EnvState, row: u64, out: &mut [u8]) {
        out.fill(0);
        let bytes = state.bytes();
        let length = match u32::try_from(bytes.len()) {
            Ok(length) if LENGTH + bytes.len() <= self.every * self.piece => length.to_le_bytes(),
            _ => return,
        };
        let first = (row % self.every as u64) as usize * self.piece;
        for (at, value) in (first..).zip(out) {
            let stored = if at < LENGTH { length.get(at) } else { bytes.get(at - LENGTH) };
            *value = stored.copied().unwrap_or(0);
        }
    }

    /// The state in the pieces of `every` rows, end to end; `None` if there is none.
    pub fn read<'a>(&self, pieces: &'a [u8]) -> Option<&'a [u8]> {
        let (length, rest) = pieces.split_first_chunk::<LENGTH>()?;
        let length = u32::from_le_bytes(*length) as usize;
        rest.get(..length).filter(|state| !state.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_make_the_state_again() {
        let state = EnvState::from_bytes((1..=100).collect());
        for every in [1, 3, 16, 200] {
            let checkpoints = Checkpoints::for_states_of(90, every);
            let mut pieces = vec![9; every * checkpoints.piece];
            for (row, piece) in pieces.chunks_mut(checkpoints.piece).enumerate() {
                checkpoints.write(&state, (row + 5 * every) as u64, piece);
            }
            assert_eq!(checkpoints.read(&pieces), Some(state.bytes()));
            let large = EnvState::from_bytes(vec![1; every * checkpoints.piece]);
            pieces.chunks_mut(checkpoints.piece).for_each(|piece| checkpoints.write(&large, 0, piece));
            assert_eq!(checkpoints.read(&pieces), None);
        }
        assert_eq!(Checkpoints::for_states_of(0, 1).read(&[200, 0, 0, 0, 1]), None);
    }

    #[test]
    fn only_whole_checkpoints_count() {
        let checkpoints = Checkpoints::for_states_of(10, 4);
        assert_eq!(checkpoints.before(5, 8), Some(4));
        assert_eq!(checkpoints.before(5, 7), Some(0));
        assert_eq!(checkpoints.before(2, 3), None);
    }
}
