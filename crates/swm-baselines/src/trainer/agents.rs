//! Agents that learn online or from the steps of a dataset.

use std::path::Path;

use swm_core::{BoxError, Registry};
use swm_tasks::memory::machine_bytes;
use swm_tasks::request::{
    Assignment, Fix, Message, Report, TaskError, Train, Trained, apart, open_dataset_with,
};
use swm_tasks::threads::within;

use super::memory::{size, steps_note};
use super::shown::{Pace, Shown, many, short};
use super::{failed, interrupted};
use crate::online::{AGENTS, NewOnlineRun, OnlineConfig, OnlineSettings, OnlineState, OnlineTraining};
use crate::train::End;

/// Trains an agent, or resumes its run.
pub(super) fn train(
    request: &Train,
    registry: &Registry,
    report: &mut dyn Report,
) -> Result<Trained, TaskError> {
    let (run, device) = (request.folder(), request.device.parse().map_err(failed)?);
    let mut training = if request.resume.is_some() {
        let moved = request.dataset.as_deref();
        let resume = || OnlineTraining::resume(registry, run, device, moved, |fit| apply(request, fit));
        apart(report, resume)?
    } else {
        let mut fit = OnlineSettings::default();
        apply(request, &mut fit);
        let agent = request.baseline.as_str();
        let of_agent = AGENTS.iter().find(|entry| entry.name == agent);
        let first = of_agent.map_or("", |entry| entry.presets[0]);
        let preset = request.preset.as_deref().unwrap_or(first);
        let (changes, env_settings) = (request.changes()?, request.env_option.clone());
        let new =
            NewOnlineRun { agent, preset, changes, env_settings, observe: &request.observe, fit, device };
        match &request.dataset {
            Some(data) => {
                let dataset = open_dataset_with(registry, data, &request.opening)?;
                apart(report, move || {
                    let dataset = dataset;
                    OnlineTraining::create_on(run, dataset.as_ref(), &new)
                })?
            }
            None => {
                let env = registry.env(request.env.as_deref().unwrap_or_default()).map_err(BoxError::from)?;
                apart(report, || OnlineTraining::create(run, env, &new))?
            }
        }
    }
    .map_err(failed)?;
    report.info(&Message::new(beginning(&training)));
    if let Some(note) = steps_note(training.buffer_size(), machine_bytes()) {
        report.note(&note);
    }
    let done = training.done().map_err(failed)?;
    let (total, is_collected) = (training.config().fit.steps, training.config().data.is_none());
    let pace = if is_collected { Pace::EnvSteps } else { Pace::Clips };
    let shown = Shown::begin(report, run, pace, false, [done, total])?;
    let cancel = report.cancel();
    let state = apart(report, || within(request.threads, || training.run(vec![Box::new(shown)], &cancel)))??;
    let state = state.map_err(failed)?;
    if state.end == Some(End::Interrupted) {
        return Err(interrupted());
    }
    if state.step == done {
        let more = Fix::Set { setting: Assignment::name("steps"), to: "beyond them to continue it" };
        report.info(&Message::new(format!("finished before: {done} steps are done")).fix(more));
    }
    let summary = summary(&state, run, is_collected);
    Ok(Trained::new(run, summary, serde_json::to_value(&state).map_err(BoxError::from)?))
}

/// The settings that were given.
fn apply(request: &Train, fit: &mut OnlineSettings) {
    let Train {
        steps, seed, log_every, keep, max_steps, eval_every, checkpoint_every, eval_episodes, ..
    } = *request;
    fit.steps = steps.unwrap_or(fit.steps);
    fit.seed = seed.unwrap_or(fit.seed);
    fit.log_every = log_every.unwrap_or(fit.log_every);
    fit.keep = keep.unwrap_or(fit.keep);
    fit.max_episode_steps = max_steps.unwrap_or(fit.max_episode_steps);
    fit.eval_every = eval_every.or(checkpoint_every).unwrap_or(fit.eval_every);
    fit.eval_episodes = eval_episodes.unwrap_or(fit.eval_episodes);
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
        training.config().place(),
        observed.join(" and "),
        size(bytes),
    )
}

fn summary(state: &OnlineState, run: &Path, is_collected: bool) -> Vec<(&'static str, String)> {
    let first =
        |values: &[(String, f64)]| values.first().map_or("–".to_owned(), |(_, value)| short(*value));
    let shown = run.display().to_string();
    let steps = ("steps", state.step.to_string());
    if !is_collected {
        return vec![steps, ("loss", first(&state.train)), ("run", shown)];
    }
    let best =
        state.best.map_or("–".to_owned(), |(step, value)| format!("{} at step {step}", short(value)));
    vec![
        steps,
        ("episodes", format!("{} in {shown}/episodes.h5", state.episodes)),
        ("mean return", first(&state.evaluation)),
        ("best", best),
        ("run", shown),
    ]
}
