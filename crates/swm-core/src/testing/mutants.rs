//! Mutation tests of the suite: a small environment with one fault at a time must be refused, by the check that is about it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Exceptions, violations};
use crate::batch::{Dtype, Field, RowsMut, Slice, Value};
use crate::env::{Env, EnvConfig, EnvSpec, EnvState, Episode, FactorSpec, ImageSize, Outcome};
use crate::error::EnvError;
use crate::registry::EnvEntry;
use crate::seed::EpisodeSeed;
use crate::space::Space;

/// Faults, and the check that must name them.
const FAULTS: &[(&str, &str)] = &[
    ("the spec has another id", "spec_is_sound"),
    ("a factor has no field", "spec_is_sound"),
    ("a factor is a step field", "spec_is_sound"),
    ("a factor's field has another type", "spec_is_sound"),
    ("a default lies outside of its bounds", "spec_is_sound"),
    ("a start column is not a field", "spec_is_sound"),
    ("a goal column is not a field", "spec_is_sound"),
    ("a reset has a reward", "spec_is_sound"),
    ("unknown settings are ignored", "spec_is_sound"),
    ("the velocity survives a reset", "deterministic"),
    ("episodes are counted", "deterministic"),
    ("the seed is ignored", "deterministic"),
    ("observing moves", "deterministic"),
    ("NaN is observed", "deterministic"),
    ("a factor has a reserved name", "spec_is_sound"),
    ("a field of the episode is observed", "episode_fields_are_constant"),
    ("a field of the episode counts steps", "episode_fields_are_constant"),
    ("snapshots lack the velocity", "snapshots_are_exact"),
    ("snapshots lack the goal", "snapshots_are_exact"),
    ("snapshots lack a factor", "snapshots_are_exact"),
    ("snapshots lack the budget", "snapshots_are_exact"),
    ("restoring spends energy", "snapshots_are_exact"),
    ("a damaged state is accepted", "snapshots_are_exact"),
    ("factors share a stream", "factors_are_independent"),
    ("factors are always sampled", "factors_are_independent"),
    ("values outside of bounds are clipped", "factors_are_independent"),
    ("unknown factors are ignored", "factors_are_independent"),
    ("a factor moves nothing", "every_factor_acts"),
    ("a color is not rendered", "every_factor_acts"),
    ("given factors are ignored", "every_factor_acts"),
    ("a look is not rendered", "looks_change_images_alone"),
    ("a look is in the columns", "looks_change_images_alone"),
    ("a look ends with a reset", "looks_change_images_alone"),
    ("any factor is a look", "looks_change_images_alone"),
    ("starts are ignored", "restarts_continue"),
    ("starts lose the velocity", "restarts_continue"),
    ("starts are rounded", "restarts_continue"),
    ("starts are clipped", "restarts_continue"),
    ("starts are only shown", "restarts_continue"),
    ("starts reset given factors", "restarts_continue"),
    ("the velocity is not observed", "restarts_continue"),
    ("the seed's wind blows", "restarts_continue"),
    ("the reward depends on time", "restarts_continue"),
    ("goals are ignored", "restarts_continue"),
    ("goals lose a value", "restarts_continue"),
    ("a value of a goal is 0", "restarts_continue"),
    ("the column of the goal is not written", "restarts_continue"),
    ("goals are starts", "restarts_continue"),
    ("goals are only shown", "restarts_continue"),
    ("goals are not shown", "restarts_continue"),
    ("goals are ignored with a start", "restarts_continue"),
    ("the factor is the goal's position, the recorded one is shown", "restarts_continue"),
    ("the image of a goal is of the sampled one", "goals_look_as_recorded"),
    ("the image of a goal has another color", "goals_look_as_recorded"),
    ("short rows are filled up", "wrong_rows_are_refused"),
    ("long rows are cut", "wrong_rows_are_refused"),
    ("NaN is a start", "wrong_rows_are_refused"),
    ("a refused goal stays", "wrong_rows_are_refused"),
    ("rows without columns are ignored", "wrong_rows_are_refused"),
];

#[test]
fn each_fault_is_named() {
    assert_eq!(found(""), Vec::<String>::new(), "without a fault");
    let missed = FAULTS.iter().filter_map(|(fault, check)| {
        let found = found(fault);
        let is_named = found.iter().any(|violation| violation.starts_with(&format!("{check}: ")));
        (!is_named).then(|| format!("{fault}: not by {check}, but by {found:?}"))
    });
    let missed: Vec<String> = missed.collect();
    assert!(missed.is_empty(), "not named:\n{}", missed.join("\n"));
}

#[test]
fn worlds_refuse_columns_of_datasets() {
    let made = |fault: &str| {
        let options = crate::WorldOptions::new(1).setting("fault", fault);
        crate::World::new(&CART, options).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(made(""), Ok(()));
    let message = made("a column is one of datasets").unwrap_err();
    assert!(message.contains("`ep_idx` has the name of a column"), "{message}");
}

fn found(fault: &str) -> Vec<String> {
    let settings = serde_json::Map::from_iter([("fault".to_owned(), fault.into())]);
    let image = Some(ImageSize { height: 4, width: 40 });
    violations(&CART, &EnvConfig { image, settings }, Exceptions::NONE)
}

const CART: EnvEntry = EnvEntry::new("swm/Cart-v0", "a cart on a line (for tests)", |config| {
    let mut config = config.clone();
    let fault = config.settings.remove("fault").and_then(|fault| fault.as_str().map(str::to_owned));
    Ok(Box::new(Cart::new(fault.unwrap_or_default(), &config)?))
})
.success("within 0.5 of the goal");

const STATE: usize = 0;
const GOAL_STATE: usize = 1;
const GAIN: usize = 2;
const COLOR: usize = 3;
const PIXELS: usize = 4;
const GOAL: usize = 5;
const GOAL_POSITION: usize = 6;
const BUDGET: f64 = 10.0;

#[derive(Clone, Copy, Default, Serialize, Deserialize)]
struct State {
    position: f64,
    velocity: f64,
    goal: [f64; 2],
    shown_goal: [f64; 2],
    shown_start: Option<f64>,
    rendered: f64,
    gain: f64,
    color: f64,
    goal_position: f64,
    energy: f64,
    wind: f64,
    steps: u32,
}

struct Cart {
    spec: EnvSpec,
    fault: String,
    state: State,
    resets: u32,
    refused: Option<[f64; 2]>,
    /// The color of the look.
    look: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {}

impl Cart {
    fn new(fault: String, config: &EnvConfig) -> Result<Self, EnvError> {
        let has = |known: &str| fault == known;
        if !has("unknown settings are ignored") {
            config.parse_settings::<Settings>(CART.id)?;
        }
        let image = config.image.unwrap_or(ImageSize { height: 4, width: 40 });
        let (name, step) = ("variation.cart.color", has("a factor is a step field"));
        let color = if step { Field::step } else { Field::episode };
        let fields = vec![
            Field::step("state", Dtype::F64, &[2]),
            Field::episode(
                if has("a column is one of datasets") { "ep_idx" } else { "goal_state" },
                Dtype::F64,
                &[2],
            ),
            Field::episode("variation.cart.gain", Dtype::F64, &[]),
            color(
                if has("a factor has no field") { "variation.color" } else { name },
                if has("a factor's field has another type") { Dtype::F32 } else { Dtype::F64 },
                &[],
            ),
            image.field("pixels"),
            Field::episode("goal", Dtype::U8, &[image.height, image.width, 3]),
            Field::episode("variation.goal.position", Dtype::F64, &[]),
        ];
        let gain = Space::uniform_box(Dtype::F64, &[], 0.1, 2.0);
        let color = Space::uniform_box(Dtype::F64, &[], 50.0, 200.0);
        let goal = Space::uniform_box(Dtype::F64, &[], -9.0, 9.0);
        let default = if has("a default lies outside of its bounds") { 3.0 } else { 1.0 };
        let id = if has("the spec has another id") { "swm/Cart-v1" } else { CART.id };
        let state = |broken: &str| if has(broken) { &["position"] } else { &["state"] };
        let spec = EnvSpec::new(id, Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0), fields)
            .factors(vec![
                FactorSpec::new(
                    if has("a factor has a reserved name") { "all.gain" } else { "cart.gain" },
                    gain,
                    default,
                ),
                FactorSpec::new("cart.color", color, 100.0).visual(true),
                FactorSpec::new("goal.position", goal, 3.0).sampled_by_default(true),
            ])
            .start_columns(state("a start column is not a field"))
            .goal_columns(state("a goal column is not a field"));
        Ok(Self { spec, fault, state: State::default(), resets: 0, refused: None, look: None })
    }

    fn has(&self, fault: &str) -> bool {
        self.fault == fault
    }

    fn outcome(&self) -> Outcome {
        let State { position, velocity, goal, steps, .. } = self.state;
        let distance = (position - goal[0]).abs();
        let time = if self.has("the reward depends on time") { f64::from(steps) } else { 0.0 };
        let reward = -distance - (velocity - goal[1]).abs() - time;
        Outcome { reward, terminated: distance < 0.5, success: Some(distance < 0.5) }
    }

    fn factor(&self, index: usize, episode: &Episode<'_>) -> Result<f64, EnvError> {
        let factor = &self.spec.factors[index];
        let (variation, given) = (&episode.options.variation, &episode.options.variation_values);
        let is_started = self.has("starts reset given factors") && episode.options.start.is_some();
        if let (Some(value), false) = (given.get(&factor.name), is_started) {
            let mut number = value.to_f64s(&factor.name)?[0];
            if self.has("values outside of bounds are clipped") {
                let (low, high) = factor.space.bounds();
                number = number.clamp(low[0], high[0]);
            } else {
                factor.space.check(&factor.name, value.data.as_slice())?;
            }
            if !self.has("given factors are ignored") {
                return Ok(number);
            }
        }
        let is_sampled = variation.iter().flatten().any(|asked| factor.is_selected_by(asked))
            || (variation.is_none() && factor.sampled_by_default);
        if is_sampled || self.has("factors are always sampled") {
            let shared = self.has("factors share a stream");
            let seed = if self.has("the seed is ignored") { EpisodeSeed::new(0) } else { episode.seed };
            let mut stream = seed.stream(if shared { "factors" } else { &factor.name });
            // A stream is read in order: with another factor sampled before, the numbers are others.
            let before = &self.spec.factors[..index];
            if shared
                && before.iter().any(|factor| variation.iter().flatten().any(|f| factor.is_selected_by(f)))
            {
                before[0].space.sample(&mut stream);
            }
            return Ok(factor.space.sample(&mut stream).to_f64s(&factor.name)?[0]);
        }
        Ok(factor.default.as_f64().unwrap_or(f64::NAN))
    }

    fn unknown_factor(&self, episode: &Episode<'_>) -> Option<String> {
        let asked = episode.options.variation.iter().flatten();
        let known = |asked: &str| self.spec.factors.iter().any(|factor| factor.is_selected_by(asked));
        asked.filter(|asked| !known(asked)).map(|asked| format!("unknown factor `{asked}`")).next()
    }

    fn state_in(&self, row: &BTreeMap<String, Value>) -> Result<Option<[f64; 2]>, EnvError> {
        let refused = |reason: &str| EnvError::Reset { env: CART.id.to_owned(), reason: reason.to_owned() };
        let Some(value) = row.get("state") else {
            let is_ignored = self.has("rows without columns are ignored");
            return if is_ignored { Ok(None) } else { Err(refused("start and goal need `state`")) };
        };
        let mut numbers = value.to_f64s("state")?;
        match numbers.len() {
            1 if self.has("short rows are filled up") => numbers.push(0.0),
            3.. if self.has("long rows are cut") => numbers.truncate(2),
            2 => {}
            _ => return Err(refused("`state` has two values")),
        }
        if !numbers.iter().all(|number| number.is_finite()) && !self.has("NaN is a start") {
            return Err(refused("`state` must be finite"));
        }
        Ok(Some([numbers[0], numbers[1]]))
    }

    fn start(&mut self, [position, velocity]: [f64; 2]) {
        self.state.velocity = if self.has("starts lose the velocity") { 0.0 } else { velocity };
        self.state.position = match self.fault.as_str() {
            "starts are rounded" => f64::from(position as f32),
            "starts are clipped" => position.clamp(-1.0, 1.0),
            _ => position,
        };
    }

    fn draw(&self, position: f64, color: f64, out: &mut [u8]) {
        out.fill(255);
        let column = ((position + 20.0) / 40.0).clamp(0.0, 0.999) * (out.len() / 3) as f64;
        out[3 * column as usize] = if self.has("a color is not rendered") { 0 } else { color as u8 };
    }
}

impl Env for Cart {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        if let (Some(reason), false) = (self.unknown_factor(episode), self.has("unknown factors are ignored"))
        {
            return Err(EnvError::Reset { env: CART.id.to_owned(), reason });
        }
        self.resets += 1;
        let seed = if self.has("the seed is ignored") { EpisodeSeed::new(0) } else { episode.seed };
        let space = Space::uniform_box(Dtype::F64, &[4], -9.0, 9.0);
        let sampled = space.sample(&mut seed.stream("start and goal")).to_f64s("start")?;
        let velocity = if self.has("the velocity survives a reset") { self.state.velocity } else { 0.0 };
        let number = if self.has("episodes are counted") { f64::from(self.resets) } else { 0.0 };
        let goal = [self.factor(2, episode)?, 0.1 * sampled[2]];
        self.state = State {
            position: sampled[0] + number,
            velocity,
            goal,
            shown_goal: goal,
            rendered: goal[0],
            goal_position: goal[0],
            gain: self.factor(0, episode)?,
            color: self.factor(1, episode)?,
            wind: if self.has("the seed's wind blows") { sampled[3] } else { 0.0 },
            ..State::default()
        };
        let (start, goal) = (&episode.options.start, &episode.options.goal);
        if let Some(row) = start {
            match self.state_in(row)? {
                Some([position, _]) if self.has("starts are only shown") => {
                    self.state.shown_start = Some(position);
                }
                Some(state) if !self.has("starts are ignored") => self.start(state),
                _ => {}
            }
        }
        if let Some(row) = goal {
            let read = self.state_in(row);
            if read.is_err() && self.has("a refused goal stays") {
                self.refused = Some([1.0, 1.0]);
            }
            if let Some(mut goal) = read? {
                if self.has("goals lose a value") {
                    goal[1] = self.state.goal[1];
                }
                if self.has("a value of a goal is 0") {
                    goal[1] = 0.0;
                }
                if self.has("goals are starts") {
                    self.start(goal);
                }
                let is_ignored = self.has("goals are ignored")
                    || (self.has("goals are ignored with a start") && start.is_some());
                if !is_ignored && !self.has("goals are only shown") {
                    self.state.goal = goal;
                }
                if self.has("the factor is the goal's position, the recorded one is shown") {
                    self.state.goal[0] = self.state.goal_position;
                }
                if !is_ignored && !self.has("goals are not shown") {
                    self.state.shown_goal = goal;
                }
                if !is_ignored && !self.has("the image of a goal is of the sampled one") {
                    self.state.rendered = goal[0];
                }
            }
        } else if let Some(goal) = self.refused {
            (self.state.goal, self.state.shown_goal) = (goal, goal);
        }
        if self.has("a look ends with a reset") {
            self.look = None;
        }
        let reward = if self.has("a reset has a reward") { 0.0 } else { f64::NAN };
        Ok(Outcome { reward, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let push = action.as_f64(0).unwrap_or(f64::NAN);
        let gain = if self.has("a factor moves nothing") { 1.0 } else { self.state.gain };
        let state = &mut self.state;
        state.velocity = 0.9 * state.velocity + 0.1 * gain * push + 0.01 * state.wind;
        state.position += state.velocity;
        state.energy += push.abs();
        state.shown_start = None;
        state.steps += 1;
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        if !self.has("the column of the goal is not written") {
            out.write(GOAL_STATE, &self.state.shown_goal);
        }
        out.write(GAIN, &[self.state.gain]);
        let steps = if self.has("a field of the episode counts steps") { self.state.steps } else { 0 };
        out.write(GOAL_POSITION, &[self.state.goal_position + f64::from(steps)]);
        let shown = self.look.unwrap_or(self.state.color);
        match self.fault.as_str() {
            "a factor's field has another type" => out.write(COLOR, &[self.state.color as f32]),
            "a look is in the columns" => out.write(COLOR, &[shown]),
            _ => out.write(COLOR, &[self.state.color]),
        }
        let color = if self.has("the image of a goal has another color") { 77.0 } else { shown };
        self.draw(self.state.rendered, color, out.at::<u8>(GOAL));
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        if self.has("observing moves") {
            self.state.position += 0.001;
        }
        let State { position, velocity, shown_start, color, steps, .. } = self.state;
        let position = if self.has("NaN is observed") && steps > 30 { f64::NAN } else { position };
        let velocity = if self.has("the velocity is not observed") { 0.0 } else { velocity };
        out.write(STATE, &[shown_start.unwrap_or(position), velocity]);
        if self.has("a field of the episode is observed") {
            out.write(GAIN, &[position]);
        }
        self.draw(position, self.look.unwrap_or(color), out.at::<u8>(PIXELS));
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let mut saved = self.state;
        match self.fault.as_str() {
            "snapshots lack the velocity" => saved.velocity = 0.0,
            "snapshots lack the goal" => saved.goal = [0.0; 2],
            "snapshots lack a factor" => saved.gain = 1.0,
            "snapshots lack the budget" => saved.energy = 0.0,
            _ => {}
        }
        state.store(CART.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let loaded = state.load(CART.id);
        self.state =
            if self.has("a damaged state is accepted") { loaded.unwrap_or_default() } else { loaded? };
        if self.has("restoring spends energy") {
            self.state.energy += 0.1;
        }
        Ok(())
    }

    fn dress(&mut self, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        let any = self.has("any factor is a look");
        if let Some(name) = look.keys().find(|name| *name != "cart.color" && !(any && *name == "cart.gain")) {
            return Err(EnvError::Reset {
                env: CART.id.to_owned(),
                reason: format!("`{name}` is not visual"),
            });
        }
        let color = look.get("cart.color").map(|value| value.to_f64s("cart.color")).transpose()?;
        self.look = color.map(|color| color[0]).filter(|_| !self.has("a look is not rendered"));
        Ok(())
    }

    fn is_truncated(&self) -> bool {
        self.state.energy > BUDGET
    }
}
