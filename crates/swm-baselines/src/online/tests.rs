//! What every line of [`AGENTS`] keeps to, in the toy environment, with every kind of observation that it learns from: runs that are
//! killed, stopped, resumed, refused. A new agent is tested by its line in [`TINY`].

use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_core::env::PIXELS;
use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{Cancel, EnvEntry, Registry, Rollout, World, WorldOptions};

use super::*;
use crate::train::{Checkpoint, End, MetricSink, Record, RunFolder};
use crate::{BaselineError, Device};

/// Vectors, images, both.
const KINDS: [&[&str]; 3] = [&["state", "goal_state"], &["pixels"], &["goal_state", "pixels"]];
const STEPS: u64 = 130;

pub(super) fn registry() -> Registry {
    Registry::new().with(&[TOY, DISCRETE_TOY]).with(swm_data::FORMATS)
}

/// What makes an agent tiny: for many short runs, and for one that learns.
struct Tiny {
    agent: &'static str,
    changes: fn() -> Json,
    learns_with: fn() -> Json,
}

const TINY: &[Tiny] = &[
    Tiny {
        agent: "sac",
        changes: || json!({ "hidden": [8, 8], "batch": 8 }),
        learns_with: || json!({ "hidden": [32, 32], "batch": 32, "lr": 3e-3, "tau": 0.02, "collect": { "random_steps": 200 } }),
    },
    Tiny {
        agent: "tdmpc2",
        changes: || {
            let plan = json!({ "samples": 12, "collect_samples": 10, "elites": 4, "policy_samples": 3, "iterations": 2 });
            json!({ "latent_dim": 8, "encoder_dim": 8, "mlp_dim": 8, "num_bins": 11, "batch": 8, "plan": plan,
                "image": { "size": 40, "channels": 4 } })
        },
        learns_with: || {
            let plan = json!({ "samples": 32, "collect_samples": 32, "elites": 8, "policy_samples": 8 });
            json!({ "latent_dim": 16, "encoder_dim": 32, "mlp_dim": 32, "num_bins": 21, "vmin": -4.0, "vmax": 4.0, "batch": 32,
                "horizon": 2, "lr": 3e-3, "plan": plan, "collect": { "random_steps": 200 } })
        },
    },
];

/// Calls `check` with each agent of the table.
fn for_each(check: impl Fn(&Tiny)) {
    for entry in AGENTS {
        let tiny = TINY.iter().find(|tiny| tiny.agent == entry.name);
        check(tiny.unwrap_or_else(|| panic!("{} has no line in TINY", entry.name)));
    }
}

/// Calls `check` with each agent of the table, and the columns of each kind of observation that it learns from.
fn for_each_kind(check: impl Fn(&Tiny, &[&str])) {
    for_each(|tiny| {
        let sees = find_agent(tiny.agent).unwrap().learns_from_images();
        let kinds = KINDS.iter().filter(|kind| sees || !kind.contains(&PIXELS));
        kinds.for_each(|observe| check(tiny, observe));
    });
}

fn begin(tiny: &Tiny, observe: &[&str], folder: &Path) -> OnlineTraining {
    let fit = OnlineSettings {
        steps: STEPS,
        max_episode_steps: 20,
        log_every: 10,
        eval_every: 40,
        eval_episodes: 3,
        keep: 9,
        ..OnlineSettings::default()
    };
    let collect = json!({ "num_envs": 3, "random_steps": 30, "updates_per_step": 0.7, "capacity": 90 });
    let mut changes = (tiny.changes)();
    changes["collect"] = collect;
    begin_with(tiny.agent, observe, folder, &changes, &fit).unwrap()
}

fn begin_with(
    agent: &str,
    observe: &[&str],
    folder: &Path,
    changes: &Json,
    fit: &OnlineSettings,
) -> Result<OnlineTraining, BaselineError> {
    let observe: Vec<String> = observe.iter().map(|&name| name.to_owned()).collect();
    let new = NewOnlineRun {
        agent,
        preset: "small",
        changes: changes.clone(),
        env_settings: Map::new(),
        observe: &observe,
        fit: fit.clone(),
        device: Device::Cpu,
    };
    OnlineTraining::create(folder, &TOY, &new)
}

fn resume(folder: &Path) -> Result<OnlineTraining, BaselineError> {
    OnlineTraining::resume(&registry(), folder, Device::Cpu, None, |_| {})
}

/// At a step, an error that loses what is in memory, as a kill does; or the wish to stop.
pub(super) struct At(pub(super) u64, pub(super) Option<Cancel>);

impl MetricSink for At {
    fn record(&mut self, record: &Record) -> Result<(), BaselineError> {
        match record.step >= self.0 && self.1.is_none() {
            true => Err(BaselineError::data("test", "killed")),
            false => Ok(()),
        }
    }

    fn step(&mut self, step: u64, _total: u64) {
        if let Some(cancel) = self.1.as_ref().filter(|_| step == self.0) {
            cancel.cancel();
        }
    }
}

/// All that a run leaves, but for times: the last checkpoint with the hashes of its weights and optimizers, metrics, episodes.
fn left(folder: &Path) -> (Checkpoint<OnlineState>, Vec<Json>, Vec<Vec<String>>) {
    let (checkpoint, metrics) = left_of_run(folder);
    let mut dataset = swm_data::open(&folder.join("episodes.h5")).unwrap();
    let episodes = (0..dataset.num_episodes())
        .map(|episode| {
            let mut rows = swm_core::Batch::new(dataset.schema().clone(), 0);
            dataset.read(episode, 0..dataset.episode_len(episode), &mut rows).unwrap();
            (0..rows.schema().fields().len()).map(|column| format!("{:?}", rows.column(column))).collect()
        })
        .collect();
    (checkpoint, metrics, episodes)
}

/// The same without episodes.
pub(super) fn left_of_run(folder: &Path) -> (Checkpoint<OnlineState>, Vec<Json>) {
    let run = RunFolder::open(folder).unwrap();
    let checkpoint = run.checkpoint(*run.steps().unwrap().last().unwrap()).unwrap();
    let metrics = std::fs::read_to_string(run.file("metrics.jsonl")).unwrap();
    let untimed = |line: &str| {
        let mut line: Map<String, Json> = serde_json::from_str(line).unwrap();
        line.retain(|name, _| name != "clips_per_s" && name != "elapsed_s");
        Json::Object(line)
    };
    (checkpoint, metrics.lines().map(untimed).collect())
}

#[test]
fn runs_that_were_killed_and_stopped_go_on_to_the_same_bits() {
    for_each_kind(goes_on_to_the_same_bits);
}

fn goes_on_to_the_same_bits(tiny: &Tiny, observe: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let [whole, cut] = ["whole", "cut"].map(|name| folder.path().join(name));
    let state = begin(tiny, observe, &whole).run(Vec::new(), &Cancel::new()).unwrap();
    assert_eq!((state.step, state.end), (STEPS, Some(End::Complete)));
    assert!(state.episodes >= 6 && state.collected >= STEPS, "{state:?}");

    // Killed after the checkpoint at step 40, when the dataset holds more episodes than the checkpoint knows.
    let killed = begin(tiny, observe, &cut).run(vec![Box::new(At(80, None))], &Cancel::new()).unwrap_err();
    assert!(killed.to_string().contains("killed"), "{killed}");
    let held = left(&cut);
    assert_eq!(held.0.step, 40);
    assert!(held.2.len() as u64 > held.0.state.episodes, "{} of {}", held.0.state.episodes, held.2.len());
    // Asked to stop amid the steps of a round.
    let cancel = Cancel::new();
    let stop = Box::new(At(57, Some(cancel.clone())));
    let stopped = resume(&cut).unwrap().run(vec![stop], &cancel).unwrap();
    assert_eq!((stopped.step, stopped.end), (57, Some(End::Interrupted)));
    let held = left(&cut).0;
    assert!(held.step == 57 && held.state.evaluation.is_empty(), "it was not evaluated there: {held:?}");
    resume(&cut).unwrap().run(Vec::new(), &Cancel::new()).unwrap();

    let (a, b) = (left(&whole), left(&cut));
    assert_eq!(a.0, b.0);
    assert_eq!(a.1, b.1);
    assert_eq!(a.2, b.2);
    assert!(a.1.iter().any(|line| line["part"] == "evaluation" && line["return"].is_f64()), "{:?}", a.1);
    assert!(a.1.iter().any(|line| line["part"] == "train" && line["loss"].is_f64()), "{:?}", a.1);
}

#[test]
fn a_finished_run_is_not_cut_to_fewer_steps() {
    let folder = tempfile::tempdir().unwrap();
    begin(&TINY[0], KINDS[0], folder.path()).run(Vec::new(), &Cancel::new()).unwrap();
    let config = || std::fs::read(folder.path().join("config.json")).unwrap();
    let before = config();
    let resume = |steps| {
        OnlineTraining::resume(&registry(), folder.path(), Device::Cpu, None, |fit| fit.steps = steps)
            .map(drop)
            .map_err(|error| error.to_string())
    };
    let error = resume(STEPS - 1).unwrap_err();
    assert!(error.contains(&format!("it has learned for {STEPS} steps, and {} were", STEPS - 1)), "{error}");
    assert!(config() == before, "receipts hash it");
    assert_eq!(resume(STEPS), Ok(()));
    assert!(config() == before);
}

#[test]
fn a_dataset_that_is_gone_or_another_is_refused() {
    for_each(refuses_another_dataset);
}

fn refuses_another_dataset(tiny: &Tiny) {
    let folder = tempfile::tempdir().unwrap();
    let [run, other] = ["run", "other"].map(|name| folder.path().join(name));
    begin(tiny, KINDS[0], &run).run(vec![Box::new(At(80, None))], &Cancel::new()).unwrap_err();
    let goes_on = || resume(&run).unwrap().run(Vec::new(), &Cancel::new()).unwrap_err().to_string();
    let episodes = run.join("episodes.h5");
    // Another run's first episodes, and then those that this one has not learned from.
    let seed = OnlineSettings { steps: 200, seed: 5, max_episode_steps: 20, ..OnlineSettings::default() };
    begin_with(tiny.agent, KINDS[0], &other, &(tiny.changes)(), &seed)
        .unwrap()
        .run(Vec::new(), &Cancel::new())
        .unwrap();
    std::fs::copy(other.join("episodes.h5"), &episodes).unwrap();
    assert!(goes_on().contains("is another one than the run's dataset holds"));
    std::fs::remove_file(&episodes).unwrap();
    let message = goes_on();
    assert!(message.contains("episodes.h5") && message.contains("bring it back"), "{message}");
}

#[test]
fn short_episodes_are_collected_and_whole_ones_evaluated() {
    // Only random steps, so that all runs evaluate the initial weights. Rewards are below 0: longer episodes return less.
    let run = |collected: Option<u64>, max_episode_steps| {
        let folder = tempfile::tempdir().unwrap();
        let fit = OnlineSettings { steps: 40, max_episode_steps, ..OnlineSettings::default() };
        let mut changes = (TINY[0].changes)();
        changes["collect"] = json!({ "random_steps": 40, "max_episode_steps": collected });
        let mut run = begin_with(TINY[0].agent, KINDS[0], folder.path(), &changes, &fit).unwrap();
        let state = run.run(Vec::new(), &Cancel::new()).unwrap();
        (state.episodes, state.evaluation)
    };
    let (short, whole, all_short) = (run(Some(4), 20), run(None, 20), run(None, 4));
    assert!(short.0 >= 10 && short.0 == all_short.0 && short.0 > whole.0, "{short:?} {whole:?}");
    let worst = |(_, evaluation): &(u64, Vec<(String, f64)>)| evaluation[1].1;
    assert!(worst(&short) < 3.0 * worst(&all_short), "{short:?} {all_short:?}");
    assert_eq!(run(Some(50), 20), whole, "the longer one never ends an episode");
}

#[test]
fn agents_learn_to_reach_the_goal() {
    for_each(learns_to_reach_the_goal);
}

fn learns_to_reach_the_goal(tiny: &Tiny) {
    let folder = tempfile::tempdir().unwrap();
    let fit = OnlineSettings {
        steps: 1_500,
        max_episode_steps: 20,
        eval_every: 1_500,
        eval_episodes: 20,
        ..OnlineSettings::default()
    };
    let mut training = begin_with(tiny.agent, KINDS[0], folder.path(), &(tiny.learns_with)(), &fit).unwrap();
    let state = training.run(Vec::new(), &Cancel::new()).unwrap();
    let value = |name: &str| state.evaluation.iter().find(|(known, _)| known == name).unwrap().1;
    let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(20).threads(1)).unwrap();
    world.set_policy(swm_core::policies::random()).unwrap();
    let random = world.evaluate(&Rollout::new(0..20).seed(!fit.seed)).unwrap();
    assert!(random.success_rate < 80.0, "random actions solve {} %", random.success_rate);
    assert!(value("success_rate") >= 0.9, "{}: {state:?}", tiny.agent);
    let mean = random.episode_returns.iter().sum::<f64>() / 20.0;
    assert!(value("return") > mean, "{}: {state:?}, random actions get {mean}", tiny.agent);
}

#[test]
fn what_an_agent_cannot_learn_in_is_refused() {
    for_each(refuses_what_it_cannot_learn_in);
}

fn refuses_what_it_cannot_learn_in(tiny: &Tiny) {
    let folder = tempfile::tempdir().unwrap();
    let create = |env: &EnvEntry, observe: &[&str], steps: u64| {
        let observe: Vec<String> = observe.iter().map(|&name| name.to_owned()).collect();
        let new = NewOnlineRun {
            agent: tiny.agent,
            preset: "small",
            changes: Json::Null,
            env_settings: Map::new(),
            observe: &observe,
            fit: OnlineSettings { steps, ..OnlineSettings::default() },
            device: Device::Cpu,
        };
        OnlineTraining::create(folder.path(), env, &new).err().unwrap().to_string()
    };
    assert!(create(&DISCRETE_TOY, &[], 10).contains("swm/DiscreteToy-v0: actions are"));
    let message = create(&TOY, &["stat"], 10);
    assert!(message.contains("no vector `stat`; there are state, goal_state"), "{message}");
    let message = create(&TOY, &["stat", "pixels"], 10);
    if find_agent(tiny.agent).unwrap().learns_from_images() {
        assert!(message.contains("no vector `stat`"), "{message}");
    } else {
        let wanted =
            "sac learns from vectors alone; leave `pixels` out, or train one that learns from images: tdmpc2";
        assert!(message.contains(wanted), "{message}");
    }
    assert!(create(&TOY, &[], 0).contains("setting `steps`: 0"));
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing is left behind");
}
