//! Agents that learn from a dataset instead of an environment: its columns as they see them, and its episodes in memory.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use swm_core::env::PIXELS;
use swm_core::moments::Moments;
use swm_core::{Batch, Dtype, Field, Metadata, Slice};
use swm_data::tools::sample_digest;
use swm_data::{Dataset, OpenOptions};

use super::agent::OnlineAgent;
use super::interface::{ACTION, GOAL_PREFIX, Goals, Interface, OBSERVED, REWARD};
use super::replay::Clips;
use crate::error::BaselineError;
use crate::train::Scale;

/// Actions beyond this are not within [-1, 1], as in the reference.
const MOST: f64 = 1.01;
/// Added to the std of a column, as in the reference.
const LEAST_STD: f64 = 1e-2;

/// The dataset that an agent learned from: part of its run's `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct LearnedData {
    /// The dataset.
    pub path: PathBuf,
    /// How it is opened, where it is of another program.
    #[serde(default, skip_serializing_if = "OpenOptions::is_default")]
    pub opening: OpenOptions,
    /// Its number of episodes.
    pub episodes: usize,
    /// Steps of all episodes.
    pub rows: usize,
    /// Environment steps per row; `None` where the environment is unknown, and in runs of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_skip: Option<u32>,
    /// [`sample_digest`] of the columns that it learns from; `None` in runs of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<String>,
}

impl LearnedData {
    /// A dataset of so many episodes and rows, of which nothing else is known.
    pub fn new(path: PathBuf, episodes: usize, rows: usize) -> Self {
        Self { path, opening: OpenOptions::default(), episodes, rows, frame_skip: None, sample: None }
    }

    pub(super) fn of(dataset: &dyn Dataset, interface: &Interface) -> Result<Self, BaselineError> {
        let episodes = dataset.num_episodes();
        let rows = (0..episodes).map(|episode| dataset.episode_len(episode)).sum();
        let frame_skip =
            dataset.metadata().and_then(Metadata::of_known_env).map(|recorded| recorded.frame_skip);
        let observed = interface.observed();
        let recorded = observed.iter().map(|name| name.strip_prefix(GOAL_PREFIX).unwrap_or(name));
        let columns: Vec<&str> = recorded.chain([ACTION, REWARD]).collect();
        let sample = Some(sample_digest(dataset, &columns)?);
        let (path, opening) = (dataset.path().to_owned(), OpenOptions::of(dataset.info()));
        Ok(Self { path, opening, episodes, rows, frame_skip, sample })
    }
}

/// What an agent of this name sees of a dataset: `observe`, vectors and `pixels` of side `image`; no column: `observation`, `state`
/// or `proprio`, whichever is there, and its goal. Vectors are standardized by all rows; a goal is what its episode reached.
///
/// # Errors
///
/// [`BaselineError::Columns`]: a column is missing or of another form, no reward is finite, or actions are not within [-1, 1].
pub(super) fn interface(
    dataset: &dyn Dataset,
    agent: &str,
    observe: &[String],
    image: Option<usize>,
) -> Result<Interface, BaselineError> {
    let columns = columns(dataset, agent, observe, image)?;
    let refuse = |reason: String| Err(columns_error(dataset, agent, reason));
    let schema = dataset.schema();
    let dim_of = |name: &str| schema.index(name).map_or(0, |index| schema.fields()[index].dim());
    let recorded = |name: &String| dim_of(name.strip_prefix(GOAL_PREFIX).unwrap_or(name));
    let (observation_dim, actions) = (columns.iter().map(recorded).sum(), dim_of(ACTION));
    let (low, high) = (vec![-1.0; actions], vec![1.0; actions]);
    let mut interface = Interface { columns, observation_dim, image, scale: None, low, high };

    let mut found = Found { vectors: vec![Moments::default(); observation_dim], rewards: 0, most: 0.0 };
    each_episode(dataset, |rows| found.take(&interface, rows))?;
    if found.rewards == 0 {
        return refuse(format!("no row of its column `{REWARD}` is finite; record it with `swm collect`"));
    }
    if found.most > MOST {
        return refuse(format!(
            "its actions reach {:.3}, and it learns actions within [-1, 1]; scale them to that, in the environment, too",
            found.most
        ));
    }
    interface.scale = (observation_dim > 0).then(|| found.scale());
    Ok(interface)
}

/// The vectors that are observed, after checking all columns.
fn columns(
    dataset: &dyn Dataset,
    agent: &str,
    observe: &[String],
    image: Option<usize>,
) -> Result<Vec<String>, BaselineError> {
    let refuse = |reason: String| Err(columns_error(dataset, agent, reason));
    let fields = dataset.schema().fields();
    let field = |name: &str| fields.iter().find(|field| field.name == name);
    let is_vector = |field: &&Field| {
        field.shape.len() < 2 && !matches!(field.dtype, Dtype::Bool | Dtype::Str | Dtype::U8)
    };
    let known: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
    for needed in [ACTION, REWARD] {
        if field(needed).is_none() {
            let known = known.join("`, `");
            return refuse(format!(
                "it has no column `{needed}`, only `{known}`; record it with `swm collect`"
            ));
        }
    }
    if let Some(side) = image {
        match field(PIXELS).map(|field| &field.shape[..]) {
            Some(&[height, width, 3]) if [height, width] == [side; 2] => {}
            Some(shape) => {
                let fix = match shape {
                    [height, width, 3] if height == width => {
                        format!("learn from them with the setting image.size={height}, or ")
                    }
                    _ => String::new(),
                };
                return refuse(format!(
                    "its images are {shape:?}, and the agent's [{side}, {side}, 3]; {fix}record them at \
                     {side}x{side}"
                ));
            }
            None => {
                return refuse(format!(
                    "it has no column `{PIXELS}`; record it with images of {side}x{side}"
                ));
            }
        }
    }
    if observe.is_empty() {
        let Some(name) = OBSERVED.iter().find(|name| field(name).as_ref().is_some_and(is_vector)) else {
            return refuse(format!("it has none of `{}`; name columns as `observe`", OBSERVED.join("`, `")));
        };
        let goal = format!("{GOAL_PREFIX}{name}");
        let goal = field(&goal).is_some().then_some(goal);
        return Ok(std::iter::once((*name).to_owned()).chain(goal).collect());
    }
    let vectors: Vec<String> = observe.iter().filter(|name| *name != PIXELS).cloned().collect();
    let is_there = |name: &&String| {
        let of = name.strip_prefix(GOAL_PREFIX).unwrap_or(name);
        field(of).as_ref().is_some_and(is_vector)
    };
    match vectors.iter().find(|name| !is_there(name)) {
        Some(name) => refuse(format!("it has no vector `{name}`, only `{}`", known.join("`, `"))),
        None => Ok(vectors),
    }
}

/// Refuses a dataset whose episodes are all shorter than a clip.
pub(super) fn check_length(dataset: &dyn Dataset, agent: &dyn OnlineAgent) -> Result<(), BaselineError> {
    let lengths = (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode));
    let (longest, steps) = (lengths.max().unwrap_or(0), agent.clip_steps());
    if longest < steps {
        let reason =
            format!("a clip has {steps} steps, and the longest episode {longest}; record longer ones");
        return Err(columns_error(dataset, &agent.config().agent, reason));
    }
    Ok(())
}

/// The clips of all episodes, in memory.
pub(super) fn read(
    dataset: &dyn Dataset,
    interface: &Interface,
    agent: &dyn OnlineAgent,
) -> Result<Clips, BaselineError> {
    let rows: usize = (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode)).sum();
    let mut clips = Clips::new(interface, agent, rows)?;
    each_episode(dataset, |rows| clips.push(&interface.transitions(rows, Goals::Reached)?))?;
    Ok(clips)
}

/// Calls `look` with the rows of each episode.
fn each_episode(
    dataset: &dyn Dataset,
    mut look: impl FnMut(&Batch) -> Result<(), BaselineError>,
) -> Result<(), BaselineError> {
    let mut dataset = dataset.share();
    let mut rows = Batch::new(dataset.schema().clone(), 0);
    for episode in 0..dataset.num_episodes() {
        dataset.read(episode, 0..dataset.episode_len(episode), &mut rows)?;
        look(&rows)?;
    }
    Ok(())
}

/// What the rows of a dataset say.
struct Found {
    /// Of each value of the vectors.
    vectors: Vec<Moments>,
    /// Rewards that are finite.
    rewards: u64,
    /// The greatest action.
    most: f64,
}

impl Found {
    fn take(&mut self, interface: &Interface, rows: &Batch) -> Result<(), BaselineError> {
        let values = |name: &str| -> Vec<f64> {
            let column = rows.schema().index(name).map(|index| rows.column(index));
            let value = |column: Slice<'_>, at| column.as_f64(at).filter(|value| value.is_finite());
            column.map_or(Vec::new(), |column| (0..column.len()).filter_map(|at| value(column, at)).collect())
        };
        self.rewards += values(REWARD).len() as u64;
        self.most = values(ACTION).into_iter().fold(self.most, |most, value| most.max(value.abs()));
        let (mut vectors, reached) = (Vec::new(), Goals::Reached.reached(rows));
        for row in 0..rows.rows() {
            vectors.clear();
            interface.vectors(rows.row(row), reached, &mut vectors)?;
            if vectors.iter().all(|value| value.is_finite()) {
                for (moments, value) in self.vectors.iter_mut().zip(&vectors) {
                    moments.add(f64::from(*value));
                }
            }
        }
        Ok(())
    }

    fn scale(&self) -> Scale {
        let mean = self.vectors.iter().map(Moments::mean).collect();
        let std = self.vectors.iter().map(|moments| moments.std() + LEAST_STD).collect();
        Scale { mean, std }
    }
}

fn columns_error(dataset: &dyn Dataset, agent: &str, reason: String) -> BaselineError {
    BaselineError::Columns { path: dataset.path().to_owned(), baseline: agent.to_owned(), reason }
}
