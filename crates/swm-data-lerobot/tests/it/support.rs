//! What every format must stand, with the formats of these tests.

use std::ops::Range;
use std::path::Path;

use swm_core::{Batch, BoxError};
use swm_data::WriteMode;
pub(crate) use swm_data::testing::{
    assert_alike, assert_same, bits, episode, fail_before_the_first_episode, metadata, mutations, rounds,
    rows_of, schema,
};
use swm_data::testing::{contents_in, record_in};

use crate::registry;

pub(crate) fn record(path: &Path, mode: WriteMode, episodes: Range<usize>) -> Result<u64, BoxError> {
    record_in(registry(), path, mode, episodes)
}

pub(crate) fn contents(path: &Path) -> Vec<Batch> {
    contents_in(registry(), path)
}
