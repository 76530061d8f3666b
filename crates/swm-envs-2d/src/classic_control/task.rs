//! What one environment of classic control brings along.

use serde::Serialize;
use serde::de::DeserializeOwned;
use swm_core::Space;
use swm_core::seed::Stream;
use swm_fov::{Factor, Fov, FovSpace};
use swm_render::{Painter, Rgb};

/// Dynamics, factors, rendering and expert of one environment, under the factors of an episode.
pub(super) trait Task: Send + Sync + Sized + 'static {
    /// The registered name.
    const ID: &'static str;
    /// What it is, in one line.
    const SUMMARY: &'static str;
    /// When it is solved, in a few words.
    const SUCCESS: &'static str;
    /// A planner on the true dynamics that solves it.
    const PLANNER: &'static str;
    /// Steps after which Gymnasium truncates an episode.
    const TIME_LIMIT: u64;
    /// Duration of a step, seconds.
    const TIME_STEP_S: f64;
    /// Dims of the observation.
    const OBSERVATION_DIM: usize;
    /// Dims of the state.
    const STATE_DIM: usize;
    /// Height and width of the surface that images are drawn on, pixels.
    const SURFACE: [usize; 2];
    /// The colors that it is drawn in, each with the factor that replaces it, in the order of the replacements.
    const COLORS: &'static [(Rgb, &'static str)];
    /// The simulator's state, `[STATE_DIM]`.
    type State: Copy + Send + Sync + AsRef<[f64]> + for<'a> TryFrom<&'a [f64]> + Serialize + DeserializeOwned;

    /// What one action may be.
    fn action_space() -> Space;

    /// The physical factors, in sampling order.
    fn physics() -> Vec<Factor>;

    /// The environment under an assignment of factors.
    fn new(fov: &Fov) -> Self;

    /// A state at the start of an episode.
    fn start(&self, stream: &mut Stream) -> Self::State;

    /// One step. `action` is the value of a continuous action or the index of a discrete one; `has_ended` says whether an
    /// earlier step terminated the episode.
    fn step(&self, state: &mut Self::State, action: f32, has_ended: bool) -> Step;

    /// Writes the observation, `[OBSERVATION_DIM]`.
    fn observe(&self, state: &Self::State, out: &mut [f32]);

    /// The state that an observation, `[OBSERVATION_DIM]`, was made of, as far as it tells.
    fn observed(&self, observation: &[f64]) -> Self::State;

    /// Whether the task is solved in a state after `steps` steps.
    fn is_success(&self, state: &Self::State, steps: u64) -> bool;

    /// How far a state is from success, for planners: lower is better.
    fn cost(&self, state: &Self::State) -> f64;

    /// The expert's action in a state.
    fn act(&self, state: &Self::State) -> f32;

    /// Draws what does not move.
    fn render_background(&self, painter: &mut dyn Painter);

    /// Draws what moves; `action` is the last one, 0 at the start of an episode.
    fn render(&self, state: &Self::State, action: f32, painter: &mut dyn Painter);

    /// Where the part that moves is in the image: its name, and surface coordinates with y up.
    fn place(&self, state: &Self::State) -> (&'static str, [f64; 2]);
}

/// What one step led to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// The reward.
    pub(super) reward: f64,
    /// The task ended the episode.
    pub(super) terminated: bool,
}

/// The factor table: physics, then colors.
pub(super) fn factors<T: Task>() -> FovSpace {
    let mut factors = T::physics();
    // In the order of their names, as the reference draws them.
    let mut colors: Vec<_> = T::COLORS.to_vec();
    colors.sort_by_key(|(_, name)| *name);
    factors.extend(colors.into_iter().map(|(color, name)| {
        let (low, high) = match (color, name) {
            (_, "visuals.bg") => (0.6, 1.0),
            ([0, 0, 0], _) => (0.0, 0.4),
            _ => (0.0, 1.0),
        };
        let default = color.map(|channel| f32::from(channel) / 255.0);
        let doc = match name {
            "visuals.bg" => "color of the background",
            "visuals.cart" => "color of the cart and the track",
            "visuals.pole" => "color of the pole",
            "visuals.axle" => "color of the axle",
            "visuals.fg" => "color of hill, car and flagpole",
            "visuals.line" => "color of the line to reach",
            "visuals.link" => "color of the links",
            "visuals.joint" => "color of the joints",
            "visuals.rod" => "color of the rod",
            _ => "color of the hub and of the arrow that shows the torque",
        };
        Factor::vector_f32(name, bound(low), bound(high), &default).doc(doc)
    }));
    FovSpace::new(factors)
}

/// A physical constant, `[1]`, stored as `f32`.
pub(super) fn constant(name: &str, low: f32, high: f32, default: f32) -> Factor {
    Factor::vector_f32(name, bound(low), bound(high), &[default])
}

fn bound(value: f32) -> f64 {
    f64::from(value)
}

/// The value of a physical constant. The reference computes with the `f64` of the `f32`.
pub(super) fn value(fov: &Fov, name: &str) -> f64 {
    f64::from(fov.f32(name))
}

/// The colors of an assignment: `(drawn, shown)`.
pub(super) fn colors<T: Task>(fov: &Fov) -> Vec<(Rgb, Rgb)> {
    let shown = |name: &str| fov.vector::<f32, 3>(name).map(|share| (255.0 * share + 0.5) as u8);
    T::COLORS.iter().map(|&(drawn, name)| (drawn, shown(name))).collect()
}

/// A value drawn uniformly from `low..high`.
pub(super) fn uniform(stream: &mut Stream, low: f64, high: f64) -> f64 {
    use rand_distr::{Distribution as _, StandardUniform};
    let share: f64 = StandardUniform.sample(stream);
    low + (high - low) * share
}
