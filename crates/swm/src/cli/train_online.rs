//! `swm train AGENT --env ENV`, or `--dataset FILE`: agents that learn online or from a dataset, and the checkpoints of their runs.

use std::path::Path;

use serde_json::{Map, json};
use swm_baselines::online::{
    AGENTS, NewOnlineRun, OnlineConfig, OnlineSettings, OnlineState, OnlineTraining, is_online,
};
use swm_baselines::train::{Checkpoint, End, RunFolder};
use swm_core::{Registry, WorldError};

use super::work::{Pace, SAVING, Shown, changes, failure, many, short, trainable, unknown};
use super::{OnlineArgs, SPLIT, Train};
use crate::cli::args::{assignment, json_value};
use crate::cli::memory::{gigabytes, machine_bytes};
use crate::cli::output::{key_values, table};
use crate::cli::{Failure, Output, inputs, interrupt, usage};

impl Train {
    /// Whether an agent is to learn, by its name or by the run that is resumed; options that do not go with it are refused.
    pub(super) fn is_online(&self, out: &Path) -> Result<bool, Failure> {
        let agent = AGENTS.iter().find(|agent| Some(agent.name) == self.baseline.as_deref());
        let is_online = match &self.baseline {
            Some(name) if !trainable().any(|(known, ..)| known == name) => return Err(unknown(name)),
            Some(_) => agent.is_some(),
            None => is_online(&RunFolder::open(out).map_err(failure)?).map_err(failure)?,
        };
        let name = self.baseline.as_deref().unwrap_or("this run");
        let OnlineArgs { env, env_options, observe, max_steps, eval_every, eval_episodes } = &self.online;
        let on_data = agent.is_some_and(|agent| agent.learns_from_datasets) && self.dataset.is_some();
        let (given, reason) = if is_online {
            if env.is_none() && self.resume.is_none() && !on_data {
                let or = match agent.is_some_and(|agent| agent.learns_from_datasets) {
                    true => ", or a dataset with --dataset",
                    false => "",
                };
                return Err(usage(format!(
                    "{name} learns online: name an environment with --env, such as swm/CartpoleDMControl-v0{or}"
                )));
            }
            let given = [
                ("--dataset", self.dataset.is_some() && !on_data && self.resume.is_none()),
                ("--encoder", self.encoder.is_some()),
                ("--epochs", self.epochs.is_some()),
                ("--batch (use --set batch=B)", self.batch.is_some()),
                ("--checkpoint-every (use --eval-every)", self.checkpoint_every.is_some() && !on_data),
                ("--eval-every (use --checkpoint-every)", eval_every.is_some() && on_data),
                ("--eval-episodes", eval_episodes.is_some() && on_data),
                ("--norm-batches", self.norm_batches.is_some()),
                ("--quality-every", self.quality_every.is_some()),
                ("--patience", self.patience.is_some()),
                ("--precision", self.precision.is_some()),
                ("--split", (self.split - SPLIT).abs() > 0.0),
                ("--held-out", self.held_out > 0.0),
                ("--look", !self.looks.look.is_empty()),
                ("--vary", !self.looks.vary.is_empty()),
                ("--canonical", !self.looks.canonical.is_empty()),
                // Clap no longer asks for --env where --dataset excludes it.
                ("--env-option", !env_options.is_empty() && on_data),
                ("--max-steps", max_steps.is_some() && on_data),
            ];
            let how = if on_data { "learns from a dataset" } else { "learns online" };
            (given.to_vec(), format!("{how}, without this option; leave it out"))
        } else {
            let given = [
                ("--env", env.is_some()),
                ("--observe", !observe.is_empty()),
                ("--eval-every", eval_every.is_some()),
                ("--eval-episodes", eval_episodes.is_some()),
                ("--env-option", !env_options.is_empty()),
                ("--max-steps", max_steps.is_some()),
            ];
            let reason = match &self.dataset {
                Some(_) => "learns from a dataset, without this option; leave it out",
                None => "learns from a dataset: give --dataset, or train an agent",
            };
            (given.to_vec(), reason.to_owned())
        };
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((option, _)) => Err(usage(format!("{option}: {name} {reason}"))),
            None => Ok(is_online),
        }
    }

    /// Begins or resumes an agent's run.
    pub(super) fn run_online(&self, out: &Path, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let opening = self.opening()?;
        let device = self.device.parse().map_err(failure)?;
        let mut training = match &self.baseline {
            Some(agent) => {
                let mut fit = OnlineSettings::default();
                self.apply_online(&mut fit);
                let mut env_settings = Map::new();
                for option in &self.online.env_options {
                    let (name, value) = assignment(option, "--env-option")?;
                    env_settings.insert(name.to_owned(), json_value(value));
                }
                let (changes, observe) = (changes(&self.set)?, &self.online.observe[..]);
                let of_agent = AGENTS.iter().find(|entry| entry.name == agent);
                let preset =
                    self.preset.as_deref().or(of_agent.map(|entry| entry.presets[0])).unwrap_or_default();
                let new = NewOnlineRun { agent, preset, changes, env_settings, observe, fit, device };
                let training = match (&self.online.env, &self.dataset) {
                    (Some(env), _) => OnlineTraining::create(out, registry.env(env)?, &new),
                    (None, Some(data)) => OnlineTraining::create_on(
                        out,
                        inputs::open_with(registry, data, &opening)?.as_ref(),
                        &new,
                    ),
                    (None, None) => return Err(usage("--env: name an environment")),
                };
                training.map_err(failure)?
            }
            None => {
                let moved = self.dataset.as_deref();
                let resumed =
                    OnlineTraining::resume(registry, out, device, moved, |fit| self.apply_online(fit));
                resumed.map_err(failure)?
            }
        };
        output.note(beginning(&training));
        if let Some(note) = memory(training.buffer_size(), machine_bytes()) {
            output.note(note);
        }
        let bar = output.bar_alone(0, "steps");
        let begun_at = training.done().map_err(failure)?;
        let pace = if training.config().data.is_some() { Pace::Clips } else { Pace::EnvSteps };
        let shown = Shown::new(&bar, output, pace, false, begun_at);
        let run = out.display().to_string();
        interrupt::allow(SAVING);
        let advice = run.clone();
        let how = format!("run: swm train --resume {advice}");
        let cancel =
            interrupt::watch_resumable(move || format!("the last checkpoint is safe in {advice}"), how);
        let state = training.run(vec![Box::new(shown)], &cancel).map_err(failure)?;
        bar.finish_and_clear();
        if state.end == Some(End::Interrupted) {
            return Err(WorldError::Cancelled.into());
        }
        if state.step == begun_at {
            output.note(format_args!(
                "finished before: {begun_at} steps are done; a greater --steps continues it"
            ));
        }
        let is_collected = training.config().data.is_none();
        output.result(&state, || text(&state, &run, is_collected))
    }

    /// The settings that were given.
    fn apply_online(&self, fit: &mut OnlineSettings) {
        let Self { steps, seed, log_every, keep, online, .. } = self;
        fit.steps = steps.unwrap_or(fit.steps);
        fit.seed = seed.unwrap_or(fit.seed);
        fit.log_every = log_every.unwrap_or(fit.log_every);
        fit.keep = keep.unwrap_or(fit.keep);
        fit.max_episode_steps = online.max_steps.unwrap_or(fit.max_episode_steps);
        fit.eval_every = online.eval_every.or(self.checkpoint_every).unwrap_or(fit.eval_every);
        fit.eval_episodes = online.eval_episodes.unwrap_or(fit.eval_episodes);
    }
}

/// What learns, and where.
fn beginning(training: &OnlineTraining) -> String {
    let OnlineConfig { agent, interface, .. } = training.config();
    let [observed, acted] = interface.dims();
    let vectors = (observed > 0).then(|| format!("{observed} values ({})", interface.columns.join(", ")));
    let images = interface.image.map(|side| format!("images of {side}x{side}"));
    let observed: Vec<String> = vectors.into_iter().chain(images).collect();
    let [steps, bytes] = training.buffer_size();
    let buffer = match training.config().data {
        Some(_) => format!("in memory: {steps} steps"),
        None => format!("replay buffer: up to {steps} steps"),
    };
    format!(
        "{}, preset {}, {} parameters; {}: observations of {}, actions of {acted}; {buffer}, {}",
        agent.agent,
        agent.preset,
        many(training.agent().parameters()),
        place(training.config()),
        observed.join(" and "),
        size(bytes),
    )
}

/// What an agent learns in, or from.
fn place(config: &OnlineConfig) -> String {
    match &config.data {
        Some(data) => format!("on {}", data.path.display()),
        None => format!("in {}", config.env),
    }
}

/// Bytes, in megabytes or gigabytes.
fn size(bytes: u64) -> String {
    match bytes {
        ..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => gigabytes(bytes),
    }
}

/// A note where so many steps and bytes take more than half of the machine's memory.
fn memory([steps, bytes]: [u64; 2], machine_bytes: Option<u64>) -> Option<String> {
    let machine = machine_bytes.filter(|&machine| bytes > machine / 2)?;
    Some(format!(
        "steps that are learned from are in memory: {} once there are {steps}, of {} on this machine; a smaller \
         --set collect.capacity=STEPS online or, of images, --set image.size=PIXELS takes less",
        size(bytes),
        size(machine)
    ))
}

/// The first of some values: the mean return of an evaluation.
fn first(values: &[(String, f64)]) -> String {
    values.first().map_or("–".to_owned(), |(_, value)| short(*value))
}

fn text(state: &OnlineState, run: &str, is_collected: bool) -> String {
    if !is_collected {
        let steps = ("steps", state.step.to_string());
        return key_values(&[steps, ("loss", first(&state.train)), ("run", run.to_owned())]);
    }
    let best =
        state.best.map_or("–".to_owned(), |(step, value)| format!("{} at step {step}", short(value)));
    key_values(&[
        ("steps", state.step.to_string()),
        ("episodes", format!("{} in {run}/episodes.h5", state.episodes)),
        ("mean return", first(&state.evaluation)),
        ("best", best),
        ("run", run.to_owned()),
    ])
}

/// Shows the checkpoints of an online run.
pub(super) fn checkpoints(run: &RunFolder, output: &Output) -> Result<(), Failure> {
    let config = OnlineConfig::read(run).map_err(failure)?;
    let checkpoint = |step: u64| run.checkpoint::<OnlineState>(step).map_err(failure);
    let all: Vec<Checkpoint<OnlineState>> =
        run.steps().map_err(failure)?.into_iter().map(checkpoint).collect::<Result<_, _>>()?;
    let best = all.last().and_then(|last| last.state.best).map(|(step, _)| step);
    output.result(&json!({ "config": config, "checkpoints": all }), || {
        let row = |one: &Checkpoint<OnlineState>| {
            let mark = if Some(one.step) == best { "best" } else { "" };
            vec![
                one.step.to_string(),
                one.state.episodes.to_string(),
                first(&one.state.evaluation),
                mark.to_owned(),
                run.weights(one.step).display().to_string(),
            ]
        };
        let rows: Vec<Vec<String>> = all.iter().map(row).collect();
        let agent = &config.agent;
        let shown = table(&["step", "episodes", "mean return", "", "weights"], &rows);
        format!("{}, preset {}, {}\n\n{shown}", agent.agent, agent.preset, place(&config))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replay_buffer_that_takes_much_memory_is_told_before_it_does() {
        assert_eq!(memory([1_000, 7_000_000], Some(16_000_000_000)), None);
        assert_eq!(memory([1_000_000, 12_000_000_000], None), None);
        let note = memory([1_000_000, 12_300_000_000], Some(16_000_000_000)).unwrap();
        for part in ["12.3 GB once there are 1000000, of 16.0 GB", "collect.capacity", "image.size"] {
            assert!(note.contains(part), "{part}: {note}");
        }
    }
}
