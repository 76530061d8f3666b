//! Agents as policies: `sac:RUN`, `tdmpc2:RUN` with options of its plan, in the toy environment.

use std::path::Path;

use serde_json::{Map, json};
use swm_baselines::Device;
use swm_baselines::online::{AGENTS, NewOnlineRun, OnlineSettings, OnlineTraining, TrainedAgent};
use swm_baselines::train::Which;
use swm_checkpoints::POLICIES;
use swm_core::env::PIXELS;
use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{Cancel, EnvConfig, EnvEntry, PolicyContext, Registry, Rollout, World, WorldOptions};

/// Vectors, images, both.
const KINDS: [&[&str]; 3] = [&["state", "goal_state"], &["pixels"], &["goal_state", "pixels"]];

fn registry() -> Registry {
    Registry::new().with(POLICIES).with(&[TOY, DISCRETE_TOY])
}

/// Trains a tiny agent, with a checkpoint at each multiple of 40 steps and at 130.
fn train(agent: &str, observe: &[&str], folder: &Path) {
    let mut changes = match agent {
        "sac" => json!({ "hidden": [8, 8], "batch": 8 }),
        _ => {
            let plan = json!({ "samples": 12, "collect_samples": 10, "elites": 4, "policy_samples": 3, "iterations": 2 });
            json!({ "latent_dim": 8, "encoder_dim": 8, "mlp_dim": 8, "num_bins": 11, "batch": 8, "plan": plan,
                "image": { "size": 40, "channels": 4 } })
        }
    };
    changes["collect"] =
        json!({ "num_envs": 3, "random_steps": 30, "updates_per_step": 0.7, "capacity": 90 });
    let observe: Vec<String> = observe.iter().map(|&name| name.to_owned()).collect();
    let fit = OnlineSettings {
        steps: 130,
        max_episode_steps: 20,
        log_every: 10,
        eval_every: 40,
        eval_episodes: 3,
        keep: 9,
        ..OnlineSettings::default()
    };
    let new = NewOnlineRun {
        agent,
        preset: "small",
        changes,
        env_settings: Map::new(),
        observe: &observe,
        fit,
        device: Device::Cpu,
    };
    let mut training = OnlineTraining::create(folder, &TOY, &new).expect("sound in this test");
    training.run(Vec::new(), &Cancel::new()).expect("sound in this test");
}

#[test]
fn agents_act_as_policies() {
    for entry in AGENTS {
        let sees = entry.learns_from_images();
        let kinds = KINDS.iter().filter(|kind| sees || !kind.contains(&PIXELS));
        kinds.for_each(|observe| acts_as_a_policy(entry.name, observe));
    }
}

fn acts_as_a_policy(agent: &str, observe: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    train(agent, observe, &path);
    let run = path.display();
    let (registry, config) = (registry(), EnvConfig::default());
    let args = swm_core::PolicyArgs::parse(&format!("{agent}:{run}")).unwrap();
    let image = registry.policy_entry(&TOY, agent).unwrap().image_size(&args);
    assert_eq!(image.map(|size| size.width), observe.contains(&PIXELS).then_some(40));
    let made = |text: String, env: &EnvEntry| {
        registry.policy(&text, PolicyContext::new(env, &config)).map_err(|error| error.to_string())
    };
    let evaluated = |num_envs, image| {
        let options = WorldOptions::new(num_envs).max_episode_steps(20).threads(1);
        let config = EnvConfig { image, ..EnvConfig::default() };
        let mut world = World::new(&TOY, options.env(config)).unwrap();
        world.set_policy(made(format!("{agent}:{run}"), &TOY).unwrap()).unwrap();
        world.evaluate(&Rollout::new(0..5).seed(3))
    };
    let returns = |num_envs| evaluated(num_envs, image).unwrap().episode_returns;
    assert_eq!(returns(1), returns(4));
    if image.is_some() {
        let blind = evaluated(1, None).unwrap_err();
        let blind = std::iter::successors(Some(&blind as &dyn std::error::Error), |error| error.source());
        let blind: Vec<String> = blind.map(ToString::to_string).collect();
        assert!(
            blind.concat().contains("none are rendered; leave their size out, or make it 40x40"),
            "{blind:?}"
        );
    }
    // What it was trained in is compared with what it acts in.
    let trained = registry.policy_entry(&TOY, agent).unwrap().trained_in(&args).unwrap();
    assert_eq!(trained.differences(&PolicyContext::new(&TOY, &config)), []);
    let settings = [("task".to_owned(), "run".into())].into_iter().collect();
    let other = EnvConfig { settings, ..EnvConfig::default() };
    let found = trained.differences(&PolicyContext::new(&TOY, &other).frame_skip(2));
    let found: Vec<_> =
        found.iter().map(|one| [&one.name, &one.trained, &one.used].map(String::as_str)).collect();
    assert_eq!(found, [["task", "its default", "run"], ["frame skip", "1", "2"]]);

    assert!(made(format!("{agent}:{run},checkpoint=best"), &TOY).is_ok());
    let fails = |text: String, env: &EnvEntry| made(text, env).err().unwrap();
    assert!(fails(format!("{agent}:{run}"), &DISCRETE_TOY).contains("transfer=true"));
    assert!(fails(format!("{agent}:{run},checkpoint=41"), &TOY).contains("it has [40, 80, 120, 130]"));
    assert!(fails(format!("policy:{run}"), &TOY).contains(&format!("use it as `{agent}:RUN`")));
    assert!(fails(format!("{agent}:{run},checkpont=last"), &TOY).contains("did you mean `checkpoint`?"));
    for other in AGENTS.iter().filter(|other| other.name != agent) {
        let message = fails(format!("{}:{run}", other.name), &TOY);
        assert!(
            message.contains(&format!("it trained {agent}, not {}; use it as `{agent}:RUN`", other.name)),
            "{message}"
        );
    }
    assert_eq!(TrainedAgent::files(&path, Which::Last).unwrap().len(), 2);
}

#[test]
fn options_of_a_plan_are_the_policys_settings() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run");
    train("tdmpc2", KINDS[0], &path);
    let made = |options: &str| {
        let (registry, config) = (registry(), EnvConfig::default());
        let text = format!("tdmpc2:{}{options}", path.display());
        registry.policy(&text, PolicyContext::new(&TOY, &config)).map_err(|error| error.to_string())
    };
    let returns = |options: &str| {
        let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(20).threads(1)).unwrap();
        world.set_policy(made(options).unwrap()).unwrap();
        world.evaluate(&Rollout::new(0..3).seed(3)).unwrap().episode_returns
    };
    assert_ne!(returns(""), returns(",samples=40,iterations=5,temperature=null"));
    assert_ne!(returns(""), returns(",mpc=false"));
    let described = made(",samples=40,mpc=true").unwrap().describe();
    assert!(described.ends_with(",samples=40,mpc=true"), "{described}");
    let fails = |options: &str| made(options).err().unwrap();
    assert!(fails(",samples=2").contains("`plan.samples` is 2; it must be at least 4"));
    assert!(fails(",sampels=40").contains("did you mean `samples`?"));
    assert!(fails(",elites=many").contains("`plan.elites` is \"many\"; it must be a whole number"));
}
