//! A world model is measured without control: prediction, probes, ranking of plans, violation of expectation.

mod checks;
mod models;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use serde_json::{Map, Value as Json};
use swm_core::evaluate::random_episodes;
use swm_core::{EnvConfig, PolicyContext, Registry, WorldError};
use swm_data::OpenOptions;
use swm_data::adapt::Watched;

use super::copies::{ended, holds_images};
use super::source::{check_opening, check_recorded_in, open_dataset_with, rendered};
use super::{
    Ask, Fix, ImageChoice, Message, Report, Request, Stage, TaskError, apart, must_be_given, note_training_of,
};
use crate::evaluation::{
    ProbeTarget, Quality, QualityOptions, default_probes, measurements, quality, recorded_episodes,
};
use crate::threads::{self, within};
use checks::{check_horizon, check_lengths, check_probe, check_violation};
use models::{trained, violation, yardstick};

/// Most starts of the ranking: its mean hardly changes with more.
const STARTS: usize = 50;
/// Episodes from which on probes are fitted to enough rows: a fifth of them is held out.
const ENOUGH: usize = 100;

swm_core::settings! {
    /// Measure a world model without control.
    pub struct Measure {
        /// The environment's id.
        env: String = String::new() => "must be given",
        /// Settings of the environment, by name.
        ///
        /// They are laid over those of the dataset.
        env_option: Map<String, Json> = Map::new() => "none",
        /// The model: true, constant, gain=G, pixels=C, or a trained one: lewm:RUN.
        model: String = "true".to_owned() => "true",
        /// Take the episodes for prediction and probes from this dataset.
        dataset: Option<PathBuf> = None => "simulated with random actions",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// Size of the images that the model sees.
        image_size: Option<ImageChoice> = None => "that of its training, the dataset's, or none",
        /// What to probe latents for: COLUMN, COLUMN[0,1] or angle(COLUMN[4]); `none`: no probes.
        probe: Vec<String> = Vec::new() => "what the moderate tier's test of success reads, else the start columns",
        /// Impossible events: `teleport`, COLUMN[ELEMENTS]=VALUES, or the name of a factor, which changes.
        violation: Vec<String> = vec!["teleport".to_owned()] => "teleport",
        /// Episodes; also pairs per violation and, up to 50, starts of the ranking.
        episodes: usize = QualityOptions::default().episodes => "20",
        /// Steps per episode; of recorded ones the first.
        rows: usize = QualityOptions::default().rows => "30",
        /// Steps of open-loop prediction, and actions of a plan.
        horizon: usize = QualityOptions::default().horizon => "10",
        /// Plans per start.
        ///
        /// Each follows the recorded actions up to some step and takes random ones after it.
        plans: usize = QualityOptions::default().plans => "64",
        /// Seed of episodes, plans and probes.
        seed: u64 = QualityOptions::default().seed => "42",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
    }
}

impl Request for Measure {
    const NAME: &'static str = "measure";
    type Outcome = Quality;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("env", self.env.is_empty())])?;
        for (name, value, least) in
            [("episodes", self.episodes, 1), ("horizon", self.horizon, 1), ("plans", self.plans, 2)]
        {
            if value < least {
                return Err(Message::about(name, value, format!("use {least} or more")).into());
            }
        }
        if self.rows <= self.horizon {
            let text = format!("use more than the horizon, which is {}", self.horizon);
            return Err(Message::about("rows", self.rows, text).into());
        }
        threads::check(self.threads)?;
        registry.env(&self.env)?;
        trained(registry, &self.model)?;
        self.violation.iter().try_for_each(|text| violation(text).map(drop))?;
        self.named_probes()?;
        check_opening(self.dataset.is_some(), &self.opening)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Quality, TaskError> {
        self.check(registry)?;
        let entry = registry.env(&self.env)?;
        let trained = trained(registry, &self.model)?;
        let violations = self.violation.iter().map(|text| Ok((text.clone(), violation(text)?)));
        let violations: Vec<_> = violations.collect::<Result<_, TaskError>>()?;
        let named = self.named_probes()?;
        let open = |path| open_dataset_with(registry, path, &self.opening);
        let dataset = self.dataset.as_deref().map(open).transpose()?;
        if let Some(dataset) = &dataset {
            check_recorded_in(dataset.as_ref(), entry, None)?;
        }
        let metadata = dataset.as_ref().and_then(|dataset| dataset.metadata()).cloned().unwrap_or_default();
        let of_model = || trained.as_ref().and_then(|(entry, args)| entry.image_size(args));
        let image = self.image_size.map_or_else(|| of_model().or(metadata.image), |size| size.0);
        let mut settings = if dataset.is_some() { metadata.settings } else { Map::new() };
        settings.extend(self.env_option.clone());
        let config = EnvConfig { image, settings };
        let dataset = match (dataset, image) {
            (Some(blind), Some(size)) if !holds_images(blind.as_ref()) => {
                Some(rendered(blind, registry, size)?)
            }
            (dataset, _) => dataset,
        };
        let mut env = entry.make(&config)?;
        let learned = match &trained {
            Some((model, args)) => {
                let context = PolicyContext::new(entry, &config).within(registry);
                // The steps of a dataset are as far apart as they are.
                let settings = model.trained_in(args).map(|trained| trained.frame_skip(None));
                note_training_of(args, settings.as_ref(), &context, Ask::Here, report);
                Some(model.make(&context, args)?)
            }
            None => None,
        };
        if let Some(model) = &learned {
            check_horizon(self.horizon, model.stride())?;
        }
        violations.iter().try_for_each(|(_, violation)| check_violation(violation, env.spec()))?;
        let total = 1 + measurements(&violations);
        let stage = Stage { name: &self.model, role: None, unit: "parts done", total };
        let progress = report.begin(&stage)?;
        progress.now("now the episodes");
        let Self { episodes, rows, horizon, plans, seed, .. } = *self;
        let cancel = report.cancel();
        let mut dataset = dataset.map(|dataset| Watched::new(dataset, cancel.clone()));
        let record = || match &mut dataset {
            Some(dataset) => recorded_episodes(env.as_ref(), dataset, episodes, rows),
            None => Ok(random_episodes(env.as_mut(), episodes, rows, seed, &cancel)?),
        };
        let recorded = apart(report, || within(self.threads, record))??;
        let recorded = recorded.map_err(|error| ended(error, report))?;
        named.iter().try_for_each(|target| check_probe(target, &recorded))?;
        check_lengths(self.horizon, &recorded)?;
        let mut model = match learned {
            Some(model) => model,
            None => yardstick(&self.model, entry, &config, &recorded)?,
        };
        let probed = match self.probe.as_slice() {
            // One episode leaves nothing to score on.
            [] if recorded.len() < 2 => Vec::new(),
            [] => default_probes(env.spec(), &config.settings, &recorded),
            _ => named,
        };
        let options = QualityOptions { episodes, starts: episodes.min(STARTS), rows, horizon, plans, seed };
        let begins = |name: &str| {
            if cancel.is_cancelled() {
                return Err(WorldError::Cancelled.into());
            }
            progress.done(None);
            progress.now(&format!("now {name}"));
            Ok(())
        };
        let (model, env) = (model.as_mut(), env.as_mut());
        let measure = || quality(model, env, &recorded, &probed, &violations, &options, begins);
        let found = apart(report, || within(self.threads, measure))???;
        progress.done(None);
        if let Some(note) = few_episodes(&found, recorded.len()) {
            report.note(&note);
        }
        Ok(found)
    }
}

impl Measure {
    /// The probes that are named.
    fn named_probes(&self) -> Result<Vec<ProbeTarget>, TaskError> {
        let named = self.probe.iter().filter(|text| *text != "none" || self.probe.len() > 1);
        named.map(|text| Ok(text.parse::<ProbeTarget>().map_err(wrong_probe)?)).collect()
    }
}

/// Why something cannot be probed for.
fn wrong_probe(reason: impl std::fmt::Display) -> Message {
    Message::about_setting("probe", reason.to_string())
}

/// A note where a probe misses the gate, and the reason may be that it was fitted to few episodes.
fn few_episodes(found: &Quality, episodes: usize) -> Option<Message> {
    let probe_fails = found.gate.iter().take(found.probes.len()).any(|check| !check.passes);
    (probe_fails && episodes < ENOUGH).then(|| {
        let text =
            format!("probes were fitted to few episodes ({episodes}), perhaps too few to reach the gate");
        Message::new(text).fix(Fix::set_to("episodes", ENOUGH, "to find out"))
    })
}
