//! `swm solvers`: which solvers exist, and what can be set.

use clap::Args;
use serde_json::{Value as Json, json};
use swm_core::{Registry, Setting, Settings as _};
use swm_solvers::{PlanConfig, SimulatorOptions, SolverEntry};

use super::output::table;
use super::{Failure, Output};

/// List planning solvers and their settings.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm solvers\n  swm solvers cem\n  swm solvers --json")]
pub(super) struct Solvers {
    /// Show one solver in full.
    solver: Option<String>,
}

impl Solvers {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Some(name) = self.solver else {
            let list: Vec<Json> = registry.all::<SolverEntry>().map(describe).collect();
            let row = |solver: &SolverEntry| [solver.name, solver.summary].map(str::to_owned);
            let rows = registry.all::<SolverEntry>().map(row);
            return output.result(&list, || table(&["solver", "what it does"], rows));
        };
        let solver = registry.find::<SolverEntry>(&name)?;
        output.result(&describe(solver), || one(solver))
    }
}

fn one(solver: &SolverEntry) -> String {
    let settings = |title: &str, list: &[Setting]| {
        let row = |s: &Setting| [s.name, s.default, s.doc].map(str::to_owned);
        table(&[title, "default", "what it does"], list.iter().map(row))
    };
    let head = format!(
        "{}: {}\n\n{}\n{}",
        solver.name,
        solver.summary,
        settings("setting", solver.settings),
        settings("of the plan", PlanConfig::SETTINGS),
    );
    if !solver.plans_on_simulator {
        return format!("{head}\nIt needs a model of the dynamics and cannot plan on the true simulator.\n");
    }
    let simulator = settings("of the simulator", SimulatorOptions::SETTINGS);
    let example = format!("swm plan swm/PushT-v1 --policy {} --trace out", solver.name);
    format!("{head}\n{simulator}\nExample: {example}\n")
}

fn describe(solver: &SolverEntry) -> Json {
    let settings = |list: &[Setting]| -> Vec<Json> {
        list.iter().map(|s| json!({"name": s.name, "default": s.default, "doc": s.doc})).collect()
    };
    json!({
        "name": solver.name,
        "summary": solver.summary,
        "settings": settings(solver.settings),
        "plan_settings": settings(PlanConfig::SETTINGS),
        "plans_on_simulator": solver.plans_on_simulator,
        "simulator_settings": settings(SimulatorOptions::SETTINGS),
    })
}
