//! `cargo xtask sizes`: what depending on one crate costs, for every way to choose its features, as the table of docs/sizes.md.
//!
//! How many packages a build has follows from `Cargo.lock` and is compared by `cargo xtask nightly`; times and sizes are measured on
//! demand, kept in `recipes/sizes.toml`, and compared by nobody.

mod builds;
mod limits;
mod measure;
mod table;

use std::fs;
use std::path::PathBuf;

use anyhow::{Context as _, Result, bail, ensure};

use self::builds::Choice;
use self::measure::Figures;
use self::table::Row;
use crate::metadata::Metadata;
use crate::pages::with_part;
use crate::{process, separate_crates};

/// Options of `cargo xtask sizes`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Compare the page with the workspace instead of writing it
    #[arg(long)]
    check: bool,
    /// Measure build time and program size of these builds first, `CRATE` or `CRATE:CHOICE` (`none`, `default`, a feature)
    #[arg(long, value_name = "BUILD", num_args = 1.., conflicts_with = "check")]
    measure: Vec<String>,
}

/// Writes the page, or compares it; measures before, where asked.
pub(crate) fn run(args: &Args) -> Result<()> {
    let metadata = Metadata::load()?;
    let choices = builds::choices(&metadata);
    let mut figures = Figures::load()?;
    for wanted in &args.measure {
        let chosen: Vec<&Choice> = choices.iter().filter(|choice| choice.is_called(wanted)).collect();
        ensure!(!chosen.is_empty(), "there is no build `{wanted}`; there are: {}", names(&choices));
        for choice in chosen {
            figures.insert(choice, measure::measure(choice)?)?;
        }
    }
    let mut rows = Vec::new();
    let mut faults = Vec::new();
    for choice in &choices {
        let tree = choice.build.tree()?;
        faults.extend(limits::offences(choice, &tree));
        let row = Row::new(&metadata, choice, &tree, figures.get(choice))?;
        faults.extend(row.promises_too_much(&metadata));
        rows.push(row);
    }
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    write_or_compare(&table::text(&rows), args.check)
}

/// Type-checks each crate alone with each choice of its features; those that are built apart have a step of their own.
pub(crate) fn check_each_alone() -> Result<()> {
    run(&Args { check: true, ..Args::default() })?;
    for choice in builds::choices(&Metadata::load()?) {
        if !choice.pulls_in(separate_crates::SEPARATE)? {
            let mut command = process::cargo(["check", "--quiet"]);
            process::run(command.args(choice.build.selection()))?;
        }
    }
    Ok(())
}

fn names(choices: &[Choice]) -> String {
    choices.iter().map(Choice::name).collect::<Vec<_>>().join(", ")
}

fn write_or_compare(table: &str, is_check: bool) -> Result<()> {
    let path: PathBuf = process::root().join("docs/sizes.md");
    let page = fs::read_to_string(&path).context("cannot read docs/sizes.md")?;
    let current = with_part(&page, "sizes", table)?.context("docs/sizes.md has no place for the table")?;
    if current == page {
        println!("docs/sizes.md is current");
    } else if is_check {
        let lines = current.lines().filter(|line| !page.contains(line)).collect::<Vec<_>>().join("\n");
        bail!("docs/sizes.md is stale: run `cargo xtask sizes`; it should have:\n{lines}");
    } else {
        fs::write(&path, current).context("cannot write docs/sizes.md")?;
        println!("docs/sizes.md is written");
    }
    Ok(())
}
