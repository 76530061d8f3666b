//! What the environments have in common whose agent walks to a target in a square room that is seen from above: description,
//! positions, saved states, targets that are far enough, images.

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, EnvSpec, Episode, EpisodeSeed, Field, ImageSize, Slice, Space};
use swm_fov::{Fov, SceneError};

use crate::artist::{Artist, Scenery, Sprite};
use crate::settings::Render;

// Field indices, in the order of `spec`.
pub(crate) const OBSERVATION: usize = 0;
pub(crate) const STATE: usize = 1;
pub(crate) const PROPRIO: usize = 2;
pub(crate) const DISTANCE: usize = 3;
pub(crate) const GOAL_STATE: usize = 4;

/// The factor that places the target, and the one that asks for a far one.
const TARGET: &str = "target.position";
pub(crate) const LEAST: &str = "task.min_steps";
/// Samples of a target that is far enough, before the farthest of them is taken.
const MAX_TARGETS: usize = 1000;

/// The description of an environment whose observation has `observation_dim` values, and whose actions have two within
/// `bound`.
pub(crate) fn spec(id: &str, observation_dim: usize, bound: f64) -> EnvSpec {
    let fields = vec![
        Field::step("observation", Dtype::F32, &[observation_dim]),
        Field::step("state", Dtype::F32, &[2]),
        Field::step("proprio", Dtype::F32, &[2]),
        Field::step("distance_to_target", Dtype::F64, &[]),
        Field::episode("goal_state", Dtype::F32, &[2]),
    ];
    EnvSpec::new(id, Space::uniform_box(Dtype::F32, &[2], -bound, bound), fields)
        .time_step_s(0.1)
        .start_columns(&["state", "proprio"])
        .goal_columns(&["state", "proprio"])
}

/// The positions of the recorded start and goal, where there are any: `[x, y]` in a room of this side.
pub(crate) fn recorded(side: f32, episode: &Episode<'_>) -> Result<[Option<[f32; 2]>; 2], SceneError> {
    let mut positions = [None; 2];
    for (position, row) in positions.iter_mut().zip([&episode.options.start, &episode.options.goal]) {
        let Some(row) = row else { continue };
        let column = ["state", "proprio"].into_iter().find(|column| row.contains_key(*column));
        let column = column.ok_or("start and goal need the column `state` or `proprio`")?;
        let value = row[column].cast(column, Dtype::F32, &[2])?;
        let Slice::F32(&[x, y]) = value.data.as_slice() else { unreachable!("cast to two f32") };
        check_position([x, y], side).map_err(|reason| format!("`{column}`: {reason}"))?;
        *position = Some([x, y]);
    }
    Ok(positions)
}

/// The values of an action, if they are two and finite.
pub(crate) fn finite_action(action: Slice<'_>) -> Result<[f32; 2], SceneError> {
    match action {
        Slice::F32(&[x, y]) if x.is_finite() && y.is_finite() => Ok([x, y]),
        _ => Err(format!("{action:?} is no action").into()),
    }
}

/// Refuses positions that are not in the room.
fn check_position(position: [f32; 2], side: f32) -> Result<(), String> {
    let is_inside = position.iter().all(|c| (0.0..=side).contains(c));
    if is_inside { Ok(()) } else { Err(format!("the position {position:?} is not between 0 and {side}")) }
}

/// Where agent and target are.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Dots {
    pub(crate) agent: [f32; 2],
    pub(crate) target: [f32; 2],
}

impl Dots {
    /// Refuses positions that are not in a room of this side.
    pub(crate) fn check(&self, side: f32) -> Result<(), SceneError> {
        check_position(self.agent, side)?;
        Ok(check_position(self.target, side)?)
    }
}

/// The target of an episode: that of the factor, unless `task.min_steps` asks for a farther one, as its default does
/// where `is_far`; `least_px` is what so many steps cover, `way_to` measures the way from the agent, px.
pub(crate) fn target(
    spec: &EnvSpec,
    fov: &Fov,
    is_far: bool,
    episode: &Episode<'_>,
    least_px: impl FnOnce(i64) -> f64,
    way_to: impl Fn([f32; 2]) -> f64,
) -> [f32; 2] {
    let target: [f32; 2] = fov.vector(TARGET);
    let is_asked = is_far || fov.touched(LEAST);
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

/// What renders images.
pub(crate) struct Canvas<L, S> {
    artist: Artist<L>,
    /// The agent of the episode; `None` before the first.
    agent: Option<S>,
}

impl<L: Scenery, S: Sprite> Canvas<L, S> {
    pub(crate) fn new(size: ImageSize, style: Render) -> Result<Self, SceneError> {
        let artist = Artist::new(size, style).map_err(|error| error.to_string())?;
        Ok(Self { artist, agent: None })
    }

    /// Takes the look of an episode, or of another state of one.
    pub(crate) fn set_look(&mut self, agent: S, look: L) -> Result<(), SceneError> {
        self.agent = Some(agent);
        Ok(self.artist.set_look(look).map_err(|error| error.to_string())?)
    }

    /// Renders the agent at a position.
    pub(crate) fn render(&mut self, agent: [f32; 2], out: &mut [u8]) {
        let agent = self.agent.expect("environments set the look when they are made").at(agent);
        let rendered = self.artist.render(&agent, out);
        rendered.expect("the pixel field has the artist's size");
    }
}
