//! What is run: the files `docs/proof/TASK.toml`.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use serde::Deserialize;

use crate::recipes;

/// Trainings of each row, unless it has another number.
pub(super) const SEEDS: u64 = 3;

/// Commands that run in one folder, and the tables of what they make.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Task {
    /// The file's.
    #[serde(skip)]
    pub(super) name: String,
    /// Arguments of `swm` that come before all rows.
    pub(super) steps: Vec<String>,
    pub(super) tables: Vec<Table>,
}

/// Rows that are shown together.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Table {
    pub(super) name: String,
    /// Those that come before its rows.
    #[serde(default)]
    pub(super) steps: Vec<String>,
    /// Of sweeps: what changes are called, where it is not their own name.
    #[serde(default)]
    pub(super) labels: BTreeMap<String, String>,
    /// Of sweeps: published success by change.
    #[serde(default)]
    pub(super) published: BTreeMap<String, String>,
    pub(super) rows: Vec<Row>,
}

/// A policy, of several trainings.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Row {
    pub(super) name: String,
    /// What a reader calls it.
    pub(super) policy: String,
    /// How much it is trained.
    #[serde(default)]
    pub(super) training: String,
    #[serde(default = "seeds")]
    pub(super) seeds: u64,
    /// The trainings; `SEED` is replaced.
    #[serde(default)]
    pub(super) steps: Vec<String>,
    /// The evaluation or sweep, with `--out`.
    pub(super) result: String,
    /// Actions that one plan or decision gives; with it, the table shows how many are made in a second of CPU time.
    pub(super) block: Option<u64>,
    #[serde(default)]
    pub(super) published: String,
    /// Whether `--quick` runs it.
    #[serde(default)]
    pub(super) quick: bool,
}

fn seeds() -> u64 {
    SEEDS
}

impl Task {
    pub(super) fn rows(&self) -> impl Iterator<Item = (&Table, &Row)> {
        self.tables.iter().flat_map(|table| table.rows.iter().map(move |row| (table, row)))
    }

    /// Trainings of other rows that make what a row reads, each behind those that it reads itself.
    pub(super) fn needs(&self, row: &Row) -> Vec<&str> {
        let mut needs = Vec::new();
        for command in row.steps.iter().chain([&row.result]) {
            self.add_needs(command, row, &mut needs);
        }
        needs
    }

    fn add_needs<'a>(&'a self, command: &str, own: &Row, needs: &mut Vec<&'a str>) {
        let reads = |name: &str| {
            let mut words = command.split(|c: char| c.is_whitespace() || ",:=".contains(c));
            words.any(|word| word == name)
        };
        let others = self.rows().filter(|(_, row)| !std::ptr::eq(*row, own)).flat_map(|(_, row)| &row.steps);
        for step in others.filter(|step| option(step, "--out").is_some_and(reads)) {
            if step.as_str() != command && !needs.contains(&step.as_str()) {
                self.add_needs(step, own, needs);
                needs.push(step);
            }
        }
    }
}

impl Table {
    /// Whether its rows are sweeps over changes.
    pub(super) fn is_sweep(&self) -> bool {
        self.rows.iter().any(|row| row.result.starts_with("sweep "))
    }

    /// Whether it shows how fast its rows plan.
    pub(super) fn has_rates(&self) -> bool {
        self.rows.iter().any(|row| row.block.is_some())
    }
}

/// All tasks, by name.
pub(super) fn tasks(folder: &Path) -> Result<Vec<Task>> {
    let named = recipes::read_all::<Task>(folder)?.into_iter();
    Ok(named.map(|(name, task)| Task { name, ..task }).collect())
}

/// A command of one training.
pub(super) fn with_seed(step: &str, seed: u64) -> String {
    step.replace("SEED", &seed.to_string())
}

/// The value of an option in a command.
pub(super) fn option<'a>(step: &'a str, name: &str) -> Option<&'a str> {
    step.split_whitespace().skip_while(|word| *word != name).nth(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process;

    #[test]
    fn a_row_needs_the_trainings_that_its_commands_read() {
        let rows = [
            ("base", "['train a --out base-SEED']", "eval --policy mpc:base-SEED --out base-SEED-result"),
            (
                "top",
                "['train b --encoder base-SEED --out top-SEED']",
                "eval --policy top:top-SEED --out top-SEED-result",
            ),
            ("both", "[]", "eval --policy mpc:base-SEED,proposal=top-SEED,elites=3 --out both-SEED-result"),
        ];
        let rows = rows.map(|(name, steps, result)| {
            format!(
                "[[tables.rows]]\nname = '{name}'\npolicy = 'P'\nsteps = {}\nresult = '{result}'\n",
                steps.replace('\'', "\"")
            )
        });
        let text = format!("steps = []\n[[tables]]\nname = 't'\n{}", rows.concat());
        let task: Task = toml::from_str(&text).unwrap();
        let needs = |at: usize| task.needs(&task.tables[0].rows[at]);
        assert!(needs(0).is_empty());
        assert_eq!(needs(1), ["train a --out base-SEED"]);
        assert_eq!(needs(2), ["train a --out base-SEED", "train b --encoder base-SEED --out top-SEED"]);
    }

    #[test]
    fn results_are_where_they_are_looked_for_and_names_are_distinct() {
        let tasks = tasks(&process::root().join("docs/proof")).unwrap();
        assert!(tasks.len() > 3 && tasks.iter().flat_map(Task::rows).any(|(_, row)| row.quick));
        for task in &tasks {
            let (mut rows, mut outs) = (Vec::new(), Vec::new());
            for (table, row) in task.rows() {
                let words: Vec<&str> = row.result.split_whitespace().collect();
                assert!(["eval", "sweep"].contains(&words[0]), "{}: {}", task.name, row.result);
                assert_eq!(
                    table.is_sweep(),
                    words[0] == "sweep",
                    "{}: a table has one kind of rows",
                    task.name
                );
                assert!((1..=SEEDS).contains(&row.seeds) && row.result.contains("SEED"), "{}", row.result);
                assert!(row.steps.iter().all(|step| step.contains("SEED")), "{}: {}", task.name, row.name);
                rows.push((&table.name, &row.name));
                outs.extend(row.steps.iter().chain([&row.result]));
            }
            outs.extend(task.steps.iter().chain(task.tables.iter().flat_map(|table| &table.steps)));
            let mut outs: Vec<&str> =
                outs.iter().map(|step| option(step, "--out").expect("a step writes somewhere")).collect();
            let all = (outs.len(), rows.len());
            outs.sort_unstable();
            outs.dedup();
            rows.sort();
            rows.dedup();
            let distinct = (outs.len(), rows.len());
            assert_eq!(
                distinct, all,
                "{}: two steps write to one place, or two rows have one name",
                task.name
            );
        }
    }
}
