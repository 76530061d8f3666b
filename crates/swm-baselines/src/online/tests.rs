//! Whole runs in the toy environment: killed, stopped, resumed, used as policies, refused.

use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{Cancel, EnvConfig, EnvEntry, PolicyContext, Registry, Rollout, World, WorldOptions};

use super::*;
use crate::acting::POLICIES;
use crate::train::{Checkpoint, End, MetricSink, Record, RunFolder, Which};
use crate::{BaselineError, Device};

const OBSERVED: [&str; 2] = ["state", "goal_state"];
const STEPS: u64 = 130;

fn registry() -> Registry {
    Registry::new().with(POLICIES).with(&[TOY, DISCRETE_TOY])
}

fn begin(folder: &Path) -> OnlineTraining {
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
    begin_with(folder, &json!({ "hidden": [8, 8], "batch": 8, "collect": collect }), &fit).unwrap()
}

fn begin_with(folder: &Path, changes: &Json, fit: &OnlineSettings) -> Result<OnlineTraining, BaselineError> {
    let observe = OBSERVED.map(str::to_owned);
    let new = NewOnlineRun {
        agent: "sac",
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
    OnlineTraining::resume(&registry(), folder, Device::Cpu, |_| {})
}

/// At a step, an error that loses what is in memory, as a kill does; or the wish to stop.
struct At(u64, Option<Cancel>);

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
    let run = RunFolder::open(folder).unwrap();
    let checkpoint = run.checkpoint(*run.steps().unwrap().last().unwrap()).unwrap();
    let metrics = std::fs::read_to_string(run.file("metrics.jsonl")).unwrap();
    let untimed = |line: &str| {
        let mut line: Map<String, Json> = serde_json::from_str(line).unwrap();
        line.retain(|name, _| name != "clips_per_s" && name != "elapsed_s");
        Json::Object(line)
    };
    let mut dataset = swm_data::open(&run.file("episodes.h5")).unwrap();
    let episodes = (0..dataset.num_episodes())
        .map(|episode| {
            let mut rows = swm_core::Batch::new(dataset.schema().clone(), 0);
            dataset.read(episode, 0..dataset.episode_len(episode), &mut rows).unwrap();
            (0..rows.schema().fields().len()).map(|column| format!("{:?}", rows.column(column))).collect()
        })
        .collect();
    (checkpoint, metrics.lines().map(untimed).collect(), episodes)
}

#[test]
fn a_run_that_was_killed_and_stopped_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, cut] = ["whole", "cut"].map(|name| folder.path().join(name));
    let state = begin(&whole).run(Vec::new(), &Cancel::new()).unwrap();
    assert_eq!((state.step, state.end), (STEPS, Some(End::Complete)));
    assert!(state.episodes >= 6 && state.collected >= STEPS, "{state:?}");

    // Killed after the checkpoint at step 40, when the dataset holds more episodes than the checkpoint knows.
    let killed = begin(&cut).run(vec![Box::new(At(80, None))], &Cancel::new()).unwrap_err();
    assert!(killed.to_string().contains("killed"), "{killed}");
    let held = left(&cut);
    assert_eq!(held.0.step, 40);
    assert!(held.2.len() as u64 > held.0.state.episodes, "{} of {}", held.0.state.episodes, held.2.len());
    // Asked to stop amid the steps of a round.
    let cancel = Cancel::new();
    let stop = Box::new(At(57, Some(cancel.clone())));
    let stopped = resume(&cut).unwrap().run(vec![stop], &cancel).unwrap();
    assert_eq!((stopped.step, stopped.end), (57, Some(End::Interrupted)));
    assert_eq!(left(&cut).0.step, 57);
    resume(&cut).unwrap().run(Vec::new(), &Cancel::new()).unwrap();

    let (a, b) = (left(&whole), left(&cut));
    assert_eq!(a.0, b.0);
    assert_eq!(a.1, b.1);
    assert_eq!(a.2, b.2);
    assert!(a.1.iter().any(|line| line["part"] == "evaluation" && line["return"].is_f64()), "{:?}", a.1);
    assert!(a.1.iter().any(|line| line["part"] == "train" && line["loss"].is_f64()), "{:?}", a.1);
}

#[test]
fn a_dataset_that_is_gone_or_another_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [run, other] = ["run", "other"].map(|name| folder.path().join(name));
    begin(&run).run(vec![Box::new(At(80, None))], &Cancel::new()).unwrap_err();
    let goes_on = || resume(&run).unwrap().run(Vec::new(), &Cancel::new()).unwrap_err().to_string();
    let episodes = run.join("episodes.h5");
    // Another run's first episodes, and then those that this one has not learned from.
    let seed = OnlineSettings { steps: 200, seed: 5, max_episode_steps: 20, ..OnlineSettings::default() };
    begin_with(&other, &json!({ "hidden": [8, 8], "batch": 8 }), &seed)
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
fn an_agent_learns_to_reach_the_goal() {
    let folder = tempfile::tempdir().unwrap();
    let fit = OnlineSettings {
        steps: 1_500,
        max_episode_steps: 20,
        eval_every: 1_500,
        eval_episodes: 20,
        ..OnlineSettings::default()
    };
    let changes = json!({ "hidden": [32, 32], "batch": 32, "lr": 3e-3, "tau": 0.02, "collect": { "random_steps": 200 } });
    let state = begin_with(folder.path(), &changes, &fit).unwrap().run(Vec::new(), &Cancel::new()).unwrap();
    let value = |name: &str| state.evaluation.iter().find(|(known, _)| known == name).unwrap().1;
    let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(20).threads(1)).unwrap();
    world.set_policy(swm_core::policies::random());
    let random = world.evaluate(&Rollout::new(0..20).seed(!fit.seed)).unwrap();
    assert!(random.success_rate < 80.0, "random actions solve {} %", random.success_rate);
    assert!(value("success_rate") >= 0.9, "{state:?}");
    let mean = random.episode_returns.iter().sum::<f64>() / 20.0;
    assert!(value("return") > mean, "{state:?}, random actions get {mean}");
}

#[test]
fn an_agent_acts_as_a_policy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    begin(&path).run(Vec::new(), &Cancel::new()).unwrap();
    let run = path.display();
    let (registry, config) = (registry(), EnvConfig::default());
    let made = |text: String, env: &EnvEntry| {
        registry.policy(&text, PolicyContext::new(env, &config)).map_err(|error| error.to_string())
    };
    let returns = |num_envs| {
        let mut world =
            World::new(&TOY, WorldOptions::new(num_envs).max_episode_steps(20).threads(1)).unwrap();
        world.set_policy(made(format!("sac:{run}"), &TOY).unwrap());
        world.evaluate(&Rollout::new(0..5).seed(3)).unwrap().episode_returns
    };
    assert_eq!(returns(1), returns(4));
    assert!(made(format!("sac:{run},checkpoint=best"), &TOY).is_ok());
    let fails = |text: String, env: &EnvEntry| made(text, env).err().unwrap();
    assert!(fails(format!("sac:{run}"), &DISCRETE_TOY).contains("transfer=true"));
    assert!(fails(format!("sac:{run},checkpoint=41"), &TOY).contains("it has [40, 80, 120, 130]"));
    assert!(fails(format!("policy:{run}"), &TOY).contains("use it as `sac:RUN`"));
    assert_eq!(TrainedAgent::files(&path, Which::Last).unwrap().len(), 2);
}

#[test]
fn what_an_agent_cannot_learn_in_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let create = |env: &EnvEntry, observe: &[&str], steps: u64| {
        let observe: Vec<String> = observe.iter().map(|&name| name.to_owned()).collect();
        let new = NewOnlineRun {
            agent: "sac",
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
    assert!(create(&TOY, &[], 0).contains("setting `steps`: 0"));
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing is left behind");
}
