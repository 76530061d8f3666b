//! Arguments of policies of trained models: which run, which checkpoint, on what device.

use std::fmt::Display;
use std::path::PathBuf;

use serde_json::{Map, Value as Json};
use swm_baselines::online::{TrainedAgent, find_agent};
use swm_baselines::train::{TrainedModel, Which};
use swm_baselines::{BaselineError, Device, Precision};
use swm_core::registry::Setting;
use swm_core::settings::{WrongSetting, text};
use swm_core::{Metadata, PolicyArgs, PolicyError, Registry};
use swm_tasks::zoo::run_of;

use super::foreign::{FAMILIES, Foreign};
use super::table::OF_MODELS;

/// Arguments, as far as all policies of trained models share them.
pub(super) struct RunArguments {
    pub(super) run: PathBuf,
    pub(super) which: Which,
    pub(super) device: Device,
    /// If it was given.
    precision: Option<Precision>,
    /// Whether a run of another environment is taken.
    transfer: bool,
    /// If it is no run, but a checkpoint of others.
    pub(super) foreign: Option<Foreign>,
    pub(super) rest: Map<String, Json>,
}

impl RunArguments {
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
        let run = run_of(&text(run)).map_err(|error| args.wrong(error.to_string()))?;
        let foreign = Foreign::of(args, &run, &mut rest)?;
        Ok(Self { run, which, device, precision, transfer, foreign, rest })
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

    /// The model, for use in the environment `env`: action dims may agree where nothing else does. A checkpoint of others is imported, for
    /// which `registry` must have the environment.
    pub(super) fn model(
        &self,
        args: &PolicyArgs,
        env: &str,
        registry: Option<&Registry>,
    ) -> Result<TrainedModel, PolicyError> {
        let mut model = match &self.foreign {
            Some(foreign) => self.foreign_model(args, foreign, env, registry)?,
            None => {
                let model = TrainedModel::open(&self.run, self.which, self.device)
                    .map_err(|error| args.wrong(error.to_string()))?;
                self.check_env(args, model.config.data.env.as_deref(), env)?;
                model
            }
        };
        let found = model.baseline.name();
        if FAMILIES.contains(&args.name.as_str()) && args.name != found {
            let reason = format!("it trained {found}, not {}; use `{found}:RUN` or `mpc:RUN`", args.name);
            return Err(self.wrong(args, reason));
        }
        model.baseline.set_precision(self.precision.unwrap_or_default());
        Ok(model)
    }

    fn foreign_model(
        &self,
        args: &PolicyArgs,
        foreign: &Foreign,
        env: &str,
        registry: Option<&Registry>,
    ) -> Result<TrainedModel, PolicyError> {
        if self.device != Device::Cpu || self.which != Which::default() {
            let reason =
                "settings `device` and `checkpoint` are for runs; import the checkpoint first: `swm import`";
            return Err(self.wrong(args, reason));
        }
        let Some(registry) = registry else {
            return Err(
                self.wrong(args, "it is a checkpoint of others, which is imported first: `swm import`")
            );
        };
        self.check_env(args, foreign.trained_in().map(|trained| trained.env).as_deref(), env)?;
        foreign.load(args, registry, env)
    }

    /// The agent whose name the policy has, for use in the environment `env`, with the options of its plan.
    pub(super) fn agent(mut self, args: &PolicyArgs, env: &str) -> Result<TrainedAgent, PolicyError> {
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
