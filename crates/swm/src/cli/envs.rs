//! `swm envs` and `swm fovs`: what exists.

use clap::Args;
use serde_json::json;
use swm_core::{
    Env, EnvConfig, EnvEntry, EnvSpec, EnvTask, FactorSpec, PolicyEntry, Registry, Setting, Space,
};

use super::output::{key_values, table};
use super::table::terminal_columns;
use super::{Failure, Output};

/// List environments, their policies and settings.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm envs\n  swm envs swm/PushT-v1\n  swm envs swm/PushT-v1 --full\n  \
                  swm envs --tasks              (tasks of the environments that have several: --env-option task=NAME)\n  swm envs --json")]
pub(super) struct Envs {
    /// Show one environment: its settings and policies.
    env: Option<String>,
    /// With an environment: also show all settings of each policy.
    #[arg(long, requires = "env")]
    full: bool,
    /// List the tasks of the environments that have several.
    #[arg(long, conflicts_with = "env")]
    tasks: bool,
}

impl Envs {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        match self.env {
            Some(id) => one(registry, registry.env(&id)?, self.full, output),
            None if self.tasks => tasks(registry, output),
            None => all(registry, output),
        }
    }
}

/// How big images are.
const IMAGES: &str = "Images (--image-size): `swm collect` records 64x64, evaluations have none, `swm render` renders 224x224.\n";

/// Lines of a terminal on which all columns of the list can be read.
const WIDE: usize = 140;

/// What is said below the list without some of its columns.
const MORE: &str = "\nAction, time step and success: in a wider window, by `swm envs ENV`, or with --json.\n";

/// The list without what each environment shows itself.
fn short_list(header: &[&str], rows: &[Vec<String>]) -> String {
    const KEPT: [usize; 3] = [0, 1, 4];
    let rows = rows.iter().map(|row| KEPT.map(|column| row[column].clone()).to_vec());
    table(&KEPT.map(|column| header[column]), rows)
}

fn all(registry: &Registry, output: &Output) -> Result<(), Failure> {
    // Families in the order of their first entry; what has none comes last.
    let mut families: Vec<(&str, Vec<Vec<String>>)> = Vec::new();
    let mut list = Vec::new();
    let mut failures: Vec<String> = Vec::new();
    for entry in registry.envs() {
        let made = entry.make(&EnvConfig::default());
        let [factors, action, step] = match &made {
            Ok(env) => brief(env.spec()),
            // What cannot run here, for want of a library say, is listed with the reason.
            Err(_) => ["-", "-", "-"].map(str::to_owned),
        };
        let success = if entry.success.is_empty() { "-" } else { entry.success };
        let row =
            vec![format!("  {}", entry.id), factors, action, step, entry.summary.into(), success.into()];
        match families.iter_mut().find(|(family, _)| *family == entry.family) {
            Some((_, rows)) => rows.push(row),
            None => families.push((entry.family, vec![row])),
        }
        match made {
            Ok(env) => list.push(describe(entry, env.spec(), &policies(registry, entry, env.as_ref()).0)),
            Err(error) => {
                list.push(json!({
                    "id": entry.id, "summary": entry.summary, "family": entry.family, "error": error.to_string(),
                }));
                failures.push(error.to_string());
            }
        }
    }
    families.sort_by_key(|(family, _)| family.is_empty());
    let mut rows = Vec::new();
    for (family, of_family) in families {
        let title = if family.is_empty() { "Others" } else { family };
        rows.push([title, "", "", "", "", ""].map(str::to_owned).to_vec());
        rows.extend(of_family);
    }
    // Most often all of them lack the same library: one message tells what to do.
    let failed = match failures.as_slice() {
        [] => String::new(),
        [only] => format!("\n{only}\n"),
        [first, rest @ ..] => {
            format!("\n{first}\n(and {} more without factors: `swm envs ENV` says why)\n", rest.len())
        }
    };
    let header = ["id", "factors", "action", "step (s)", "summary", "success"];
    output.result(&list, || {
        let is_narrow = terminal_columns().is_some_and(|columns| columns < WIDE);
        let mut text = match is_narrow {
            true => short_list(&header, &rows) + MORE,
            false => table(&header, rows),
        };
        text += "\n";
        text + IMAGES + &several_tasks(registry) + &failed
    })
}

/// How tasks are found, where there are environments with several.
fn several_tasks(registry: &Registry) -> String {
    match registry.envs().filter(|entry| entry.tasks.len() > 1).count() {
        0 => String::new(),
        count => format!(
            "Tasks (--env-option task=NAME): {count} environments have several; `swm envs --tasks` lists them, `swm envs ENV` \
             those of one.\n"
        ),
    }
}

/// Every task of the environments that have several, a line each: what a search by `grep` finds.
fn tasks(registry: &Registry, output: &Output) -> Result<(), Failure> {
    let all = || registry.envs().flat_map(|entry| entry.tasks.iter().map(move |task| (entry, task)));
    let list: Vec<_> = all()
        .map(|(entry, task)| {
            let is_default = entry.tasks.first() == Some(task);
            json!({"env": entry.id, "task": task.name, "doc": task.doc, "default": is_default})
        })
        .collect();
    output.result(&list, || {
        let rows = all().map(|(entry, task)| [vec![entry.id.to_owned()], task_row(entry, task)].concat());
        let table = table(&["environment", "task (--env-option task=NAME)", "what is rewarded"], rows);
        format!("{table}{DEFAULT_TASK}")
    })
}

/// What the star of a task means.
const DEFAULT_TASK: &str = "* without --env-option task=…\n";

fn task_row(entry: &EnvEntry, task: &EnvTask) -> Vec<String> {
    let star = if entry.tasks.first() == Some(task) { " *" } else { "" };
    vec![format!("{}{star}", task.name), task.doc.to_owned()]
}

/// The number of factors, the action, and the time of a control step in seconds.
fn brief(spec: &EnvSpec) -> [String; 3] {
    let action = match &spec.action {
        Space::Discrete { n, .. } => format!("{n} choices"),
        Space::MultiDiscrete { n, .. } => {
            format!("{} choices", n.iter().map(ToString::to_string).collect::<Vec<_>>().join("×"))
        }
        space => format!("{} real", space.dim()),
    };
    [spec.factors.len().to_string(), action, format!("{}", (spec.time_step_s * 1e6).round() / 1e6)]
}

fn one(registry: &Registry, entry: &'static EnvEntry, full: bool, output: &Output) -> Result<(), Failure> {
    let env = entry.make(&EnvConfig::default())?;
    let (policies, others) = policies(registry, entry, env.as_ref());
    let spec = env.spec();
    output.result(&describe(entry, spec, &policies), || {
        let settings = entry.settings.iter().map(|s| setting_row("", s, s.default)).collect::<Vec<_>>();
        let [factors, action, step] = brief(spec);
        let success = if entry.success.is_empty() { "none: rewards only" } else { entry.success };
        let mut about = vec![
            ("success", success.to_owned()),
            ("action", action),
            ("time step", format!("{step} s")),
            ("factors", format!("{factors}: `swm fovs {}`", entry.id)),
        ];
        about.extend(entry.planner.map(
            |planner| match entry.policies.iter().any(|own| own.name == "expert") {
                true => ("planner", format!("`{planner}` solves it on the true dynamics")),
                false => ("`expert`", format!("plans on the true dynamics by `{planner}`")),
            },
        ));
        let mut text = format!(
            "{}: {}\n\n{}\n{}\n",
            entry.id,
            entry.summary,
            key_values(&about),
            table(&["setting (--env-option)", "default", "what it does"], settings),
        );
        if entry.tasks.len() > 1 {
            let rows = entry.tasks.iter().map(|task| task_row(entry, task));
            text += &table(&["task (--env-option task=NAME)", "what is rewarded"], rows);
            text += DEFAULT_TASK;
            text += "\n";
        }
        let others = match others.iter().map(|policy| policy.name).collect::<Vec<_>>().join(", ") {
            none if none.is_empty() => none,
            names => format!("\nnot for this task and its actions: {names}\n"),
        };
        let mut rows = Vec::new();
        for policy in &policies {
            rows.push(vec![policy.name.to_owned(), String::new(), policy.summary.to_owned()]);
            if full {
                rows.extend(policy.settings.iter().map(|s| setting_row("  ", s, s.default)));
            }
        }
        if full {
            return text + &table(&["policy", "default", "what it does"], rows) + &others;
        }
        let rows = rows.iter().map(|row| vec![row[0].clone(), row[2].clone()]);
        text += &table(&["policy (--policy NAME:KEY=VALUE,…)", "what it does"], rows);
        let shared = shared_settings(&policies);
        if !shared.is_empty() {
            text += &format!("\n{}", table(&["setting of many planners", "default", "what it does"], shared));
        }
        text + &others + &format!("\n`swm envs {} --full` lists the settings of each policy.\n", entry.id)
    })
}

/// The policies that suit an environment, and the others.
fn policies(
    registry: &Registry,
    entry: &EnvEntry,
    env: &dyn Env,
) -> (Vec<&'static PolicyEntry>, Vec<&'static PolicyEntry>) {
    registry.policies(entry).partition(|policy| policy.suits(env))
}

fn setting_row(indent: &str, setting: &Setting, default: &str) -> Vec<String> {
    vec![format!("{indent}{}", setting.name), default.to_owned(), setting.doc.to_owned()]
}

/// The settings that a third of the policies with settings share, once each: solvers in a build with baselines.
fn shared_settings(policies: &[&PolicyEntry]) -> Vec<Vec<String>> {
    let with_settings = policies.iter().filter(|policy| !policy.settings.is_empty()).count();
    let mut seen: Vec<(&Setting, Vec<&str>)> = Vec::new();
    for setting in policies.iter().flat_map(|policy| policy.settings) {
        match seen.iter_mut().find(|(known, _)| (known.name, known.doc) == (setting.name, setting.doc)) {
            Some((_, defaults)) => defaults.push(setting.default),
            None => seen.push((setting, vec![setting.default])),
        }
    }
    let shared =
        seen.into_iter().filter(|(_, defaults)| defaults.len() > 1 && 3 * defaults.len() >= with_settings);
    shared
        .map(|(setting, defaults)| {
            let agree = defaults.iter().all(|default| *default == setting.default);
            setting_row("", setting, if agree { setting.default } else { "differs" })
        })
        .collect()
}

fn describe(entry: &EnvEntry, spec: &EnvSpec, policies: &[&PolicyEntry]) -> serde_json::Value {
    let settings = |list: &[Setting]| -> Vec<_> {
        list.iter().map(|s| json!({"name": s.name, "default": s.default, "doc": s.doc})).collect()
    };
    let policy =
        |p: &&PolicyEntry| json!({"name": p.name, "summary": p.summary, "settings": settings(p.settings)});
    json!({
        "id": entry.id,
        "summary": entry.summary,
        "family": entry.family,
        "success": entry.success,
        "num_factors": spec.factors.len(),
        "action": spec.action,
        "time_step_s": spec.time_step_s,
        "planner": entry.planner,
        "policies": policies.iter().map(policy).collect::<Vec<_>>(),
        "settings": settings(entry.settings),
        "tasks": entry.tasks.iter().map(|task| json!({"name": task.name, "doc": task.doc})).collect::<Vec<_>>(),
    })
}

/// List the factors of variation of an environment.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm fovs swm/PushT-v1\n  swm fovs swm/PushT-v1 --json")]
pub(super) struct Fovs {
    /// The environment's id.
    env: String,
}

impl Fovs {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let env = registry.env(&self.env)?.make(&EnvConfig::default())?;
        let spec = env.spec();
        let list: Vec<_> = spec.factors.iter().map(factor_json).collect();
        output.result(&list, || {
            let rows = spec.factors.iter().map(factor_row);
            let table = table(&["factor", "kind", "shape", "low", "high", "default", "what it does"], rows);
            format!("{table}* default factors: sampled without --vary, and by `--vary +NAME`\n")
        })
    }
}

/// One number where all agree, else the list.
fn short(values: &[f64]) -> serde_json::Value {
    match values {
        [first, rest @ ..] if rest.iter().all(|value| value == first) => json!(first),
        values => json!(values),
    }
}

/// Numbers without the noise of their 32 bits.
fn rounded(value: &serde_json::Value) -> serde_json::Value {
    match value {
        serde_json::Value::Array(items) => items.iter().map(rounded).collect(),
        serde_json::Value::Number(number) if number.is_f64() => {
            json!(number.as_f64().map(|number| (number * 1e6).round() / 1e6))
        }
        other => other.clone(),
    }
}

fn factor_json(factor: &FactorSpec) -> serde_json::Value {
    let (low, high) = factor.space.bounds();
    json!({
        "name": factor.name,
        "kind": factor.space.kind(),
        "shape": factor.space.shape(),
        "low": short(&low),
        "high": short(&high),
        "default": factor.default,
        "sampled_by_default": factor.sampled_by_default,
        "constraint": factor.constraint,
        "choices": factor.choices,
        "doc": factor.doc,
    })
}

fn factor_row(factor: &FactorSpec) -> Vec<String> {
    let (low, high) = factor.space.bounds();
    let round = |values: &[f64]| short(&values.iter().map(|v| (v * 1e4).round() / 1e4).collect::<Vec<_>>());
    let star = if factor.sampled_by_default { " *" } else { "" };
    vec![
        format!("{}{star}", factor.name),
        factor.space.kind().to_owned(),
        format!("{:?}", factor.space.shape()),
        round(&low).to_string(),
        round(&high).to_string(),
        rounded(&factor.default).to_string(),
        factor.doc.clone(),
    ]
}
