//! A world model of a registry: the policy of its name plans with it, blocks have its stride, and goals are rows of their columns.

use swm_core::evaluate::ModelEntry;
use swm_core::evaluate::quality::WorldModel;
use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{
    BoxError, EnvConfig, EnvEntry, PolicyArgs, PolicyContext, Registry, Row, Setting, WorldError,
};
use swm_solvers::{PLANNERS, SOLVERS, WorldModelEntry, registered_model};

use crate::worlds::{NO_TASK_COST, Setting as Run, run, toward};

/// The toy's dynamics, several actions at a time, with all latents multiplied.
struct Line {
    stride: usize,
    unit: f64,
}

impl WorldModel for Line {
    fn latent_dim(&self) -> usize {
        1
    }
    fn stride(&self) -> usize {
        self.stride
    }
    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
        latent[0] = self.unit * row.get::<f64>("state")?[0];
        Ok(())
    }
    fn predict(&mut self, latent: &mut [f64], actions: &[f64]) -> Result<(), BoxError> {
        assert_eq!(actions.len(), self.stride);
        latent[0] += self.unit * actions.iter().sum::<f64>();
        Ok(())
    }
}

/// Reads what goals do not have.
struct Blind;

impl WorldModel for Blind {
    fn latent_dim(&self) -> usize {
        1
    }
    fn encode(&mut self, row: Row<'_>, latent: &mut [f64]) -> Result<(), BoxError> {
        latent[0] = row.get::<f64>("reward")?[0];
        Ok(())
    }
    fn predict(&mut self, _latent: &mut [f64], _action: &[f64]) -> Result<(), BoxError> {
        Err("never asked".into())
    }
}

static MODELS: [WorldModelEntry; 2] = [
    WorldModelEntry::new("line", "a point on a line", |_, args| {
        let given: Given = args.parse_as()?;
        Ok(Box::new(Line { stride: given.stride, unit: given.unit }))
    })
    .settings(&[
        Setting::new("stride", "Actions of a prediction", "1"),
        Setting::new("unit", "Unit of latents", "1"),
    ])
    .plan("horizon=6,receding_horizon=1,samples=60,iterations=8,elites=8"),
    WorldModelEntry::new("blind", "reads rewards", |_, _| Ok(Box::new(Blind))),
];

#[derive(serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Given {
    stride: usize,
    unit: f64,
}

impl Default for Given {
    fn default() -> Self {
        Self { stride: 1, unit: 1.0 }
    }
}

fn registry() -> Registry {
    Registry::new().with(SOLVERS).with(PLANNERS).with(&MODELS)
}

fn acts(entry: EnvEntry, text: &str) -> Result<Option<bool>, WorldError> {
    let config = EnvConfig::default();
    let policy = registry().policy(text, PolicyContext::new(&entry, &config))?;
    let setting = Run { entry, episodes: 1, max_steps: 20, reset: toward(7.0), ..Run::default() };
    Ok(run(&setting, policy)?[0].success)
}

#[test]
fn a_model_is_registered_once_and_planned_with_by_its_name() {
    let registry = registry();
    assert!(registry.find::<ModelEntry>("line").is_ok(), "measures of quality find it");
    for text in ["line", "line:stride=3,horizon=3", "line:unit=10,aggregate=mean", "line:solver=icem"] {
        assert_eq!(acts(TOY, text).unwrap(), Some(true), "{text}");
        assert_eq!(acts(NO_TASK_COST, text).unwrap(), Some(true), "{text}: it needs no task cost");
    }
    assert_eq!(acts(DISCRETE_TOY, "line:solver=categorical-cem").unwrap(), Some(true), "integers are values");
    let config = EnvConfig::default();
    let context = PolicyContext::new(&TOY, &config);
    let described = registry.policy("line:stride=2,aggregate=best", context).unwrap().describe();
    assert!(described.contains("model=line:stride=2") && described.contains("aggregate=best"), "{described}");
}

/// A folder of the package, in which tests run, has this name.
static NAMED_AS_A_FOLDER: [WorldModelEntry; 1] =
    [WorldModelEntry::new("src", "has the name of a folder", |_, _| Ok(Box::new(Blind)))];

#[test]
fn the_policy_of_trained_models_takes_registered_ones() {
    let registry = registry();
    for (text, same) in [
        ("mpc:line", "line:"),
        ("mpc:line:stride=2,samples=8", "line:stride=2,samples=8"),
        ("mpc:line,solver=icem", "line:solver=icem"),
        (" mpc : line:data.h5", "line:data.h5"),
        // Training runs, other policies, and other models.
        ("mpc:runs/line", "mpc:runs/line"),
        ("mpc:./line", "mpc:./line"),
        ("mpc:lines,samples=8", "mpc:lines,samples=8"),
        ("mpc", "mpc"),
        ("line:stride=2", "line:stride=2"),
        ("cem:line", "cem:line"),
    ] {
        assert_eq!(registered_model(&registry, text).unwrap(), same, "{text}");
    }
    assert_eq!(acts(TOY, &registered_model(&registry, "mpc:line,samples=60").unwrap()).unwrap(), Some(true));
    let registry = registry.with(&NAMED_AS_A_FOLDER);
    let message = registered_model(&registry, "mpc:src,samples=8").unwrap_err().to_string();
    assert!(message.contains("`src:…` for the model") && message.contains("`mpc:./src`"), "{message}");
    assert_eq!(registered_model(&registry, "mpc:src:samples=8").unwrap(), "src:samples=8");
    assert_eq!(registered_model(&registry, "mpc:./src").unwrap(), "mpc:./src");
}

#[test]
fn its_oracle_is_the_same_planner_on_the_true_dynamics() {
    let (registry, config) = (registry(), EnvConfig::default());
    let context = PolicyContext::new(&TOY, &config).within(&registry);
    let entry = registry.policy_entry(&TOY, "line").unwrap();
    let oracle = |text: &str| entry.oracle_args(&context, &PolicyArgs::parse(text).unwrap());
    let found = oracle("line:stride=3,aggregate=mean").expect("it has one");
    assert_eq!(found.name, "cem");
    assert_eq!((&found.named["action_block"], &found.named["horizon"]), (&3.into(), &6.into()));
    assert_eq!((found.named.get("stride"), &found.named["aggregate"]), (None, &"mean".into()));
    assert!(registry.policy_from(&found, context).is_ok());
    assert!(oracle("line:solver=ilqr").is_none(), "it does not plan on the true dynamics");
}

#[test]
fn wrong_settings_and_models_are_refused() {
    let refused = |text: &str| acts(TOY, text).unwrap_err().to_string();
    for (text, reason) in [
        ("line:strid=2", "strid"),
        ("line:aggregate=first", "use last, mean or best"),
        ("line:action_block=2", "the model was trained on blocks of 1"),
        ("line:stride=0", "`stride`: the model has 0"),
        ("blind", "the goal cannot be encoded"),
        ("line:solver=adam", "needs a gradient"),
    ] {
        let message = refused(text);
        assert!(message.contains(reason), "{text}: {message}");
    }
    let config = EnvConfig::default();
    let alone =
        MODELS[0].policy.make(&PolicyContext::new(&TOY, &config), &PolicyArgs::parse("line").unwrap());
    let message = alone.err().expect("there is no registry").to_string();
    assert!(message.contains("registry"), "{message}");
}
