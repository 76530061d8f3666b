//! Randomness: every sample comes from a ChaCha stream keyed by what it is for, never by when or where it happens.
//!
//! A run has one seed. Episode `i` of the run has an [`EpisodeSeed`], a function of the two; it is recorded with
//! the data, so that an episode can be repeated from it alone. Within an episode each purpose (a factor, a
//! policy, a planner's sample) has a stream of its own, so that sampling more for one moves no other.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use serde::{Deserialize, Serialize};

/// The generator behind every stream: ChaCha with 8 rounds, the same on every machine.
pub type Stream = ChaCha8Rng;

/// The seed of one episode: a non-negative 63-bit number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct EpisodeSeed(u64);

impl EpisodeSeed {
    /// Takes the number as it is (its top bit is dropped, so that it fits signed columns).
    pub fn new(seed: u64) -> Self {
        Self(seed & (u64::MAX >> 1))
    }

    /// The seed of episode `episode` of a run with seed `run_seed`.
    pub fn of(run_seed: u64, episode: u64) -> Self {
        Self::new(keyed(run_seed, "episode", [episode, 0]).next_u64())
    }

    /// The number, as it stands in the column `seed`.
    pub fn value(self) -> i64 {
        self.0 as i64
    }

    /// The stream for `purpose`.
    pub fn stream(self, purpose: &str) -> Stream {
        self.indexed(purpose, [0, 0])
    }

    /// The stream for element `index` of `purpose`: a step, a plan and a sample.
    pub fn indexed(self, purpose: &str, index: [u64; 2]) -> Stream {
        keyed(self.0, purpose, index)
    }
}

/// The stream of `(seed, purpose, index)`. The four words are the ChaCha key, so distinct keys never collide
/// (`purpose` enters by its 64-bit FNV-1a hash).
pub fn keyed(seed: u64, purpose: &str, index: [u64; 2]) -> Stream {
    let mut key = [0; 32];
    for (bytes, word) in key.chunks_exact_mut(8).zip([seed, fnv1a(purpose), index[0], index[1]]) {
        bytes.copy_from_slice(&word.to_le_bytes());
    }
    Stream::from_seed(key)
}

/// FNV-1a, 64 bits: <https://datatracker.ietf.org/doc/html/draft-eastlake-fnv>.
const fn fnv1a(text: &str) -> u64 {
    let bytes = text.as_bytes();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0100_0000_01b3);
        i += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_every_part_of_their_key() {
        let first = |seed, purpose, index| keyed(seed, purpose, index).next_u64();
        let base = first(1, "a", [2, 3]);
        assert_eq!(base, first(1, "a", [2, 3]));
        for other in
            [first(2, "a", [2, 3]), first(1, "b", [2, 3]), first(1, "a", [0, 3]), first(1, "a", [2, 0])]
        {
            assert_ne!(base, other);
        }
    }

    #[test]
    fn episode_seeds_are_a_promise() {
        // Recorded datasets hold these numbers: a change here breaks their repetition.
        assert_eq!(EpisodeSeed::of(0, 0).value(), 303315818947060389);
        assert_eq!(EpisodeSeed::of(42, 7).value(), 1846930339032021911);
        assert!(EpisodeSeed::new(u64::MAX).value() >= 0);
    }
}
