//! The tables of the pages, from records alone: a row that nothing was recorded of is not in them.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use super::plan::{Row, Table, Task, with_seed};
use super::record::{Record, Records, wilson};
use crate::pages::with_part;
use crate::process;

/// Pages that have places for tables: `<!-- proof: TASK TABLE -->`.
const PAGES: &[&str] = &["docs/proof.md", "docs/robustness.md"];

/// Writes the tables of all tasks into the pages.
pub(super) fn write(tasks: &[Task], folder: &Path) -> Result<()> {
    for (path, found, current) in pages(tasks, folder)? {
        if found != current {
            fs::write(&path, current).with_context(|| format!("{} cannot be written", path.display()))?;
            println!("{} is written", path.display());
        }
    }
    Ok(())
}

/// Pages as they are and as they should be.
pub(super) fn pages(tasks: &[Task], folder: &Path) -> Result<Vec<(PathBuf, String, String)>> {
    let mut pages = Vec::new();
    for page in PAGES {
        let path = process::root().join(page);
        let found = fs::read_to_string(&path).with_context(|| format!("{page} cannot be read"))?;
        let mut current = found.clone();
        for task in tasks {
            let records = Records::read(folder, &task.name)?;
            for table in &task.tables {
                let (name, part) =
                    (format!("proof: {} {}", task.name, table.name), part(task, table, &records));
                current = with_part(&current, &name, &part).context(*page)?.unwrap_or(current);
            }
        }
        pages.push((path, found, current));
    }
    Ok(pages)
}

/// Commands, table, and where it was made.
fn part(task: &Task, table: &Table, records: &Records) -> String {
    let records: Vec<&Record> = records.0.iter().filter(|record| record.table == table.name).collect();
    let Some(last) = records.iter().max_by_key(|record| &record.date) else {
        return format!("Not run yet: `cargo xtask proof {}`.\n", task.name);
    };
    let tables = if table.is_sweep() { sweeps(table, &records) } else { policies(table, &records) };
    let mut versions: Vec<&str> = records.iter().map(|record| record.version.as_str()).collect();
    versions.sort_unstable();
    versions.dedup();
    let Record { machine, date, .. } = last;
    format!(
        "{tables}\n{pairs}; version {versions}, {machine}, {date}. The commands for the first training ([`{name}.toml`](proof/{name}.toml) \
         has all):\n\n<!-- test: skip: it takes hours -->\n```bash\n{commands}```\n",
        pairs = pairs(table, &records),
        versions = versions.join(", "),
        name = task.name,
        commands = commands(task, table),
    )
}

/// How many pairs there are, and how many of them no policy has to solve: for each row, where these have several manifests.
fn pairs(table: &Table, records: &[&Record]) -> String {
    let mut found: Vec<([u64; 2], Vec<&str>)> = Vec::new();
    for row in &table.rows {
        let Some(record) = records.iter().find(|record| record.row == row.name) else { continue };
        let counts = [record.episodes, record.solved_at_start];
        match found.iter_mut().find(|(known, _)| *known == counts) {
            Some((_, rows)) => rows.push(&row.name),
            None => found.push((counts, vec![&row.name])),
        }
    }
    let sentence =
        |[episodes, solved]: [u64; 2]| format!("{episodes} pairs, of which {solved} are solved at reset");
    match &found[..] {
        [(counts, _)] => sentence(*counts),
        _ => {
            let each =
                found.iter().map(|(counts, rows)| format!("{}: {}", rows.join(", "), sentence(*counts)));
            each.collect::<Vec<_>>().join("; ")
        }
    }
}

/// What makes the first training of each row.
fn commands(task: &Task, table: &Table) -> String {
    let rows = table.rows.iter().flat_map(|row| row.steps.iter().chain([&row.result]));
    let steps = task.steps.iter().chain(&table.steps).chain(rows);
    steps.fold(String::new(), |text, step| text + "swm " + &with_seed(step, 1) + "\n")
}

/// A line for each policy, those that others are compared with last.
fn policies(table: &Table, records: &[&Record]) -> String {
    let (last, side) = match table.has_rates() {
        true => ("plans per CPU second", "--:"),
        false => ("published", "---"),
    };
    let mut text = format!(
        "| policy | training | CPU minutes | success | of all (95 %) | {last} |\n|---|---|--:|---|---|{side}|\n"
    );
    let mut line = |name: &str, row: Option<&Row>| {
        let of_row: Vec<&Record> = records.iter().filter(|record| record.row == name).copied().collect();
        // Policies without a training are the same whichever row they are evaluated with.
        let of_row = if row.is_some() { &of_row[..] } else { &of_row[..of_row.len().min(1)] };
        if of_row.is_empty() {
            return;
        }
        let minutes = of_row.iter().map(|record| record.training_minutes).sum::<f64>() / of_row.len() as f64;
        let minutes = if minutes > 0.0 { format!("{minutes:.0}") } else { String::new() };
        let (policy, training, published) = match row {
            Some(row) => (row.policy.clone(), row.training.as_str(), row.published.clone()),
            None => (name.replace('_', "-"), "", String::new()),
        };
        let last = if table.has_rates() { rate(of_row) } else { published };
        let _ = writeln!(
            text,
            "| {policy} | {training} | {minutes} | {} | {} | {last} |",
            each(of_row),
            all(of_row)
        );
    };
    for row in &table.rows {
        line(&row.name, Some(row));
    }
    let mut others: Vec<&str> = records.iter().map(|record| record.row.as_str()).collect();
    others.retain(|name| table.rows.iter().all(|row| row.name != *name));
    others.sort_unstable();
    others.dedup();
    others.iter().for_each(|name| line(name, None));
    text
}

/// A line for each change, a column for each policy.
fn sweeps(table: &Table, records: &[&Record]) -> String {
    let rows: Vec<&Row> =
        table.rows.iter().filter(|row| records.iter().any(|record| record.row == row.name)).collect();
    let mut changes: Vec<&str> = Vec::new();
    for change in records.iter().filter_map(|record| record.change.as_deref()) {
        if !changes.contains(&change) {
            changes.push(change);
        }
    }
    let mut text = "| changed |".to_owned();
    for row in &rows {
        let _ = write!(text, " {} | of all (95 %) |", row.policy);
    }
    let has_published = !table.published.is_empty();
    text += if has_published { " published |\n|---|" } else { "\n|---|" };
    text += &"---|".repeat(2 * rows.len() + usize::from(has_published));
    text.push('\n');
    for change in changes {
        let label = match table.labels.get(change) {
            Some(label) => label.clone(),
            None if change == "unchanged" => "nothing".to_owned(),
            None => format!("`{change}`"),
        };
        let _ = write!(text, "| {label} |");
        for row in &rows {
            let of_row: Vec<&Record> = records
                .iter()
                .filter(|record| record.row == row.name && record.change.as_deref() == Some(change))
                .copied()
                .collect();
            let _ = write!(text, " {} | {} |", each(&of_row), all(&of_row));
        }
        if has_published {
            let _ = write!(text, " {} |", table.published.get(change).map_or("", String::as_str));
        }
        text.push('\n');
    }
    text
}

/// Plans of all evaluations per second of CPU time.
fn rate(records: &[&Record]) -> String {
    let plans: Option<u64> = records.iter().map(|record| record.plans).sum();
    let seconds = 60.0 * records.iter().map(|record| record.evaluation_minutes).sum::<f64>();
    match plans {
        Some(plans) if seconds > 0.0 => format!("{:.2}", plans as f64 / seconds),
        _ => String::new(),
    }
}

/// The rate of each training.
fn each(records: &[&Record]) -> String {
    let rates: Vec<String> = records.iter().map(|record| format!("{:.0} %", record.rate())).collect();
    rates.join(", ")
}

/// The rate of all trainings together, and its interval.
fn all(records: &[&Record]) -> String {
    let sum = |number: fn(&Record) -> u64| records.iter().map(|record| number(record)).sum::<u64>();
    let (successes, episodes) = (sum(|record| record.successes), sum(|record| record.episodes));
    if episodes == 0 {
        return String::new();
    }
    let [low, high] = wilson(successes, episodes);
    format!("{:.0} % ({low:.1} to {high:.1})", 100.0 * successes as f64 / episodes as f64)
}
