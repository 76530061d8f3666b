//! A pair of recorded steps that a person chose as start and goal: `3:10-35`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::dataset::Dataset;
use crate::error::WorldError;

/// Two steps of a dataset, `[episode, step]` each, counted from 0. As text `EPISODE:START-GOAL`, or
/// `EPISODE:START-EPISODE:GOAL` for a goal in another episode.
/// ```
/// use swm_core::evaluate::ChosenPair;
///
/// let pair: ChosenPair = "3:10-35".parse()?;
/// assert_eq!((pair.start, pair.goal), ([3, 10], [3, 35]));
/// assert_eq!("3:10-4:0".parse::<ChosenPair>()?.goal, [4, 0]);
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ChosenPair {
    /// The start.
    pub start: [usize; 2],
    /// The goal.
    pub goal: [usize; 2],
}

impl ChosenPair {
    /// The goal is `offset` steps after the start.
    pub(super) fn ahead(start: [usize; 2], offset: usize) -> Self {
        Self { start, goal: [start[0], start[1] + offset] }
    }

    /// Refuses steps that the dataset does not hold, and a pair that is among those before it.
    pub(super) fn check(self, source: &dyn Dataset, before: &[Self]) -> Result<(), WorldError> {
        if before.contains(&self) {
            return Err(self.refuse("is given twice; leave one out"));
        }
        for [episode, step] in [self.start, self.goal] {
            let episodes = source.num_episodes();
            if episode >= episodes {
                return Err(self.refuse(&format!(
                    "names episode {episode}; the dataset holds {episodes}, counted from 0"
                )));
            }
            let length = source.episode_len(episode);
            if step >= length {
                return Err(self.refuse(&format!(
                    "names step {step} of episode {episode}, which holds {length}, counted from 0"
                )));
            }
        }
        Ok(())
    }

    pub(super) fn refuse(self, reason: &str) -> WorldError {
        WorldError::Option { option: "pairs", reason: format!("the pair {self} {reason}") }
    }
}

impl fmt::Display for ChosenPair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { start: [episode, start], goal: [goal_episode, goal] } = self;
        write!(f, "{episode}:{start}-")?;
        if goal_episode != episode {
            write!(f, "{goal_episode}:")?;
        }
        write!(f, "{goal}")
    }
}

impl From<ChosenPair> for String {
    fn from(pair: ChosenPair) -> Self {
        pair.to_string()
    }
}

impl TryFrom<String> for ChosenPair {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl FromStr for ChosenPair {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = || {
            let number = |text: &str| text.parse::<usize>().ok();
            let step = |text: &str| {
                let (episode, step) = text.split_once(':')?;
                Some([number(episode)?, number(step)?])
            };
            let (start, goal) = text.split_once('-')?;
            let start = step(start)?;
            let goal = if goal.contains(':') { step(goal)? } else { [start[0], number(goal)?] };
            Some(Self { start, goal })
        };
        parse().ok_or_else(|| {
            "write EPISODE:START-GOAL, such as 3:10-35, or 3:10-4:0 for a goal in another episode".to_owned()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_read_as_they_are_written() {
        for text in ["3:10-35", "0:0-0", "3:10-4:0"] {
            assert_eq!(text.parse::<ChosenPair>().unwrap().to_string(), text);
        }
        assert_eq!("3:10-3:35".parse::<ChosenPair>().unwrap().to_string(), "3:10-35");
        for wrong in ["", "3", "3:10", "10-35", "3:10-", "a:1-2", "3:10-35-40", "3:1-2:", "3:-1-2"] {
            assert!(wrong.parse::<ChosenPair>().unwrap_err().contains("EPISODE:START-GOAL"), "{wrong}");
        }
    }
}
