//! What is read for a clip: for every column of a batch, which rows of which column of the dataset, and what is done to
//! its images. Made once per loader, shared by all threads.

use std::sync::Arc;

use swm_core::env::PIXELS;
use swm_core::{Dtype, Field, Schema};

use super::clips::ClipIndex;
use super::goals::Goals;
use super::images::Convert;
use super::options::{ClipOptions, Images, Rewards};
use super::wrong;
use crate::dataset::Dataset;
use crate::error::DataError;
use crate::foreign::RewardsAt;

/// The column that stays dense under a frame skip.
const ACTION: &str = "action";
/// The column that [`Rewards`] is about.
const REWARD: &str = "reward";
/// What stands before the name of a goal's column.
const GOAL_PREFIX: &str = "goal_";

/// What every thread knows.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) schema: Arc<Schema>,
    pub(super) windows: Vec<Window>,
    pub(super) index: ClipIndex,
    pub(super) goals: Option<Goals>,
}

/// One column of a clip: what is read for it.
#[derive(Debug)]
pub(super) struct Window {
    /// Position in the dataset.
    pub(super) column: usize,
    /// The rows.
    pub(super) rows: Rows,
    /// What is done to its images.
    pub(super) convert: Option<Convert>,
    /// Values of a stored row.
    pub(super) dim: usize,
    /// Whether they are f64, and whether these become f32.
    pub(super) stores_f64: bool,
    pub(super) narrows: bool,
}

/// Which rows a window takes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Rows {
    /// From the start of the clip on.
    Clip { count: usize, stride: usize },
    /// The goal's.
    Goal,
    /// Those of the rewards of a clip's actions, which begin `after` rows after its first, summed over `skip` of them.
    Rewards { steps: usize, skip: usize, after: usize },
}

impl Plan {
    /// Checks the options against the dataset.
    pub(super) fn new(dataset: &dyn Dataset, options: &ClipOptions) -> Result<Self, DataError> {
        let (steps, skip) = (options.num_steps, options.frameskip);
        if steps == 0 {
            return wrong("num_steps", "0 rows; use 1 or more");
        }
        if skip == 0 {
            return wrong("frameskip", "0; use 1 for every row");
        }
        let Some(span) = steps.checked_mul(skip) else {
            return wrong("num_steps", format!("{steps} × frameskip {skip} rows are too many"));
        };
        let lengths = || (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode));
        let goals = options.goals.as_ref();
        let goals = goals.map(|goals| Goals::new(goals, steps, skip, lengths())).transpose()?;

        let stored = dataset.schema().fields();
        let goal_columns = goal_columns(dataset, options)?;
        let goal_name = |column: usize| format!("{GOAL_PREFIX}{}", stored[column].name);
        let relabeled: Vec<String> = goal_columns.iter().map(|&column| goal_name(column)).collect();
        let (mut windows, mut fields) = (Vec::new(), Vec::new());
        for column in chosen(dataset, options.keys.as_deref())? {
            let stored = &stored[column];
            if relabeled.contains(&stored.name) {
                continue;
            }
            let dense = stored.name == ACTION;
            let (mut shape, convert) = if dense {
                let Some(width) = skip.checked_mul(stored.dim()) else {
                    return wrong("frameskip", format!("{skip} actions per row are too many"));
                };
                (vec![width], None)
            } else {
                images(stored, options)?
            };
            shape.insert(0, steps);
            let stores_f64 = stored.dtype == Dtype::F64;
            let narrows = options.float32 && stores_f64;
            let rows = if stored.name == REWARD && options.rewards == Rewards::OfActions {
                if !matches!(stored.dtype, Dtype::F32 | Dtype::F64) {
                    let kind = stored.dtype;
                    return wrong("rewards", format!("column `{REWARD}` is {kind}; sums are of f32 and f64"));
                }
                Rows::Rewards { steps, skip, after: rewards_after(dataset)? }
            } else if dense {
                Rows::Clip { count: span, stride: 1 }
            } else {
                Rows::Clip { count: steps, stride: skip }
            };
            fields.push(given(stored, stored.name.clone(), shape, narrows));
            windows.push(Window { column, rows, convert, dim: stored.dim(), stores_f64, narrows });
        }
        for (column, name) in goal_columns.into_iter().zip(relabeled) {
            let stored = &stored[column];
            let (mut shape, convert) = images(stored, options)?;
            shape.insert(0, 1);
            let stores_f64 = stored.dtype == Dtype::F64;
            let narrows = options.float32 && stores_f64;
            fields.push(given(stored, name, shape, narrows));
            windows.push(Window {
                column,
                rows: Rows::Goal,
                convert,
                dim: stored.dim(),
                stores_f64,
                narrows,
            });
        }
        let schema = Schema::new(fields)
            .map_err(|error| DataError::Loader { setting: "keys", reason: error.to_string() })?;

        let reach = goals.as_ref().map_or(0, Goals::reach);
        let index = ClipIndex::new(lengths(), span, reach, options.clips);
        if index.len() == 0 {
            let longest = lengths().max().unwrap_or(0);
            let and_goal = if reach > span { format!(", with its goal {reach}") } else { String::new() };
            let reason = format!(
                "a clip spans {span} rows ({steps} × frameskip {skip}){and_goal}, the longest episode has {longest}"
            );
            return wrong("num_steps", reason);
        }
        Ok(Self { schema, windows, index, goals })
    }
}

/// The field of a batch that a stored one becomes.
/// Rows from an action to its reward.
fn rewards_after(dataset: &dyn Dataset) -> Result<usize, DataError> {
    let places = || dataset.info().runs.iter().map(|(_, run)| RewardsAt::of(run));
    match places().filter(|&at| at == RewardsAt::Actions).count() {
        0 => Ok(1),
        count if count == places().count() => Ok(0),
        _ => wrong(
            "rewards",
            "some runs of the dataset have rewards beside their actions, others in the row after; load them apart",
        ),
    }
}

fn given(stored: &Field, name: String, shape: Vec<usize>, narrows: bool) -> Field {
    let dtype = if narrows { Dtype::F32 } else { stored.dtype };
    Field { name, shape, dtype, ..stored.clone() }
}

/// The shape of a column's rows in a batch, and what has to be done for it.
fn images(stored: &Field, options: &ClipOptions) -> Result<(Vec<usize>, Option<Convert>), DataError> {
    let ([height, width, channels], Dtype::U8) = (&stored.shape[..], stored.dtype) else {
        return Ok((stored.shape.clone(), None));
    };
    let convert = Convert {
        stored: [*height, *width],
        channels: *channels,
        wanted: options.image.map_or([*height, *width], |size| [size.height, size.width]),
        channels_first: options.images == Images::ChannelsFirst,
    };
    convert.check(&stored.name)?;
    Ok((convert.shape(), convert.is_needed().then_some(convert)))
}

/// Positions of the wanted columns.
fn chosen(dataset: &dyn Dataset, keys: Option<&[String]>) -> Result<Vec<usize>, DataError> {
    let schema = dataset.schema();
    match keys {
        None | Some([]) => Ok((0..schema.fields().len()).collect()),
        Some(keys) => keys.iter().map(|key| position(schema, "keys", key)).collect(),
    }
}

/// Positions of the columns of which a goal is wanted.
fn goal_columns(dataset: &dyn Dataset, options: &ClipOptions) -> Result<Vec<usize>, DataError> {
    let schema = dataset.schema();
    match &options.goals {
        None => Ok(Vec::new()),
        Some(goals) => match &goals.keys {
            Some(keys) => keys.iter().map(|key| position(schema, "goals.keys", key)).collect(),
            None => Ok([PIXELS, "proprio"].iter().filter_map(|key| schema.index(key)).collect()),
        },
    }
}

fn position(schema: &Schema, setting: &'static str, key: &str) -> Result<usize, DataError> {
    schema.require(key).map_err(|error| DataError::Loader { setting, reason: error.to_string() })
}
