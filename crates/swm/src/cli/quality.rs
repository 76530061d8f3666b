//! `swm quality`: a world model, evaluated without control.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, Value as Json};
use swm_core::evaluate::quality::WorldModel;
use swm_core::evaluate::{ModelEntry, StateModel, Violation, random_episodes};
use swm_core::{Batch, EnvConfig, EnvEntry, EnvSpec, PolicyArgs, PolicyContext, Registry};
use swm_tasks::request::{Ask, note_training_of};

use super::args::{EnvArgs, ImageArg, policy_args};
use super::opening::DataArgs;
use super::output::{compact, table};
use super::quality_checks::{check_horizon, check_lengths, check_probe, check_violation};
use super::threads::ThreadsArg;
use super::{Failure, Output, images, inputs, usage};
use crate::evaluation::{
    GateCheck, ImageModel, ProbeScore, ProbeTarget, Quality, QualityOptions, measurements, quality,
    recorded_episodes, task_probes,
};

/// Most starts of the ranking: its mean hardly changes with more.
const STARTS: usize = 50;

/// Evaluate a world model without control: open-loop prediction, probes of the state, ranking of plans, violation of expectation.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm quality swm/TwoRoom-v2 --violation teleport
  swm quality swm/PushT-v1 --model gain=0.8 --violation teleport --violation state[2,3]=-500,-500 --violation block.color
  swm quality swm/PushT-v1 --model pixels=8 --image-size 64 --episodes 100 --probe state
  swm quality swm/PushT-v1 --dataset pusht.h5 --episodes 200 --rows 100 --model constant --json
  swm quality swm/TwoRoom-v1 --dataset two-room.h5 --model lewm:runs/lewm   (of `swm train`, in builds with baselines)

Models that need no training are for comparison: `true` (the environment in its standardized state space), `gain=G` (the same with actions \
multiplied by G), `constant` (nothing ever changes), and `pixels=C` (the image in C × C cells, and nothing ever changes). \
World models that a plugin registers are measured by their names. \
Trained ones are `lewm:RUN`, `pldm:RUN`, `conv-jepa:RUN`, `dino-wm:RUN`, `keypoint-wm:RUN` (`checkpoint=best` behind a comma), which predict as many steps at a \
time as the frame skip that they were trained with. \
Probes predict columns of the true state from latents: a linear one and a small MLP, fitted to four fifths of the episodes and \
scored on the others. The gate says what a model should reach before plans are made on it: an R² of 0.8 of all that is probed, a rank correlation of 0.85. A violation is `teleport`, COLUMN[ELEMENTS]=VALUES for something that \
jumps or vanishes, or the name of a factor, which changes. An accuracy of 0.5 is chance.")]
pub(super) struct QualityCommand {
    #[command(flatten)]
    env: EnvArgs,
    /// The model: true, constant, gain=G, pixels=C, or a trained one: lewm:RUN.
    #[arg(long, default_value = "true")]
    model: String,
    /// Take the episodes for prediction and probes from this dataset. Without it, they are simulated with random actions.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// Size of the images that the model sees, or `none`. Default: that of its training, the dataset's, or none.
    #[arg(long)]
    image_size: Option<ImageArg>,
    /// What to probe latents for: COLUMN, COLUMN[0,1] or angle(COLUMN[4]); may be repeated. Default: what the moderate
    /// tier's test of success reads, else the environment's start columns; `none`: no probes.
    #[arg(long = "probe", value_name = "COLUMN")]
    probes: Vec<String>,
    /// An impossible event; may be repeated.
    #[arg(long = "violation", value_name = "WHAT", default_value = "teleport")]
    violations: Vec<String>,
    /// Episodes; also pairs per violation and, up to 50, starts of the ranking. Probes need 100 or more episodes where what they
    /// predict changes little within one.
    #[arg(long, default_value_t = QualityOptions::default().episodes)]
    episodes: usize,
    /// Steps per episode; of recorded ones the first.
    #[arg(long, default_value_t = QualityOptions::default().rows)]
    rows: usize,
    /// Steps of open-loop prediction, and actions of a plan.
    #[arg(long, default_value_t = QualityOptions::default().horizon)]
    horizon: usize,
    /// Plans per start. Each follows the recorded actions up to some step and takes random ones after it.
    #[arg(long, default_value_t = QualityOptions::default().plans)]
    plans: usize,
    /// Seed of episodes, plans and probes.
    #[arg(long, default_value_t = QualityOptions::default().seed)]
    seed: u64,
    #[command(flatten)]
    opening: DataArgs,
    #[command(flatten)]
    pub(super) threads: ThreadsArg,
}

impl QualityCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Self { episodes, rows, horizon, plans, seed, .. } = self;
        for (option, value, least) in
            [("episodes", episodes, 1), ("horizon", horizon, 1), ("plans", plans, 2)]
        {
            if value < least {
                return Err(usage(format!("--{option} {value}: use {least} or more")));
            }
        }
        if rows <= horizon {
            return Err(usage(format!("--rows {rows}: use more than --horizon, which is {horizon}")));
        }
        let entry = self.env.entry(registry)?;
        let trained = trained(registry, &self.model)?;
        let violations: Vec<(String, Violation)> = self
            .violations
            .iter()
            .map(|text| Ok((text.clone(), violation(text)?)))
            .collect::<Result<_, Failure>>()?;
        let named: Vec<ProbeTarget> = self
            .probes
            .iter()
            .filter(|text| *text != "none")
            .map(|text| text.parse().map_err(|reason| usage(format!("--probe {reason}"))))
            .collect::<Result<_, _>>()?;
        let how = self.opening.options_of(self.dataset.as_ref())?;
        let open = |path| inputs::open_with(registry, path, &how);
        let dataset = self.dataset.as_deref().map(open).transpose()?;
        if let Some(dataset) = &dataset {
            inputs::check_env(dataset.as_ref(), entry, None)?;
        }
        let metadata = dataset.as_ref().and_then(|dataset| dataset.metadata()).cloned().unwrap_or_default();
        let of_model = || trained.as_ref().and_then(|(entry, args)| entry.image_size(args));
        let image = self.image_size.map_or_else(|| of_model().or(metadata.image), |size| size.0);
        let config =
            self.env.config_like(if dataset.is_some() { metadata.settings } else { Map::new() }, image)?;
        let mut dataset = match (dataset, image) {
            (Some(blind), Some(size)) if !images::holds_images(blind.as_ref()) => {
                Some(images::rendered(blind, registry, size, BTreeMap::new())?)
            }
            (dataset, _) => dataset,
        };
        let mut env = entry.make(&config)?;
        let learned = match &trained {
            Some((model, args)) => {
                let context = PolicyContext::new(entry, &config).within(registry);
                // The steps of a dataset are as far apart as they are.
                let settings = model.trained_in(args).map(|trained| trained.frame_skip(None));
                note_training_of(args, settings.as_ref(), &context, Ask::Here, &mut &*output);
                Some(model.make(&context, args)?)
            }
            None => None,
        };
        if let Some(model) = &learned {
            check_horizon(horizon, model.stride())?;
        }
        violations.iter().try_for_each(|(_, violation)| check_violation(violation, env.spec()))?;
        let bar = output.bar(1 + measurements(&violations), "parts done");
        bar.set_message("now the episodes");
        let recorded = match &mut dataset {
            Some(dataset) => recorded_episodes(env.as_ref(), dataset, episodes, rows)?,
            None => random_episodes(env.as_mut(), episodes, rows, seed)?,
        };
        named.iter().try_for_each(|target| check_probe(target, &recorded))?;
        check_lengths(horizon, &recorded)?;
        let mut model = match learned {
            Some(model) => model,
            None => yardstick(&self.model, entry, &config, &recorded)?,
        };
        let probed: Vec<ProbeTarget> = match self.probes.as_slice() {
            // One episode leaves nothing to score on.
            [] if recorded.len() < 2 => Vec::new(),
            [] => default_probes(env.spec(), &config.settings, &recorded),
            [none] if none == "none" => Vec::new(),
            _ => named,
        };
        let options = QualityOptions { episodes, starts: episodes.min(STARTS), rows, horizon, plans, seed };
        let begins = |name: &str| {
            bar.inc(1);
            bar.set_message(format!("now {name}"));
        };
        let (model, env) = (model.as_mut(), env.as_mut());
        let found = quality(model, env, &recorded, &probed, &violations, &options, begins);
        bar.finish_and_clear();
        let found = found?;
        if let Some(note) = few_episodes(&found, recorded.len()) {
            output.note(note);
        }
        output.result(&found, || text(entry.id, &self.model, &found))
    }
}

/// Episodes from which on probes are fitted to enough rows: a fifth of them is held out.
const ENOUGH: usize = 100;

/// A note where a probe misses the gate, and the reason may be that it was fitted to few episodes.
fn few_episodes(found: &Quality, episodes: usize) -> Option<String> {
    let probe_fails = found.gate.iter().take(found.probes.len()).any(|check| !check.passes);
    (probe_fails && episodes < ENOUGH).then(|| {
        format!(
            "note: probes were fitted to {}, which may be too few to reach the gate; --episodes {ENOUGH} says more",
            super::output::counted(episodes as u64, "episode")
        )
    })
}

/// What is probed unless something is named: what decides on success, where that is known and in the rows.
pub(super) fn default_probes(
    spec: &EnvSpec,
    settings: &Map<String, Json>,
    recorded: &[Batch],
) -> Vec<ProbeTarget> {
    let deciding = task_probes(&spec.id, settings);
    let is_there =
        |target: &ProbeTarget| recorded.iter().all(|rows| rows.schema().index(&target.column).is_some());
    match !deciding.is_empty() && deciding.iter().all(is_there) {
        true => deciding,
        false => spec.start_columns.iter().map(|&column| column.into()).collect(),
    }
}

/// A model of the registry, where `--model` names one: `lewm:RUN`.
fn trained(registry: &Registry, name: &str) -> Result<Option<(&'static ModelEntry, PolicyArgs)>, Failure> {
    if !name.contains(':') && registry.find::<ModelEntry>(name).is_err() {
        if name.starts_with("pixels=") || gain(name).is_ok() {
            return Ok(None);
        }
        let known: Vec<&str> = registry.all::<ModelEntry>().map(|entry| entry.name).collect();
        let others = match known.is_empty() {
            true => "trained ones such as lewm:RUN".to_owned(),
            false => format!("models of the registry: {}", known.join(", ")),
        };
        return Err(usage(format!(
            "--model {name}: there are true, constant, gain=NUMBER, pixels=CELLS, and {others}"
        )));
    }
    let args = policy_args(name)?;
    match registry.find::<ModelEntry>(&args.name) {
        Ok(entry) => Ok(Some((entry, args))),
        Err(_) if registry.all::<ModelEntry>().next().is_none() => Err(usage(format!(
            "--model {name}: trained models such as {} need a build with the feature `baselines`",
            args.name
        ))),
        Err(unknown) => Err(unknown.into()),
    }
}

/// A model that needs no training.
fn yardstick(
    name: &str,
    entry: &EnvEntry,
    config: &EnvConfig,
    recorded: &[Batch],
) -> Result<Box<dyn WorldModel>, Failure> {
    let cells = name.strip_prefix("pixels=").map(str::parse::<usize>);
    match cells {
        Some(Ok(cells)) if cells > 0 && config.image.is_none() => Err(usage(format!(
            "--model {name} sees images, and there are none of {cells} cells; give --image-size"
        ))),
        Some(Ok(cells)) if cells > 0 => Ok(Box::new(ImageModel::new(cells))),
        _ => Ok(Box::new(StateModel::new(entry, config, gain(name)?)?.standardized(recorded)?)),
    }
}

/// What actions are multiplied by in a model; none if nothing ever changes.
fn gain(model: &str) -> Result<Option<f64>, Failure> {
    match (model, model.strip_prefix("gain=").map(str::parse::<f64>)) {
        ("true", _) => Ok(Some(1.0)),
        ("constant", _) => Ok(None),
        (_, Some(Ok(gain))) if gain.is_finite() => Ok(Some(gain)),
        _ => Err(usage(format!(
            "--model {model}: there are true, constant, gain=NUMBER, pixels=CELLS, and trained ones such as lewm:RUN"
        ))),
    }
}

fn violation(text: &str) -> Result<Violation, Failure> {
    if text == "teleport" {
        return Ok(Violation::Teleport);
    }
    let Some((left, right)) = text.split_once('=') else {
        return Ok(Violation::Factor { name: text.to_owned() });
    };
    let wrong =
        || usage(format!("--violation {text}: write COLUMN[ELEMENTS]=VALUES, such as state[2,3]=-500,-500"));
    let (column, elements) =
        left.strip_suffix(']').and_then(|left| left.split_once('[')).ok_or_else(wrong)?;
    let elements: Result<Vec<usize>, _> = elements.split(',').map(|number| number.trim().parse()).collect();
    let to: Result<Vec<f64>, _> = right.split(',').map(|number| number.trim().parse()).collect();
    match (elements, to) {
        (Ok(elements), Ok(to)) => Ok(Violation::Set { column: column.to_owned(), elements, to }),
        _ => Err(wrong()),
    }
}

fn text(env: &str, model: &str, found: &Quality) -> String {
    let mut text = format!("{env}, model `{model}`\n\n");
    text += &diagnosis(found);
    let probes: Vec<Vec<String>> = found
        .probes
        .iter()
        .map(|probed| {
            let none = || ["–", "–"].map(str::to_owned);
            let [line, line_correlation] = probed.linear.as_ref().map_or_else(none, told);
            let [network, network_correlation] = told(&probed.network);
            vec![probed.column.clone(), line, line_correlation, network, network_correlation]
        })
        .collect();
    if !probes.is_empty() {
        let head =
            ["probed column", "linear: unexplained", "correlation", "network: unexplained", "correlation"];
        text += "\n";
        text += &table(&head, &probes);
    }
    let rows: Vec<Vec<String>> = found
        .violations
        .iter()
        .map(|violation| {
            let [possible, impossible] = violation.surprise.map(compact);
            let accuracy = violation.accuracy.map_or("–".to_owned(), |accuracy| format!("{accuracy:.2}"));
            vec![violation.name.clone(), accuracy, possible, impossible]
        })
        .collect();
    text + "\n" + &table(&["violation", "accuracy", "surprise if possible", "if impossible"], &rows)
}

/// The gate, then errors of prediction: what is asked before a plan is made.
fn diagnosis(found: &Quality) -> String {
    let check = |check: &GateCheck| {
        let found = check.found.map_or("–".to_owned(), |found| format!("{found:.3}"));
        let passes = if check.passes { "passes" } else { "fails" };
        vec![check.name.clone(), found, format!("{} or more: {passes}", check.least)]
    };
    let errors = (1..).zip(&found.open_loop_error).map(|(step, error): (usize, _)| {
        let share = found.open_loop_unexplained.get(step - 1);
        let share = share.map_or("–".to_owned(), |share| format!("{share:.3}"));
        vec![(step * found.stride).to_string(), compact(*error), share]
    });
    let gate: Vec<Vec<String>> = found.gate.iter().map(check).collect();
    let (passed, all) = (found.gate.iter().filter(|check| check.passes).count(), found.gate.len());
    let verdict = match all {
        0 => String::new(),
        _ => format!(
            "{}\n{passed} of {all} requirements of the gate are met\n\n",
            table(&["measure", "result", "gate"], &gate)
        ),
    };
    verdict + &table(&["steps ahead", "squared error", "of the variance"], &errors.collect::<Vec<_>>())
}

/// Unexplained share of the variance, and mean correlation.
fn told(score: &ProbeScore) -> [String; 2] {
    [score.unexplained, score.mean_correlation()]
        .map(|number| number.map_or("–".to_owned(), |number| format!("{number:.4}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_and_violations_are_read() {
        assert_eq!(gain("gain=0.5").ok(), Some(Some(0.5)));
        assert_eq!(gain("constant").ok(), Some(None));
        assert!(gain("gain=x").is_err() && gain("best").is_err());
        let set = Violation::Set { column: "state".to_owned(), elements: vec![2, 3], to: vec![-5.0, 1.5] };
        assert_eq!(violation("state[2,3]=-5,1.5").ok(), Some(set));
        assert_eq!(violation("block.color").ok(), Some(Violation::Factor { name: "block.color".to_owned() }));
        assert!(violation("state=3").is_err() && violation("state[a]=3").is_err());
    }
}
