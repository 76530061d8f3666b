//! Trained models by name: `mpc:RUN,solver=icem,samples=200`, `policy:RUN`, `gcbc:RUN`.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::Deserialize as _;
use serde_json::{Map, Value as Json};
use swm_core::registry::{MakePolicy, Setting, TrainedIn, TrainedOn};
use swm_core::settings::{Table, WrongSetting, text};
use swm_core::{ImageSize, Metadata, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError};
use swm_solvers::{Aggregate, LearnedCost, SOLVER_SETTING, on_true_dynamics, plan_on};

use super::agent_policy::AgentPolicy;
use super::cost::{self, ModelCost};
use super::goal_policy::ModelPolicy;
use crate::baseline::Baseline;
use crate::device::Device;
use crate::error::BaselineError;
use crate::models::table::restore;
use crate::online::{OnlineConfig, TrainedAgent, find_agent, tdmpc2};
use crate::precision::Precision;
use crate::train::{RunConfig, RunFolder, TrainedModel, Which};

/// Policies for every environment that shows images.
pub const POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new(
        "mpc",
        "plans on a trained world model (`mpc:RUN,solver=cem`), with the settings of the solver and of the plan",
        |context, args| {
            let mut given = Given::of(args)?;
            let model = given.model(args, context.env.id)?;
            let aggregate = aggregate(args, given.rest.shift_remove(AGGREGATE.name))?;
            let cost = ModelCost::new(model).map_err(|error| given.wrong(args, error))?;
            let cost = cost.with_aggregate(aggregate);
            check_history(args, &given.rest, cost.history())?;
            let (action_block, scale) = (cost.action_block(), Some(cost.action_scale()));
            with_defaults(&mut given.rest, cost.plan_settings());
            let learned = LearnedCost::new(Box::new(cost), action_block).scaled(scale).with_settings(OF_PLANNERS);
            let policy = plan_on(context, learned, given.rest);
            Ok(Box::new(policy.map_err(|error| args.wrong(error.to_string()))?))
        },
    )
    .settings(&[RUN, CHECKPOINT, DEVICE, PRECISION, TRANSFER, AGGREGATE, SOLVER_SETTING])
    .image(image_size)
    .trained(trained_in)
    .files(model_files)
    .companions(model_companions)
    .oracle(|context, args| {
        let mut given = Given::of(args).ok()?;
        if let Ok(model) = untrained(&given.run) {
            with_defaults(&mut given.rest, model.plan_settings());
            let block = Json::from(model.input_spec().frameskip);
            with_defaults(&mut given.rest, Map::from_iter([("action_block".to_owned(), block)]));
        }
        on_true_dynamics(context, given.rest)
    }),
    acting("policy", "acts as a trained goal-conditioned policy says (`policy:RUN`)", |context, args| {
        model_policy(context, args, None)
    }),
    acting("gcbc", "a trained GCBC (`gcbc:RUN`)", |context, args| model_policy(context, args, Some("gcbc"))),
    acting("gcivl", "a trained GCIVL (`gcivl:RUN`)", |context, args| {
        model_policy(context, args, Some("gcivl"))
    }),
    acting("gciql", "a trained GCIQL (`gciql:RUN`)", |context, args| {
        model_policy(context, args, Some("gciql"))
    }),
    acting("gcsl", "a trained GCSL (`gcsl:RUN`)", |context, args| model_policy(context, args, Some("gcsl"))),
    acting("hilp", "a trained HILP (`hilp:RUN`)", |context, args| model_policy(context, args, Some("hilp"))),
    agent("sac", "acts as an agent trained by `swm train sac` (`sac:RUN`)", OF_AGENTS),
    agent("tdmpc2", "plans as an agent trained by `swm train tdmpc2` (`tdmpc2:RUN`)", OF_TDMPC2.as_slice()),
];

const OF_AGENTS: &[Setting] = &[RUN, CHECKPOINT, DEVICE, TRANSFER];
const OF_TDMPC2: &Table = &Table::of(&[OF_AGENTS, tdmpc2::OPTIONS]);

const RUN: Setting = Setting::new("RUN", "Folder of a training run", "required");
const CHECKPOINT: Setting = Setting::new("checkpoint", "Which checkpoint: last, best, or a step", "last");
const DEVICE: Setting = Setting::new("device", "Device: cpu, cuda, cuda:1 …", "cpu");
const PRECISION: Setting =
    Setting::new("precision", "Precision of linear layers and attention: fp32, bf16", "fp32");
const TRANSFER: Setting = Setting::new("transfer", "Accept a run of another environment", "false");
/// What all policies of trained models know by name.
const OF_MODELS: &[Setting] = &[CHECKPOINT, DEVICE, PRECISION, TRANSFER];

/// And what those that plan know.
const OF_PLANNERS: &[Setting] = &[CHECKPOINT, DEVICE, TRANSFER, AGGREGATE];
/// The oracle's setting, too.
const AGGREGATE: Setting = Setting::new(
    cost::AGGREGATE,
    "Cost of a plan: last, mean or best distance of its predicted states from the goal",
    "last",
);

/// Adds what was not given.
fn with_defaults(given: &mut Map<String, Json>, defaults: Map<String, Json>) {
    for (name, value) in defaults {
        given.entry(name).or_insert(value);
    }
}

/// Refuses a longer history than the model sees.
fn check_history(args: &PolicyArgs, given: &Map<String, Json>, longest: usize) -> Result<(), PolicyError> {
    match given.get("history_len").and_then(Json::as_u64).filter(|&wanted| wanted > longest as u64) {
        Some(wanted) => {
            Err(args.wrong(format!("setting `history_len`: {wanted}; the model sees at most {longest}")))
        }
        None => Ok(()),
    }
}

/// The model of a run, without its weights.
fn untrained(run: &Path) -> Result<Box<dyn Baseline>, BaselineError> {
    restore(&RunConfig::read(&RunFolder::open(run)?)?.model_config, Device::Cpu)
}

/// What [`AGGREGATE`] is set to.
fn aggregate(args: &PolicyArgs, given: Option<Json>) -> Result<Aggregate, PolicyError> {
    let Some(given) = given else { return Ok(Aggregate::default()) };
    Aggregate::deserialize(&given)
        .map_err(|_| args.wrong(format!("setting `{}`: {given}; use last, mean or best", AGGREGATE.name)))
}

const fn acting(name: &'static str, summary: &'static str, make: MakePolicy) -> PolicyEntry {
    PolicyEntry::new(name, summary, make)
        .settings(&[RUN, CHECKPOINT, DEVICE, TRANSFER])
        .image(image_size)
        .trained(trained_in)
        .files(model_files)
        .companions(model_companions)
}

/// The policy of the agent of the same name.
const fn agent(name: &'static str, summary: &'static str, settings: &'static [Setting]) -> PolicyEntry {
    PolicyEntry::new(name, summary, |context, args| {
        let agent = Given::of(args)?.agent(args, context.env.id)?;
        Ok(Box::new(AgentPolicy::new(agent)))
    })
    .settings(settings)
    .image(agent_image)
    .trained(agent_trained_in)
    .files(|args| {
        let given = Given::of(args)?;
        TrainedAgent::files(&given.run, given.which).map_err(|error| given.wrong(args, error))
    })
    .companions(|args| {
        let given = Given::of(args)?;
        TrainedAgent::companions(&given.run, given.which).map_err(|error| given.wrong(args, error))
    })
}

fn model_policy(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
    baseline: Option<&str>,
) -> Result<Box<dyn Policy>, PolicyError> {
    let given = Given::of(args)?;
    let model = given.model(args, context.env.id)?;
    given.check_all_known(args, &[])?;
    let found = model.baseline.name();
    let policy = ModelPolicy::new(model).map_err(|error| given.wrong(args, error))?;
    match baseline.filter(|wanted| *wanted != found) {
        Some(wanted) => {
            Err(given
                .wrong(args, format!("it trained {found}, not {wanted}; use `{found}:RUN` or `policy:RUN`")))
        }
        None => Ok(Box::new(policy)),
    }
}

/// The size of the images that the model of these arguments was trained on; `None` for runs that are not there.
pub(super) fn image_size(args: &PolicyArgs) -> Option<ImageSize> {
    let run = RunFolder::open(&Given::of(args).ok()?.run).ok()?;
    let side = RunConfig::read(&run).ok()?.data.image;
    Some(ImageSize { height: side, width: side })
}

/// The size of the images that the agent of these arguments observes; `None` also for runs that are not there.
fn agent_image(args: &PolicyArgs) -> Option<ImageSize> {
    let run = RunFolder::open(&Given::of(args).ok()?.run).ok()?;
    let side = OnlineConfig::read(&run).ok()?.interface.image?;
    Some(ImageSize { height: side, width: side })
}

/// The environment and the dataset that the model of these arguments was trained in and on; `None` also for runs that are not there, and for datasets that
/// do not say how they were recorded.
pub(super) fn trained_in(args: &PolicyArgs) -> Option<TrainedIn> {
    let run = RunFolder::open(&Given::of(args).ok()?.run).ok()?;
    let data = RunConfig::read(&run).ok()?.data;
    let dataset = TrainedOn::new(data.path, (data.episodes, data.rows), data.split.held_out);
    let trained = TrainedIn::new(data.env?).frame_skip(data.frame_skip).dataset(dataset);
    Some(match data.env_settings {
        Some(settings) => trained.settings(settings),
        None => trained,
    })
}

/// The same of an agent. Online, agents act at every step of the environment.
fn agent_trained_in(args: &PolicyArgs) -> Option<TrainedIn> {
    let run = RunFolder::open(&Given::of(args).ok()?.run).ok()?;
    let config = OnlineConfig::read(&run).ok()?;
    let frame_skip = config.data.map_or(Some(1), |data| data.frame_skip);
    Some(TrainedIn::new(config.env).settings(config.env_settings).frame_skip(frame_skip))
}

/// Of a run, the files that a policy depends on: the others change as training goes on.
fn model_files(args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
    let given = Given::of(args)?;
    TrainedModel::files(&given.run, given.which).map_err(|error| given.wrong(args, error))
}

/// Of a run, what it takes beside these files to open it elsewhere.
fn model_companions(args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
    let given = Given::of(args)?;
    TrainedModel::companions(&given.run, given.which).map_err(|error| given.wrong(args, error))
}

/// Arguments, as far as all policies of trained models share them.
pub(super) struct Given {
    run: PathBuf,
    which: Which,
    device: Device,
    /// If it was given.
    precision: Option<Precision>,
    /// Whether a run of another environment is taken.
    transfer: bool,
    rest: Map<String, Json>,
}

impl Given {
    pub(super) fn of(args: &PolicyArgs) -> Result<Self, PolicyError> {
        let [run] = &args.positional[..] else {
            return Err(args.wrong(format!("name the folder of one training run, as in `{}:RUN`", args.name)));
        };
        let mut rest = args.named.clone();
        let which = match rest.shift_remove("checkpoint") {
            Some(which) => text(&which)
                .parse()
                .map_err(|reason| args.wrong(format!("setting `checkpoint`: {reason}")))?,
            None => Which::default(),
        };
        let device = match rest.shift_remove("device") {
            Some(name) => {
                text(&name).parse().map_err(|error: BaselineError| args.wrong(error.to_string()))?
            }
            None => Device::default(),
        };
        let precision = rest.shift_remove("precision").map(|name| text(&name).parse());
        let precision =
            precision.transpose().map_err(|error: BaselineError| args.wrong(error.to_string()))?;
        let transfer = match rest.shift_remove("transfer") {
            Some(Json::Bool(transfer)) => transfer,
            Some(other) => {
                return Err(args.wrong(format!("setting `transfer`: `{}`; use true or false", text(&other))));
            }
            None => false,
        };
        Ok(Self { run: text(run).into(), which, device, precision, transfer, rest })
    }

    /// About the run.
    pub(super) fn wrong(&self, args: &PolicyArgs, reason: impl Display) -> PolicyError {
        args.wrong(format!("run {}: {reason}", self.run.display()))
    }

    /// Refuses what is left where no planner takes settings; `options` are known, too.
    pub(super) fn check_all_known(&self, args: &PolicyArgs, options: &[Setting]) -> Result<(), PolicyError> {
        let Some(name) = self.rest.keys().next() else { return Ok(()) };
        let known: Vec<&str> = OF_MODELS.iter().chain(options).map(|setting| setting.name).collect();
        Err(args.wrong(WrongSetting::unknown(name, known).to_string()))
    }

    /// The model, for use in the environment `env`: action dims may agree where nothing else does.
    pub(super) fn model(&self, args: &PolicyArgs, env: &str) -> Result<TrainedModel, PolicyError> {
        let mut model = TrainedModel::open(&self.run, self.which, self.device)
            .map_err(|error| args.wrong(error.to_string()))?;
        model.baseline.set_precision(self.precision.unwrap_or_default());
        self.check_env(args, model.config.data.env.as_deref(), env)?;
        Ok(model)
    }

    /// The agent whose name the policy has, for use in the environment `env`, with the options of its plan.
    fn agent(mut self, args: &PolicyArgs, env: &str) -> Result<TrainedAgent, PolicyError> {
        let entry = find_agent(&args.name).map_err(|error| args.wrong(error.to_string()))?;
        if self.precision.is_some() {
            return Err(args.wrong("setting `precision`: agents compute in fp32; leave it out"));
        }
        let is_option = |name: &String| entry.options.iter().any(|option| option.name == name);
        let (mut options, rest): (Map<_, _>, _) =
            std::mem::take(&mut self.rest).into_iter().partition(|(name, _)| is_option(name));
        // Arguments have no other way to say that a setting is off.
        options.values_mut().filter(|value| *value == "null").for_each(|value| *value = Json::Null);
        self.rest = rest;
        self.check_all_known(args, entry.options)?;
        let wrong = |error: BaselineError| args.wrong(error.to_string());
        let agent = TrainedAgent::open(&self.run, self.which, options, self.device).map_err(wrong)?;
        let found = &agent.config.agent.agent;
        if *found != args.name {
            return Err(
                self.wrong(args, format!("it trained {found}, not {}; use it as `{found}:RUN`", args.name))
            );
        }
        self.check_env(args, Some(&agent.config.env), env)?;
        Ok(agent)
    }

    fn check_env(&self, args: &PolicyArgs, trained_in: Option<&str>, env: &str) -> Result<(), PolicyError> {
        // A dataset may not say where it was recorded, for which earlier versions wrote `unknown`.
        let unknown = Metadata::unknown().env;
        match trained_in.filter(|of| !of.is_empty() && *of != unknown) {
            Some(of) if of != env && !self.transfer => {
                let fix = format!("use a run of {env}, or allow it with transfer=true");
                Err(self.wrong(args, format!("it was trained in {of}, and this is {env}; {fix}")))
            }
            _ => Ok(()),
        }
    }
}
