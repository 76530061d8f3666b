//! Every code block of the book is run, or says why not.
//!
//! Pages go in the order of the table of contents, after the README; each has a folder of its own. What a comment above a block can say
//! stands in `blocks.rs`, what is shortened in `shell.rs`. Programs in Rust are documentation tests of this package (`tests/src/lib.rs`).
//! `SWM_BOOK_COMMAND` names another command `swm` (one with all features), `SWM_INTEROP_PYTHON` a Python; with `SWM_BOOK_NEEDS=WHAT` only
//! the pages are read that have blocks which need WHAT, and it must be at hand.

mod blocks;
mod input_files;
mod shell;

use std::path::Path;

use rayon::prelude::*;

use crate::support::root;
use blocks::{Block, Page, Wish};
use shell::Machine;

/// What became of a block.
enum Outcome {
    Ran,
    /// For this reason.
    Left(String),
}

/// README and the pages of the table of contents, in its order.
fn pages() -> Vec<Page> {
    let summary =
        std::fs::read_to_string(root().join("docs/SUMMARY.md")).expect("the book has a table of contents");
    let links = summary.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    let names = links.map(|(link, _)| format!("docs/{link}")).filter(|name| name.ends_with(".md"));
    std::iter::once("README.md".to_owned()).chain(names).map(|name| Page::read(&root(), &name)).collect()
}

#[test]
fn every_block_of_the_book_runs() {
    let mut pages = pages();
    let machine = Machine::new();
    if let Ok(what) = std::env::var("SWM_BOOK_NEEDS") {
        assert!(machine.has(&what), "`{what}` is not at hand");
        pages.retain(|page| page.needs(&what));
        assert!(!pages.is_empty(), "no page needs `{what}`");
    }
    let runs: Vec<_> = pages.par_iter().flat_map_iter(|page| page_runs(page, &machine)).collect();
    let mut failures = Vec::new();
    for (place, outcome) in runs {
        match outcome {
            Ok(Outcome::Ran) => println!("{place}: ran"),
            Ok(Outcome::Left(reason)) => println!("{place}: not run: {reason}"),
            Err(error) => failures.push(format!("{place}: {error}")),
        }
    }
    assert!(failures.is_empty(), "{} blocks fail:\n\n{}", failures.len(), failures.join("\n\n"));
}

/// What became of the blocks of a page, in their order, and where they stand.
fn page_runs<'a>(page: &'a Page, machine: &'a Machine) -> Vec<(String, Result<Outcome, String>)> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let given = page.given.iter().try_for_each(|name| input_files::put(machine, name, folder.path()));
    let run = |block: &Block| match &given {
        Ok(()) => run(page, block, machine, folder.path()),
        Err(error) => Err(error.clone()),
    };
    page.blocks.iter().map(|block| (format!("{}:{}", page.name, block.line), run(block))).collect()
}

fn run(page: &Page, block: &Block, machine: &Machine, folder: &Path) -> Result<Outcome, String> {
    let mut status = 0;
    for wish in &block.wishes {
        match wish {
            Wish::Skip(reason) => return Ok(Outcome::Left(reason.clone())),
            Wish::Needs(what) if !machine.has(what) => {
                return Ok(Outcome::Left(format!("needs {what}, which is not here")));
            }
            Wish::Needs(_) => {}
            Wish::Exit(code) => status = *code,
        }
    }
    match block.language.as_str() {
        "sh" | "bash" => machine.script(&block.text, status, folder),
        "console" => machine.session(&block.text, status, folder),
        "python" => machine.python(&block.text, folder),
        "toml" => parsed(block.text.parse::<toml::Table>()),
        "json" => parsed(serde_json::from_str::<serde_json::Value>(&block.text)),
        "rust" => is_doctest(page, block),
        "" => Err("say its language, or why it is not run: <!-- test: skip: … -->".to_owned()),
        other => Err(format!("nobody runs `{other}`: say why: <!-- test: skip: … -->")),
    }
}

fn parsed<T, E: std::fmt::Display>(result: Result<T, E>) -> Result<Outcome, String> {
    result.map(|_| Outcome::Ran).map_err(|error| error.to_string())
}

/// `cargo test --doc` runs it, if the library of this package names the page.
fn is_doctest(page: &Page, block: &Block) -> Result<Outcome, String> {
    let library = std::fs::read_to_string(root().join("tests/src/lib.rs")).expect("the library is there");
    if !library.contains(&format!("\"{}\"", page.name)) {
        return Err("tests/src/lib.rs does not name this page: its programs are not run".to_owned());
    }
    match block.attributes.iter().find(|attribute| matches!(attribute.as_str(), "ignore" | "no_run")) {
        Some(attribute) => Err(format!("`{attribute}` without a reason: <!-- test: skip: … -->")),
        None => Ok(Outcome::Left("it is a documentation test".to_owned())),
    }
}

#[test]
fn commands_of_the_workspace_exist() {
    let source = std::fs::read_to_string(root().join("xtask/src/main.rs")).expect("the source is there");
    let is_command = |name: &str| {
        let capital = |word: &str| word[..1].to_uppercase() + &word[1..];
        let variant: String = name.split('-').filter(|word| !word.is_empty()).map(capital).collect();
        source.contains(&format!("    {variant}("))
    };
    for page in pages() {
        for (number, line) in page.text.lines().enumerate() {
            for rest in line.split("cargo xtask ").skip(1) {
                let name: String = rest.chars().take_while(|c| c.is_ascii_lowercase() || *c == '-').collect();
                let is_there = name.is_empty() || is_command(&name);
                assert!(is_there, "{}:{}: there is no `cargo xtask {name}`", page.name, number + 1);
            }
        }
    }
}
