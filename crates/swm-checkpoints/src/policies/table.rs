//! Trained models by name: `mpc:RUN,solver=icem,samples=200`, `policy:RUN`, `gcbc:RUN`.

use std::path::{Path, PathBuf};

use serde::Deserialize as _;
use serde_json::{Map, Value as Json};
use swm_baselines::acting::{self, AgentPolicy, ModelCost, ModelPolicy};
use swm_baselines::online::{OnlineConfig, TrainedAgent, tdmpc2};
use swm_baselines::train::{RunConfig, RunFolder, TrainedModel, Which};
use swm_baselines::{Baseline, BaselineError, Device, restore};
use swm_core::registry::{MakePolicy, Setting, TrainedIn, TrainedOn};
use swm_core::settings::{Table, text};
use swm_core::{ImageSize, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Registry};
use swm_solvers::{Aggregate, LearnedCost, SOLVER_SETTING, on_true_dynamics, plan_on};
use swm_tasks::zoo::run_of;

use super::arguments::RunArguments;
use super::canonical::{self, CANONICAL};
use super::foreign;
use super::zoo;

/// Policies for every environment that shows images.
pub const POLICIES: &[PolicyEntry] = &[
    planning(
        "mpc",
        "plans on a trained world model (`mpc:RUN,solver=cem`), with the settings of the solver and of the plan",
        OF_MPC,
    ),
    planning(
        "lewm",
        "plans on a LeWM: a run (`lewm:RUN`), or a published checkpoint (`lewm:FOLDER`)",
        OF_FAMILY.as_slice(),
    ),
    planning(
        "pldm",
        "plans on a PLDM: a run (`pldm:RUN`), or a published checkpoint (`pldm:FOLDER`)",
        OF_FAMILY.as_slice(),
    ),
    planning(
        "dino-wm",
        "plans on a DINO-WM: a run (`dino-wm:RUN`), or a published checkpoint (`dino-wm:FOLDER`)",
        OF_FAMILY.as_slice(),
    ),
    acting("policy", "acts as a trained goal-conditioned policy says (`policy:RUN`)", |context, args| {
        model_policy(context, args, None)
    }),
    acting("gcbc", "a trained GCBC (`gcbc:RUN`)", |context, args| model_policy(context, args, Some("gcbc"))),
    acting("gc-idm", "a trained GC-IDM (`gc-idm:RUN`)", |context, args| {
        model_policy(context, args, Some("gc-idm"))
    }),
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
    zoo::POLICY,
];

/// What a policy that plans on a model is set by.
const OF_MPC: &[Setting] =
    &[RUN, CHECKPOINT, DEVICE, PRECISION, TRANSFER, AGGREGATE, PROPOSAL, CANONICAL, SOLVER_SETTING];
/// The same, of a model that may be a published checkpoint.
const OF_FAMILY: &Table = &Table::of(&[OF_MPC, foreign::SETTINGS]);

const OF_AGENTS: &[Setting] = &[RUN, CHECKPOINT, DEVICE, TRANSFER];
const OF_TDMPC2: &Table = &Table::of(&[OF_AGENTS, tdmpc2::OPTIONS]);

const RUN: Setting = Setting::new("RUN", "Folder of a training run, or zoo:NAME", "required");
const CHECKPOINT: Setting = Setting::new("checkpoint", "Which checkpoint: last, best, or a step", "last");
const DEVICE: Setting = Setting::new("device", "Device: cpu, cuda, cuda:1 …", "cpu");
const PRECISION: Setting =
    Setting::new("precision", "Precision of linear layers and attention: fp32, bf16", "fp32");
const TRANSFER: Setting = Setting::new("transfer", "Accept a run of another environment", "false");
/// What all policies of trained models know by name.
pub(super) const OF_MODELS: &[Setting] = &[CHECKPOINT, DEVICE, PRECISION, TRANSFER];

/// And what those that plan know.
const OF_PLANNERS: &[Setting] = &[CHECKPOINT, DEVICE, TRANSFER, AGGREGATE, PROPOSAL, CANONICAL];
const PROPOSAL: Setting = Setting::new(
    "proposal",
    "Run of gc-idm over the model's latents, whose plans the search begins from",
    "none",
);
/// The oracle's setting, too.
const AGGREGATE: Setting = Setting::new(
    acting::AGGREGATE,
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

const fn planning(name: &'static str, summary: &'static str, settings: &'static [Setting]) -> PolicyEntry {
    PolicyEntry::new(name, summary, |context, args| {
        let mut given = RunArguments::of(args)?;
        let model = given.model(args, context.env.id, context.registry)?;
        let aggregate = aggregate(args, given.rest.shift_remove(AGGREGATE.name))?;
        let cost = ModelCost::new(model).map_err(|error| given.wrong(args, error))?;
        let mut cost = cost.with_aggregate(aggregate);
        if let Some(run) = given.rest.shift_remove(PROPOSAL.name) {
            let run = run_of(&text(&run)).map_err(|error| args.wrong(error.to_string()))?;
            let proposal = TrainedModel::open(&run, Which::default(), given.device);
            let with = proposal.and_then(|policy| cost.with_proposal(&policy));
            cost = with.map_err(|error| args.wrong(format!("setting `{}`: {error}", PROPOSAL.name)))?;
        }
        if let Some(canonical) = canonical::take(args, &mut given.rest, given.device, context.env.id)? {
            cost = cost.with_canonical(&canonical).map_err(|error| canonical::wrong(args, error))?;
        }
        check_history(args, &given.rest, cost.history())?;
        let (action_block, scale) = (cost.action_block(), Some(cost.action_scale()));
        with_defaults(&mut given.rest, cost.plan_settings());
        let learned = LearnedCost::new(Box::new(cost), action_block).scaled(scale).with_settings(OF_PLANNERS);
        let policy = plan_on(context, learned, given.rest);
        Ok(Box::new(policy.map_err(|error| args.wrong(error.to_string()))?))
    })
    .settings(settings)
    .image(image_size)
    .trained(trained_in)
    .files(model_files)
    .companions(model_companions)
    .on_dataset(|args, dataset| RunArguments::of(args).ok()?.foreign?.on_dataset(args, dataset))
    .oracle(|context, args| {
        let mut given = RunArguments::of(args).ok()?;
        given.rest.shift_remove(PROPOSAL.name);
        given.rest.shift_remove(CANONICAL.name);
        let block = |block: usize| Map::from_iter([("action_block".to_owned(), Json::from(block))]);
        if let Some(foreign) = &given.foreign {
            let described = foreign.describe(context.registry?, Some(context.env.id))?;
            with_defaults(&mut given.rest, block(described.frameskip?));
        } else if let Ok(model) = untrained(&given.run) {
            with_defaults(&mut given.rest, model.plan_settings());
            with_defaults(&mut given.rest, block(model.input_spec().frameskip));
        }
        on_true_dynamics(context, given.rest)
    })
}

const fn acting(name: &'static str, summary: &'static str, make: MakePolicy) -> PolicyEntry {
    PolicyEntry::new(name, summary, make)
        .settings(&[RUN, CHECKPOINT, DEVICE, TRANSFER, CANONICAL])
        .image(image_size)
        .trained(trained_in)
        .files(model_files)
        .companions(model_companions)
}

/// The policy of the agent of the same name.
const fn agent(name: &'static str, summary: &'static str, settings: &'static [Setting]) -> PolicyEntry {
    PolicyEntry::new(name, summary, |context, args| {
        let agent = RunArguments::of(args)?.agent(args, context.env.id)?;
        Ok(Box::new(AgentPolicy::new(agent)))
    })
    .settings(settings)
    .image(agent_image)
    .trained(agent_trained_in)
    .files(|args| {
        let given = RunArguments::of(args)?;
        TrainedAgent::files(&given.run, given.which).map_err(|error| given.wrong(args, error))
    })
    .companions(|args| {
        let given = RunArguments::of(args)?;
        TrainedAgent::companions(&given.run, given.which).map_err(|error| given.wrong(args, error))
    })
}

fn model_policy(
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
    baseline: Option<&str>,
) -> Result<Box<dyn Policy>, PolicyError> {
    let mut given = RunArguments::of(args)?;
    let model = given.model(args, context.env.id, context.registry)?;
    let canonical = canonical::take(args, &mut given.rest, given.device, context.env.id)?;
    given.check_all_known(args, &[CANONICAL])?;
    let found = model.baseline.name();
    let mut policy = ModelPolicy::new(model).map_err(|error| given.wrong(args, error))?;
    if let Some(canonical) = canonical {
        policy = policy.with_canonical(&canonical).map_err(|error| canonical::wrong(args, error))?;
    }
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
    let given = RunArguments::of(args).ok()?;
    if let Some(size) = canonical::image_size(&given.rest) {
        return Some(size);
    }
    let side = match &given.foreign {
        Some(foreign) => foreign.describe(&Registry::new(), None)?.image,
        None => RunConfig::read(&RunFolder::open(&given.run).ok()?).ok()?.data.image,
    };
    Some(ImageSize { height: side, width: side })
}

/// The size of the images that the agent of these arguments observes; `None` also for runs that are not there.
fn agent_image(args: &PolicyArgs) -> Option<ImageSize> {
    let run = RunFolder::open(&RunArguments::of(args).ok()?.run).ok()?;
    let side = OnlineConfig::read(&run).ok()?.interface.image?;
    Some(ImageSize { height: side, width: side })
}

/// The environment and the dataset that the model of these arguments was trained in and on; `None` also for runs that are not there, and for datasets that
/// do not say how they were recorded.
pub(super) fn trained_in(args: &PolicyArgs) -> Option<TrainedIn> {
    let given = RunArguments::of(args).ok()?;
    if let Some(foreign) = &given.foreign {
        return foreign.trained_in();
    }
    let run = RunFolder::open(&given.run).ok()?;
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
    let run = RunFolder::open(&RunArguments::of(args).ok()?.run).ok()?;
    let config = OnlineConfig::read(&run).ok()?;
    let frame_skip = config.data.map_or(Some(1), |data| data.frame_skip);
    Some(TrainedIn::new(config.env).settings(config.env_settings).frame_skip(frame_skip))
}

/// Of a run, the files that a policy depends on: the others change as training goes on.
fn model_files(args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
    let given = RunArguments::of(args)?;
    let mut files = match &given.foreign {
        Some(foreign) => foreign.files(args)?,
        None => TrainedModel::files(&given.run, given.which).map_err(|error| given.wrong(args, error))?,
    };
    if let Some(run) = given.rest.get(PROPOSAL.name) {
        let run = run_of(&text(run)).map_err(|error| args.wrong(error.to_string()))?;
        let proposal = TrainedModel::files(&run, Which::default());
        files.extend(proposal.map_err(|error| args.wrong(error.to_string()))?);
    }
    canonical::add_files(args, &given.rest, &mut files, TrainedModel::files)?;
    Ok(files)
}

/// Of a run, what it takes beside these files to open it elsewhere. A published checkpoint is its files.
fn model_companions(args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
    let given = RunArguments::of(args)?;
    let mut files = match &given.foreign {
        Some(_) => Vec::new(),
        None => {
            TrainedModel::companions(&given.run, given.which).map_err(|error| given.wrong(args, error))?
        }
    };
    if let Some(run) = given.rest.get(PROPOSAL.name) {
        let run = run_of(&text(run)).map_err(|error| args.wrong(error.to_string()))?;
        let proposal = TrainedModel::companions(&run, Which::default());
        files.extend(proposal.map_err(|error| args.wrong(error.to_string()))?);
    }
    canonical::add_files(args, &given.rest, &mut files, TrainedModel::companions)?;
    Ok(files)
}
