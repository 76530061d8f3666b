//! One of several equal parts of a request's work.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use swm_core::RecordingPart;
use swm_data::tools::parts;

use crate::error::{TaskError, wrong};

/// One of several equal parts, written `3/16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Shard {
    index: u64,
    count: u64,
}

impl Shard {
    /// Part `index`, counted from 1, of `count`; `None`: there is no such part.
    pub fn new(index: u64, count: u64) -> Option<Self> {
        (1..=count).contains(&index).then_some(Self { index, count })
    }

    /// The part of `0..total` that it is.
    pub fn of(self, total: u64) -> Range<u64> {
        parts::range(self.index, self.count, total)
    }

    /// Its number, counted from 1, and the number of parts.
    pub fn numbers(self) -> (u64, u64) {
        (self.index, self.count)
    }

    /// The record of the part of a recording of `total` episodes. The only part is the whole, and has none.
    pub fn part(self, total: u64) -> Option<RecordingPart> {
        let range = self.of(total);
        let part =
            RecordingPart { shard: self.index, of: self.count, first: range.start, end: range.end, total };
        (self.count > 1).then_some(part)
    }
}

impl FromStr for Shard {
    type Err = TaskError;

    fn from_str(text: &str) -> Result<Self, TaskError> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let shard = parts.and_then(|(index, count)| Self::new(index, count));
        shard.ok_or_else(|| wrong("must be part I of N parts, I/N with I of 1..=N, such as 3/16"))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.to_string()
    }
}

impl TryFrom<String> for Shard {
    type Error = TaskError;

    fn try_from(text: String) -> Result<Self, TaskError> {
        text.parse()
    }
}
