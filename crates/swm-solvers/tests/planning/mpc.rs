//! The MPC policy in a world: when it plans, what it starts from, what it carries out, what it remembers.

use std::sync::{Arc, Mutex};

use serde_json::{Map, Value as Json, json};
use swm_core::testing::TOY;
use swm_core::{EnvConfig, EpisodeSeed, PolicyContext, ResetOptions, Space};
use swm_solvers::{
    ActionScale, Candidates, Cem, Cost, LearnedCost, MpcPolicy, Outputs, Plan, PlanConfig, PlanError,
    PlanningContext, Problem, SimulatorCost, SimulatorOptions, Solver, Trace, Workspace, plan_on,
};

use crate::worlds::{Setting, Story, run, toward};

/// What a solve was asked for.
#[derive(Clone, Debug, PartialEq)]
struct Asked {
    episodes: Vec<u64>,
    plans: Vec<u64>,
    initial: Vec<f32>,
}

/// A solver without a search: block `h` of plan `p` is `0.1 × p + 0.01 × (h + 1)` in all its values.
struct Staircase {
    asked: Arc<Mutex<Vec<Asked>>>,
    scale: f32,
}

pub(super) fn stair(plan: u64, block: usize) -> f32 {
    0.1 * plan as f32 + 0.01 * (block + 1) as f32
}

impl Solver for Staircase {
    fn name(&self) -> &'static str {
        "staircase"
    }
    fn changed_settings(&self) -> Map<String, Json> {
        Map::new()
    }
    fn check(&self, _space: &Space) -> Result<(), PlanError> {
        Ok(())
    }
    fn solve(
        &self,
        problem: &Problem<'_>,
        _cost: &mut dyn Cost,
        _workspace: &mut Workspace,
        _trace: &mut dyn Trace,
        plan: &mut Plan,
    ) -> Result<(), PlanError> {
        problem.check()?;
        self.asked.lock().expect("one thread").push(Asked {
            episodes: problem.keys.iter().map(|key| key.episode).collect(),
            plans: problem.keys.iter().map(|key| key.plan).collect(),
            initial: problem.initial.to_vec(),
        });
        plan.begin(problem, 0.0);
        for (key, actions) in problem.keys.iter().zip(plan.actions.chunks_exact_mut(problem.plan_size())) {
            for (block, values) in actions.chunks_exact_mut(problem.dim()).enumerate() {
                values.fill(self.scale * stair(key.plan, block));
            }
        }
        Ok(())
    }
}

/// What a cost was shown of the past, per plan: states of the frames and values of the actions between them.
pub(super) type Past = Vec<(Vec<f64>, Vec<f32>)>;

/// A cost that only looks.
struct Watcher {
    past: Arc<Mutex<Past>>,
}

impl Cost for Watcher {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        let Some(history) = context.history(0) else { return Ok(()) };
        let frames = (0..history.frames()).map(|frame| history.frame(0, frame).as_f64(0).unwrap_or(f64::NAN));
        let count = (history.frames() - 1) * 2;
        let actions = (0..count).flat_map(|index| history.action(index));
        self.past.lock().expect("one thread").push((frames.collect(), actions.copied().collect()));
        Ok(())
    }
    fn evaluate(&mut self, _candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        outputs.costs.fill(0.0);
        Ok(())
    }
    fn history_fields(&self) -> Vec<String> {
        vec!["state".to_owned()]
    }
}

pub(super) struct Outcome {
    asked: Vec<Asked>,
    pub(super) past: Past,
    pub(super) stories: Vec<Story>,
}

fn act(config: PlanConfig, setting: &Setting, scale: f32) -> Outcome {
    act_in_units(config, setting, scale, None)
}

/// Plans, in the given units, are stairs of height `scale`.
pub(super) fn act_in_units(
    config: PlanConfig,
    setting: &Setting,
    scale: f32,
    units: Option<ActionScale>,
) -> Outcome {
    let (asked, past) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(Past::new())));
    let solver = Staircase { asked: Arc::clone(&asked), scale };
    let watcher = Watcher { past: Arc::clone(&past) };
    let mut policy =
        MpcPolicy::new(Box::new(solver), Box::new(watcher), config).expect("a valid configuration");
    if let Some(units) = units {
        policy = policy.with_scale(units);
    }
    let stories = run(setting, policy).expect("a run without failures");
    let take = |asked: Arc<Mutex<Vec<Asked>>>| asked.lock().expect("one thread").clone();
    let past = past.lock().expect("one thread").clone();
    Outcome { asked: take(asked), past, stories }
}

pub(super) fn config(horizon: usize, receding_horizon: usize, action_block: usize) -> PlanConfig {
    PlanConfig { horizon, receding_horizon, action_block, ..PlanConfig::default() }
}

pub(super) fn far_goal() -> Setting {
    Setting { reset: toward(1000.0), ..Setting::default() }
}

#[test]
fn carries_out_the_first_blocks_then_plans_again_from_what_is_left() {
    // H = 5, R = 2, k = 3: 6 steps per plan, 12 steps in all.
    let Outcome { asked, stories, .. } = act(config(5, 2, 3), &far_goal(), 1.0);
    let expected: Vec<f32> =
        [(0, 0), (0, 1), (1, 0), (1, 1)].iter().flat_map(|&(plan, block)| [stair(plan, block); 3]).collect();
    assert_eq!(stories[0].actions, expected);
    assert_eq!(asked.iter().map(|asked| asked.plans[0]).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(asked[0].initial, [0.0; 15]);
    let left = [2, 3, 4].iter().flat_map(|&block| [stair(0, block); 3]);
    assert_eq!(asked[1].initial, left.chain([0.0; 6]).collect::<Vec<_>>());

    let cold = act(PlanConfig { warm_start: false, ..config(5, 2, 3) }, &far_goal(), 1.0);
    assert!(cold.asked.iter().all(|asked| asked.initial == [0.0; 15]));
    let whole = act(config(2, 2, 3), &far_goal(), 1.0);
    assert!(whole.asked.iter().all(|asked| asked.initial == [0.0; 6]), "nothing is left of a whole plan");
}

#[test]
fn a_shrinking_horizon_ends_where_the_full_plan_did() {
    // H = 5, R = 2, k = 1: plans of 5, 3 and 1 blocks, then again; neighbors that are at another plan change nothing.
    let config = PlanConfig { shrinking_horizon: true, ..config(5, 2, 1) };
    let Outcome { asked, stories, .. } = act(config.clone(), &far_goal(), 1.0);
    let sizes: Vec<usize> = asked.iter().map(|asked| asked.initial.len()).collect();
    assert_eq!(sizes, [5, 3, 1, 5, 3, 1, 5]);
    assert_eq!(
        asked[1].initial,
        [2, 3, 4].map(|block| stair(0, block)),
        "it goes on with the rest of the last"
    );
    assert_eq!(asked[3].initial, [0.0; 5], "nothing is left of a plan that is executed");
    let expected = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (3, 0)].map(|(plan, block)| stair(plan, block));
    assert_eq!(stories[0].actions[..6], expected);

    let setting = Setting { num_envs: 4, episodes: 12, max_steps: 30, ..Setting::default() };
    let together = act(config.clone(), &setting, 10.0);
    let alone = act(config, &Setting { num_envs: 1, ..setting }, 10.0);
    assert_eq!(together.stories, alone.stories);
    assert!(together.asked.iter().any(|asked| asked.episodes.len() > 1));
}

/// A cost that keeps what it was asked for: the sum of the actions, and its gradient of 1.
struct Sum {
    seen: Arc<Mutex<Vec<f32>>>,
}

impl Cost for Sum {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        self.seen.lock().expect("one thread").extend_from_slice(candidates.actions);
        for (plan, cost) in candidates.plans().zip(outputs.costs.iter_mut()) {
            *cost = -f64::from(plan.iter().sum::<f32>());
        }
        outputs.gradient.iter_mut().for_each(|gradient| gradient.fill(-1.0));
        Ok(())
    }
    fn has_gradients(&self) -> bool {
        true
    }
}

#[test]
fn learned_costs_see_candidates_as_they_are_executed() {
    let seen_with = |settings: serde_json::Value| {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let cost = Box::new(Sum { seen: Arc::clone(&seen) });
        let learned = LearnedCost::new(cost, 1);
        let config = EnvConfig::default();
        let context = PolicyContext::new(&TOY, &config);
        let given = settings.as_object().expect("settings").clone();
        let policy = plan_on(&context, learned, given).expect("sound settings");
        let stories = run(&Setting { max_steps: 4, ..far_goal() }, policy).expect("a run without failures");
        let largest = seen.lock().expect("one thread").iter().fold(0.0_f32, |most, x| most.max(x.abs()));
        (largest, stories[0].actions.clone())
    };
    // The toy's actions are within 1; a search for the largest sum leaves them far behind.
    let search = json!({ "samples": 40, "iterations": 6, "elites": 4, "horizon": 2, "receding_horizon": 2 });
    let with = |more: serde_json::Value| {
        let mut settings = search.clone();
        settings.as_object_mut().expect("settings").extend(more.as_object().expect("settings").clone());
        seen_with(settings)
    };
    let (largest, actions) = with(json!({}));
    assert_eq!(largest, 1.0);
    assert!(actions.iter().all(|action| (0.8..=1.0).contains(action)), "{actions:?}");
    assert!(with(json!({ "clip_actions": false })).0 > 1.5, "as they are executed, again");
    // Behind a bound the cost is flat: descent that has crossed it stops there.
    let steps = json!({ "solver": "sgd", "samples": 1, "iterations": 50, "lr": 0.3, "horizon": 2, "receding_horizon": 2 });
    assert_eq!(seen_with(steps).0, 1.0);
}

#[test]
fn nothing_is_left_over_from_the_last_episode() {
    // Two episodes of 12 steps in one slot; 8 steps per plan, so the first ends in the middle of one.
    let setting = Setting { episodes: 2, ..far_goal() };
    let Outcome { asked, stories, .. } = act(config(5, 4, 2), &setting, 1.0);
    assert_eq!(stories[0], stories[1]);
    let plans: Vec<_> = asked.iter().map(|asked| (asked.episodes[0], asked.plans[0])).collect();
    assert_eq!(plans, [(0, 0), (0, 1), (1, 0), (1, 1)]);
    assert_eq!(asked[2].initial, [0.0; 10]);
}

#[test]
fn only_live_environments_without_actions_are_planned_for() {
    // Random starts and goals: episodes end at different steps.
    let setting = Setting { num_envs: 4, episodes: 12, max_steps: 30, ..Setting::default() };
    let Outcome { asked, stories, .. } = act(config(3, 1, 4), &setting, 10.0);
    let lengths: Vec<usize> = stories.iter().map(|story| story.actions.len()).collect();
    assert!(lengths.iter().any(|&length| length < 30) && lengths.contains(&30), "{lengths:?}");
    for (episode, length) in lengths.iter().enumerate() {
        let plans: Vec<u64> = asked
            .iter()
            .flat_map(|asked| asked.episodes.iter().zip(&asked.plans))
            .filter(|&(&of, _)| of == episode as u64)
            .map(|(_, &plan)| plan)
            .collect();
        let needed = length.div_ceil(4) as u64;
        assert_eq!(plans, (0..needed).collect::<Vec<_>>(), "episode {episode} of {length} steps");
    }
    assert!(asked.iter().any(|asked| asked.episodes.len() == 4), "they are planned for together");
    assert!(asked.iter().any(|asked| asked.episodes.len() < 4));
    let alone = act(config(3, 1, 4), &Setting { num_envs: 1, ..setting }, 10.0);
    assert_eq!(alone.stories, stories);
}

#[test]
fn an_episode_that_ends_leaves_the_others_in_the_middle_of_their_plans() {
    // H = 5, R = 2, k = 3. Episode 1 is at its goal after 5 steps, in the middle of a plan; episode 3 takes its place.
    let each = [1000.0, 0.56, 1000.0, 1000.0].map(toward).to_vec();
    let setting = Setting { num_envs: 3, episodes: 4, each, ..Setting::default() };
    let Outcome { asked, stories, .. } = act(config(5, 2, 3), &setting, 1.0);
    let rounds: Vec<_> = asked.iter().map(|asked| (asked.episodes.clone(), asked.plans.clone())).collect();
    let expected =
        [(vec![0, 1, 2], vec![0, 0, 0]), (vec![3], vec![0]), (vec![0, 2], vec![1, 1]), (vec![3], vec![1])];
    assert_eq!(rounds, expected);
    let cold = [0.0; 15];
    let warm: Vec<f32> = [2, 3, 4].iter().flat_map(|&block| [stair(0, block); 3]).chain([0.0; 6]).collect();
    assert_eq!(asked[0].initial, [cold; 3].concat());
    assert_eq!(asked[1].initial, cold, "nothing is left of episode 1");
    assert_eq!(asked[2].initial, [warm.clone(), warm.clone()].concat());
    assert_eq!(asked[3].initial, warm);
    assert_eq!(stories[1].actions.len(), 5);
    for episode in [2, 3] {
        assert_eq!(stories[episode], stories[0], "neighbors change nothing");
    }
}

#[test]
fn permuting_environments_permutes_what_happens_in_them() {
    let place =
        |seed: u64| ResetOptions { seed: Some(EpisodeSeed::new(seed)), ..toward(seed as f64 / 2.0 - 4.0) };
    let solve = |order: [u64; 5]| {
        let each = order.map(place).to_vec();
        let setting = Setting { num_envs: 5, episodes: 5, threads: 2, each, ..Setting::default() };
        let solver = Cem { samples: 24, elites: 4, iterations: 3, ..Cem::default() };
        let cost = SimulatorCost::new(&TOY, &EnvConfig::default(), SimulatorOptions::default());
        let cost = Box::new(cost.expect("the toy can be made"));
        let policy = MpcPolicy::new(Box::new(solver), cost, config(3, 2, 2)).expect("a valid configuration");
        run(&setting, policy).expect("a run without failures")
    };
    let (straight, mixed) = (solve([1, 3, 6, 9, 14]), solve([9, 1, 14, 3, 6]));
    for (position, original) in [3, 0, 4, 1, 2].into_iter().enumerate() {
        assert_eq!(mixed[position], straight[original]);
    }
    assert!(straight.iter().any(|story| story.actions != straight[0].actions));
}

#[test]
fn actions_are_clipped_to_the_space_unless_told_otherwise() {
    let clipped = act(config(2, 2, 1), &far_goal(), 75.0);
    assert_eq!(clipped.stories[0].actions[..2], [0.75, 1.0]);
    let free = act(PlanConfig { clip_actions: false, ..config(2, 2, 1) }, &far_goal(), 75.0);
    assert_eq!(free.stories[0].actions[..2], [0.75, 1.5]);
}

#[test]
fn history_holds_the_frames_that_exist_and_the_actions_between_them() {
    let setting = Setting { episodes: 2, ..far_goal() };
    let config = PlanConfig { history_len: 3, ..config(4, 1, 2) };
    let Outcome { past, stories, .. } = act(config, &setting, 1.0);
    assert_eq!(past.len(), 12, "12 steps in blocks of 2, twice");
    for (plan, (frames, actions)) in past.iter().enumerate() {
        let (story, now) = (&stories[plan / 6], plan % 6 * 2);
        let first = now.saturating_sub(4);
        let expected: Vec<f64> = (first..=now).step_by(2).map(|step| story.states[step]).collect();
        assert_eq!(*frames, expected, "at step {now}");
        assert_eq!(*actions, story.actions[first..now], "at step {now}");
    }
    let none = act(PlanConfig { history_len: 1, ..PlanConfig::default() }, &setting, 1.0);
    assert!(none.past.is_empty());
}

#[test]
fn bad_configurations_are_refused() {
    for (config, expected) in [
        (config(0, 1, 1), "setting `horizon`: 0 is too small; use 1 or more"),
        (config(5, 0, 1), "setting `receding_horizon`: 0 is too small; use 1 or more"),
        (config(5, 5, 0), "setting `action_block`: 0 is too small; use 1 or more"),
        (config(2, 3, 1), "3 blocks of a plan of 2 cannot be executed"),
        (PlanConfig { history_len: 0, ..config(1, 1, 1) }, "setting `history_len`: 0 is too small"),
    ] {
        let solver = Staircase { asked: Arc::default(), scale: 1.0 };
        let refused = MpcPolicy::new(Box::new(solver), Box::new(Watcher { past: Arc::default() }), config);
        let message = refused.err().expect("refused").to_string();
        assert!(message.contains(expected), "{message}");
    }
}
