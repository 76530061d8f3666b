//! Whether the image of a goal is the recorded frame of its step, or rendered anew.

use serde::{Deserialize, Serialize};

use super::EvalOptions;
use crate::batch::{Dtype, Field, Value};
use crate::dataset::{Dataset, Metadata, read_step};
use crate::env::{GOAL_IMAGE, PIXELS};
use crate::error::BoxError;
use crate::world::World;

/// Where the images of goals came from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
#[non_exhaustive]
pub enum GoalImages {
    /// Recorded frames of the goals' steps.
    Recorded,
    /// The environment rendered them, from the recorded state.
    Rendered {
        /// Why the recorded frames do not show what this world would.
        reason: String,
    },
}

impl GoalImages {
    /// Those of an evaluation in `world` on rows of `source`; `None`: it has no images of goals.
    pub(super) fn of(world: &World, source: &dyn Dataset, options: &EvalOptions) -> Option<Self> {
        let is_goal = |field: &&Field| field.name == GOAL_IMAGE && field.dtype == Dtype::U8;
        let goal = world.spec().fields.iter().find(is_goal)?;
        let size = |shape: &[usize]| shape.iter().take(2).map(usize::to_string).collect::<Vec<_>>().join("x");
        let schema = source.schema();
        let frames = schema.index(PIXELS).map(|index| &schema.fields()[index]);
        let metadata = source.metadata().and_then(Metadata::of_known_env);
        let reason = match (frames, metadata) {
            (None, _) => "the dataset has no images".to_owned(),
            (Some(frames), _) if frames.dtype != Dtype::U8 || frames.shape.len() != 3 => {
                "the dataset's images are no frames [H, W, 3] of bytes".to_owned()
            }
            (Some(frames), _) if frames.shape != goal.shape => format!(
                "the dataset's images are {}, this world's are {}",
                size(&frames.shape),
                size(&goal.shape)
            ),
            (_, None) => "the dataset does not state the settings that it was recorded with".to_owned(),
            (_, Some(metadata)) if metadata.settings != world.options().env.settings => {
                "the dataset was recorded with other settings of the environment".to_owned()
            }
            (_, Some(metadata)) if metadata.renderer != world.renderer() => {
                "the dataset was recorded with another renderer".to_owned()
            }
            _ if !options.variation.is_empty() || !options.variation_values.is_empty() => {
                "factors are not those of the recorded episodes".to_owned()
            }
            _ => return Some(Self::Recorded),
        };
        Some(Self::Rendered { reason })
    }

    /// A sentence for people where they are rendered.
    pub fn note(&self) -> Option<String> {
        match self {
            Self::Recorded => None,
            Self::Rendered { reason } => {
                Some(format!("images of goals are rendered from the recorded states, as {reason}"))
            }
        }
    }
}

/// The frame of a recorded step.
pub(super) fn recorded_frame(
    source: &mut dyn Dataset,
    [episode, row]: [usize; 2],
) -> Result<Value, BoxError> {
    read_step(source, episode, row, &[PIXELS])?.remove(PIXELS).ok_or_else(|| "it has no images".into())
}
