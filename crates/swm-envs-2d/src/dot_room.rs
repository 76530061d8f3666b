//! What the environments have in common whose agent walks to a target in a square room that is seen from above: description,
//! positions, saved states, targets that are far enough, images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, EnvError, EnvSpec, EnvState, Episode, EpisodeSeed, Field, ImageSize, RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, SavedFov};

use crate::artist::{Artist, Scenery, Sprite};
use crate::settings::Render;

// Field indices, in the order of `spec`.
pub(crate) const OBSERVATION: usize = 0;
pub(crate) const STATE: usize = 1;
pub(crate) const PROPRIO: usize = 2;
pub(crate) const DISTANCE: usize = 3;
pub(crate) const GOAL_STATE: usize = 4;
pub(crate) const FACTORS: usize = 5;

/// The factor that places the target, and the one that asks for a far one.
const TARGET: &str = "target.position";
const LEAST: &str = "task.min_steps";
/// Samples of a target that is far enough, before the farthest of them is taken.
const MAX_TARGETS: usize = 1000;

/// The description of an environment whose observation has `observation_dim` values, and whose actions have two within
/// `bound`.
pub(crate) fn spec(
    id: &str,
    observation_dim: usize,
    bound: f64,
    image: Option<ImageSize>,
    space: &FovSpace,
) -> EnvSpec {
    let mut fields = vec![
        Field::step("observation", Dtype::F32, &[observation_dim]),
        Field::step("state", Dtype::F32, &[2]),
        Field::step("proprio", Dtype::F32, &[2]),
        Field::step("distance_to_target", Dtype::F64, &[]),
        Field::episode("goal_state", Dtype::F32, &[2]),
    ];
    fields.extend(space.fields());
    fields.extend(image.into_iter().flat_map(ImageSize::fields_with_goal));
    EnvSpec::new(id, Space::uniform_box(Dtype::F32, &[2], -bound, bound), fields)
        .factors(space.specs())
        .time_step_s(0.1)
        .start_columns(&["state", "proprio"])
        .goal_columns(&["state", "proprio"])
}

/// Why a reset of the environment `id` is refused.
pub(crate) fn reset_error(id: &str, reason: impl Into<String>) -> EnvError {
    EnvError::Reset { env: id.to_owned(), reason: reason.into() }
}

/// The position of a recorded row, if there is one: `[x, y]` in a room of this side.
pub(crate) fn recorded(
    id: &str,
    side: f32,
    row: &Option<BTreeMap<String, Value>>,
) -> Result<Option<[f32; 2]>, EnvError> {
    let Some(row) = row else { return Ok(None) };
    let column = ["state", "proprio"].into_iter().find(|column| row.contains_key(*column));
    let column =
        column.ok_or_else(|| reset_error(id, "start and goal need the column `state` or `proprio`"))?;
    let value = row[column].cast(column, Dtype::F32, &[2])?;
    let Slice::F32(&[x, y]) = value.data.as_slice() else { unreachable!("cast to two f32") };
    check_position([x, y], side).map_err(|reason| reset_error(id, format!("`{column}`: {reason}")))?;
    Ok(Some([x, y]))
}

/// The values of an action, if they are two and finite.
pub(crate) fn finite_action(id: &str, action: Slice<'_>) -> Result<[f32; 2], EnvError> {
    match action {
        Slice::F32(&[x, y]) if x.is_finite() && y.is_finite() => Ok([x, y]),
        _ => Err(EnvError::Diverged { env: id.to_owned(), reason: format!("{action:?} is no action") }),
    }
}

/// Refuses positions that are not in the room.
fn check_position(position: [f32; 2], side: f32) -> Result<(), String> {
    let is_inside = position.iter().all(|c| (0.0..=side).contains(c));
    if is_inside { Ok(()) } else { Err(format!("the position {position:?} is not between 0 and {side}")) }
}

/// A saved state.
#[derive(Serialize, Deserialize)]
pub(crate) struct Saved {
    pub(crate) fov: SavedFov,
    pub(crate) agent: [f32; 2],
    pub(crate) target: [f32; 2],
}

impl Saved {
    /// The state of the environment `id` that was stored, with its factors.
    pub(crate) fn load(
        id: &str,
        side: f32,
        space: &FovSpace,
        state: &EnvState,
    ) -> Result<(Self, Fov), EnvError> {
        let saved: Self = state.load(id)?;
        let foreign = |reason: String| EnvError::State { env: id.to_owned(), reason };
        for position in [saved.agent, saved.target] {
            check_position(position, side).map_err(foreign)?;
        }
        let fov = space.recall(&saved.fov).map_err(|error| foreign(error.to_string()))?;
        Ok((saved, fov))
    }
}

/// The target of an episode: that of the factor, unless `task.min_steps` asks for a farther one. `defaults` may ask for it,
/// too; `least_px` is what so many steps cover, `way_to` measures the way from the agent, px.
pub(crate) fn target(
    spec: &EnvSpec,
    fov: &Fov,
    defaults: &serde_json::Map<String, serde_json::Value>,
    episode: &Episode<'_>,
    least_px: impl FnOnce(i64) -> f64,
    way_to: impl Fn([f32; 2]) -> f64,
) -> [f32; 2] {
    let target: [f32; 2] = fov.vector(TARGET);
    let is_asked = fov.touched(LEAST) || defaults.contains_key(LEAST);
    if !is_asked || episode.options.variation_values.contains_key(TARGET) {
        return target;
    }
    far_target(spec, target, least_px(fov.i64(LEAST)), episode.seed, way_to)
}

/// `target`, or the first of many samples that is at least `least_px` away, or the farthest of them all.
fn far_target(
    spec: &EnvSpec,
    target: [f32; 2],
    least_px: f64,
    seed: EpisodeSeed,
    way_to: impl Fn([f32; 2]) -> f64,
) -> [f32; 2] {
    let factor = spec.factors.iter().find(|factor| factor.name == TARGET);
    let space = &factor.expect("a factor of the table").space;
    let mut stream = seed.stream("goal_state target.position");
    let (mut farthest, mut way_px) = (target, way_to(target));
    for _ in 0..MAX_TARGETS {
        if way_px >= least_px {
            break;
        }
        let sampled = space.sample(&mut stream);
        let Slice::F32(&[x, y]) = sampled.data.as_slice() else { unreachable!("a box of two f32") };
        let length = way_to([x, y]);
        if length > way_px {
            (farthest, way_px) = ([x, y], length);
        }
    }
    farthest
}

/// What rendering needs.
pub(crate) struct Image<L, S> {
    artist: Artist<L>,
    /// The agent of the episode; `None` before the first.
    agent: Option<S>,
    goal: Vec<u8>,
    /// The goal image belongs to an earlier episode.
    goal_is_stale: bool,
}

impl<L: Scenery, S: Sprite> Image<L, S> {
    pub(crate) fn new(size: ImageSize, style: Render) -> Result<Self, String> {
        let artist = Artist::new(size, style).map_err(|error| error.to_string())?;
        let bytes = size.shape().iter().product();
        Ok(Self { artist, agent: None, goal: vec![0; bytes], goal_is_stale: true })
    }

    /// Takes the look of an episode, or of another state of one.
    pub(crate) fn set_look(&mut self, id: &str, agent: S, look: L) -> Result<(), EnvError> {
        self.agent = Some(agent);
        self.goal_is_stale = true;
        self.artist.set_look(look).map_err(|error| reset_error(id, error.to_string()))
    }

    /// Renders the agent at a position.
    pub(crate) fn render(&mut self, agent: [f32; 2], out: &mut [u8]) {
        let agent = self.agent.expect("environments set the look when they are made").at(agent);
        let rendered = self.artist.render(&agent, out);
        rendered.expect("the pixel field has the artist's size");
    }

    /// Writes the image of the agent at the target into the last field.
    pub(crate) fn write_goal(&mut self, target: [f32; 2], spec: &EnvSpec, out: &mut RowsMut<'_>) {
        if self.goal_is_stale {
            let mut goal = std::mem::take(&mut self.goal);
            self.render(target, &mut goal);
            (self.goal, self.goal_is_stale) = (goal, false);
        }
        out.write(spec.fields.len() - 1, &self.goal);
    }
}
