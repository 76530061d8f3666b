//! A run in the reference's words.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json, json};
use swm_baselines::BaselineError;
use swm_baselines::online::{OnlineConfig, OnlineState, online_agent};
use swm_baselines::train::{Imported, RunConfig, RunFolder, Scale, State, Which, step_of};
use swm_tasks::evaluation::{Receipt, file_hash, read_receipt};
use swm_tasks::request::{Fix, Message, TaskError};
use swm_weights::{Saved, Stored, Values};

use super::backbone::Backbone;
use super::layout::{Layout, Unfit};
use super::names::Generation;
use super::{Export, joint, tdmpc2, tokens};

/// All that an export writes.
pub(super) struct Form {
    /// The model: a baseline, or an agent.
    pub(super) model: String,
    /// The step of the checkpoint.
    pub(super) step: u64,
    /// SHA-256 of its weights in the run.
    pub(super) run_sha256: String,
    /// `config.json`.
    pub(super) config: Json,
    /// `swm.json`.
    pub(super) notes_file: Json,
    /// The tensors of `weights.pt`.
    pub(super) tensors: Vec<Saved>,
    /// The folder of a frozen encoder that is not published.
    pub(super) backbone: Option<Backbone>,
    /// The version of transformers whose names the encoder's tensors have.
    pub(super) transformers: Option<usize>,
    /// What the card contains of sizes and use: a row each.
    pub(super) facts: Vec<(&'static str, String)>,
    /// How vectors are scaled, by column.
    pub(super) scales: BTreeMap<String, Scale>,
    /// The environment.
    pub(super) env: Option<String>,
    /// Parts of the run that are left out.
    pub(super) left_out: Vec<String>,
    /// What a user has to know.
    pub(super) notes: Vec<String>,
    /// Where the run's checkpoint is from, if it was imported.
    pub(super) imported: Option<Imported>,
    /// The dataset that it learned from, where the run names one.
    pub(super) dataset: Option<Trained>,
    /// An evaluation of it.
    pub(super) evaluation: Option<Evaluation>,
}

/// What a model learned from.
pub(super) struct Trained {
    pub(super) path: PathBuf,
    pub(super) episodes: usize,
    pub(super) rows: usize,
}

/// A receipt of the run's weights.
pub(super) struct Evaluation {
    pub(super) receipt: Receipt,
    /// SHA-256 of its file.
    pub(super) sha256: String,
}

impl Evaluation {
    /// The receipt at `path`, which must be of these weights.
    fn of(path: &Path, weights: &str) -> Result<Self, TaskError> {
        let receipt = read_receipt(path)?;
        if !receipt.files.values().any(|hash| hash == weights) {
            let text =
                format!("is of {}, whose files are not the weights of this checkpoint", receipt.policy);
            let message = Message::about("receipt", path.display().to_string(), text);
            return Err(message
                .fix(Fix::Any(vec![Fix::Change("receipt"), Fix::Change("checkpoint")]))
                .into());
        }
        let file = if path.is_dir() { path.join("receipt.json") } else { path.to_owned() };
        Ok(Self { receipt, sha256: file_hash(&file)? })
    }
}

impl Form {
    pub(super) fn of_run(request: &Export) -> Result<Self, TaskError> {
        let run = RunFolder::open(&request.run)?;
        let which: Which = request.checkpoint.parse().map_err(|reason| {
            TaskError::from(Message::about(
                "checkpoint",
                request.checkpoint.clone(),
                format!("is no checkpoint: {reason}"),
            ))
        })?;
        let form = match online_agent(&run)? {
            Some(_) => Self::of_agent(request, &run, which),
            None => Self::of_model(request, &run, which),
        };
        let mut form = form?;
        if let Some(path) = &request.receipt {
            form.evaluation = Some(Evaluation::of(path, &form.run_sha256)?);
        }
        Ok(form)
    }

    fn of_model(request: &Export, run: &RunFolder, which: Which) -> Result<Self, BaselineError> {
        let config = RunConfig::read(run)?;
        let step = step_of(run, which, |last| Ok(run.checkpoint::<State>(last)?.state.best))?;
        let checkpoint = run.checkpoint::<State>(step)?;
        let stored = swm_weights::read(&run.checked_weights(&checkpoint)?)?;
        let name = config.model_config.baseline.clone();
        let lacks = config.imported.as_ref().map_or(&[][..], |imported| &imported.lacks);
        let layout = match name.as_str() {
            "lewm" | "pldm" => joint::layout(&config.model_config, &stored),
            "dino-wm" => tokens::dino_wm(&config.model_config),
            "gcbc" | "gciql" | "gcivl" | "hilp" => tokens::goal(&config.model_config, &stored, lacks),
            _ => {
                Err(format!("a {name} is no model of stable-worldmodel, and its load_pretrained takes none")
                    .into())
            }
        };
        let layout = layout.map_err(|Unfit(reason)| no_form(run, &reason))?;
        let data = &config.data;
        let dataset = Some(Trained { path: data.path.clone(), episodes: data.episodes, rows: data.rows })
            .filter(|dataset| !dataset.path.as_os_str().is_empty());
        let noted = json!({
            "kind": name,
            "image": data.image,
            "env": data.env,
            "env_settings": data.env_settings,
            "frame_skip": data.frame_skip,
            "scales": data.scales,
            "set": config.model_config.settings,
        });
        let form = Self {
            model: name,
            step,
            run_sha256: checkpoint.weights,
            scales: data.scales.clone(),
            env: data.env.clone(),
            imported: config.imported,
            dataset,
            ..Self::empty(noted)
        };
        form.with(request, layout, stored).map_err(|Unfit(reason)| no_form(run, &reason))
    }

    fn of_agent(request: &Export, run: &RunFolder, which: Which) -> Result<Self, BaselineError> {
        let config = OnlineConfig::read(run)?;
        let step = step_of(run, which, |last| Ok(run.checkpoint::<OnlineState>(last)?.state.best))?;
        let checkpoint = run.checkpoint::<OnlineState>(step)?;
        let stored = swm_weights::read(&run.checked_weights(&checkpoint)?)?;
        let name = config.agent.agent.clone();
        let layout = match name.as_str() {
            "tdmpc2" => tdmpc2::layout(&config),
            _ => {
                Err(format!("a {name} is no model of stable-worldmodel, and its load_pretrained takes none")
                    .into())
            }
        };
        let layout = layout.map_err(|Unfit(reason)| no_form(run, &reason))?;
        let interface = &config.interface;
        let column = interface.columns.first().cloned();
        let scales: BTreeMap<String, Scale> = column.into_iter().zip(interface.scale.clone()).collect();
        let noted = json!({
            "kind": name,
            "image": interface.image,
            "env": config.env,
            "env_settings": config.env_settings,
            "frame_skip": config.data.as_ref().and_then(|data| data.frame_skip),
            "scales": scales,
            "set": config.agent.settings,
            "low": interface.low,
            "high": interface.high,
        });
        let env = Some(config.env).filter(|env| !env.is_empty());
        let (run_sha256, imported) = (checkpoint.weights, config.imported);
        let form = Self { model: name, step, run_sha256, scales, env, imported, ..Self::empty(noted) };
        form.with(request, layout, stored).map_err(|Unfit(reason)| no_form(run, &reason))
    }

    fn empty(noted: Json) -> Self {
        let mut notes_file: Map<String, Json> = Map::new();
        notes_file.insert("version".to_owned(), 1.into());
        if let Json::Object(noted) = noted {
            notes_file.extend(noted.into_iter().filter(|(_, value)| !value.is_null()));
        }
        Self {
            model: String::new(),
            step: 0,
            run_sha256: String::new(),
            config: Json::Null,
            notes_file: notes_file.into(),
            tensors: Vec::new(),
            backbone: None,
            transformers: None,
            facts: Vec::new(),
            scales: BTreeMap::new(),
            env: None,
            left_out: Vec::new(),
            notes: Vec::new(),
            imported: None,
            dataset: None,
            evaluation: None,
        }
    }

    /// With tensors and config under the reference's names.
    fn with(
        mut self,
        request: &Export,
        layout: Layout,
        mut stored: BTreeMap<String, Stored>,
    ) -> Result<Self, Unfit> {
        let given = request.transformers.and_then(Generation::of);
        let imported = self.imported.as_ref().and_then(|imported| Generation::named(&imported.names));
        let generation = given.or(imported).unwrap_or(Generation::Four);
        let is_left_out = |name: &str| layout.left_out.iter().find(|part| name.starts_with(**part));
        for name in stored.keys() {
            let part = is_left_out(name).map(|part| part.trim_end_matches('.').to_owned());
            self.left_out.extend(part.filter(|part| !self.left_out.contains(part)));
        }
        stored.retain(|name, _| is_left_out(name).is_none());
        if let Some(config) = layout.backbone {
            self.backbone = Some(Backbone::new(config, layout.encoder.as_ref(), &stored));
        }
        for (name, Stored { shape, values, .. }) in stored {
            let renamed = match &layout.encoder {
                Some(encoder) if name.starts_with(encoder.prefix) => encoder.theirs(&name, generation),
                _ => of_prefixes(&name, &layout.renamed),
            };
            self.tensors.push((renamed, shape, Values::Floats(values)));
        }
        self.tensors.extend(layout.added);
        self.tensors.sort_by(|(one, ..), (other, ..)| one.cmp(other));
        self.transformers = layout.encoder.map(|_| generation.version());
        (self.config, self.facts, self.notes) = (layout.config, layout.facts, layout.notes);
        Ok(self)
    }
}

/// A name with the first beginning that is in the table exchanged.
fn of_prefixes(name: &str, renamed: &[(String, String)]) -> String {
    let new = renamed
        .iter()
        .find_map(|(ours, theirs)| Some(format!("{theirs}{}", name.strip_prefix(ours.as_str())?)));
    new.unwrap_or_else(|| name.to_owned())
}

fn no_form(run: &RunFolder, reason: &str) -> BaselineError {
    BaselineError::Run { path: run.path().to_owned(), reason: format!("it cannot be exported: {reason}") }
}
