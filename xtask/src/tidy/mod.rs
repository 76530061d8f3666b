//! `cargo xtask tidy`: the rules of the architecture and of the sources, which no compiler checks.
//!
//! A rule is an ordinary function from plain data to what offends it, and one line in the table; formatting is rustfmt's
//! and lints are clippy's.

mod flags;
mod layers;
mod links;
mod manifests;
mod mask;
mod sources;
mod texts;
mod tree;
mod words;

use anyhow::{Result, bail};

use self::tree::Tree;

/// Options of `cargo xtask tidy`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// List the rules and stop
    #[arg(long)]
    list: bool,
}

/// What offends a rule, and where.
#[derive(Debug, PartialEq, Eq)]
struct Violation {
    /// A crate, or `path:line`.
    place: String,
    /// What is wrong, and the fix.
    message: String,
}

impl Violation {
    fn new(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { place: place.into(), message: message.into() }
    }
}

/// One line of the table.
struct Rule {
    name: &'static str,
    about: &'static str,
    /// Whether an offence fails the run, or is only printed.
    level: Level,
    check: fn(&Tree) -> Vec<Violation>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Level {
    Error,
    Note,
}

use Level::{Error, Note};

#[rustfmt::skip]
const RULES: &[Rule] = &[
    Rule { name: "layers", level: Error, about: "crates depend only on the layers below them", check: |tree| layers::arrows(&tree.metadata) },
    Rule { name: "core-is-light", level: Error, about: "swm-core is built without tensor, file-format, image or physics crates", check: |tree| layers::light_core(&tree.metadata) },
    Rule { name: "unsafe", level: Error, about: "`unsafe` stands only where it is allowed", check: |tree| sources::misplaced_unsafe(&tree.files) },
    Rule { name: "words", level: Error, about: "no unfinished, ignored or silenced code", check: |tree| sources::forbidden_words(&tree.files) },
    Rule { name: "vocabulary", level: Error, about: "the words of the field, not those that they replaced", check: |tree| words::replaced(&tree.files) },
    Rule { name: "flags", level: Error, about: "libraries name settings, never flags of the command", check: |tree| flags::named(&tree.files) },
    Rule { name: "module-docs", level: Error, about: "each source file begins with `//!` documentation", check: |tree| sources::missing_module_docs(&tree.files) },
    Rule { name: "length", level: Error, about: "no source file is over 600 lines", check: |tree| sources::longer_than(&tree.files, 600) },
    Rule { name: "long", level: Note, about: "source files over 400 lines", check: |tree| sources::longer_than(&tree.files, 400) },
    Rule { name: "machine-paths", level: Error, about: "no path of one machine, no package server's address", check: |tree| texts::machine_traces(&tree.files) },
    Rule { name: "conflicts", level: Error, about: "no marks of an unfinished merge", check: |tree| texts::conflicts(&tree.files) },
    Rule { name: "dependency-table", level: Error, about: "docs/dependencies.md has one full row per shared dependency", check: |tree| manifests::dependency_table(tree.text("Cargo.toml"), tree.text("docs/dependencies.md")) },
    Rule { name: "unused-dependency", level: Error, about: "each shared dependency is used by a crate", check: |tree| manifests::unused_dependencies(tree.text("Cargo.toml"), &tree.metadata) },
    Rule { name: "descriptions", level: Error, about: "each crate has a description and a license", check: |tree| manifests::undescribed(&tree.metadata) },
    Rule { name: "links", level: Error, about: "links in pages lead to files and headings that exist", check: |tree| links::broken(&tree.files, &tree.sizes) },
    Rule { name: "book", level: Error, about: "docs/SUMMARY.md names every page of the book", check: |tree| links::not_in_the_book(&tree.files) },
    Rule { name: "size", level: Error, about: "what git tracks is under 39.9 MB", check: |tree| texts::too_large(&tree.sizes, 39_900_000) },
];

/// Checks all rules, prints every offence, and fails if there was one.
pub(crate) fn run(args: &Args) -> Result<()> {
    if args.list {
        for rule in RULES {
            println!("{:<18} {}", rule.name, rule.about);
        }
        return Ok(());
    }
    let tree = Tree::load()?;
    let mut errors = 0;
    for rule in RULES {
        for violation in (rule.check)(&tree) {
            let kind = if rule.level == Error { "error" } else { "note" };
            println!("{kind}[{}] {}: {}", rule.name, violation.place, violation.message);
            errors += usize::from(rule.level == Error);
        }
    }
    match errors {
        0 => {
            println!("tidy: {} rules hold over {} files", RULES.len(), tree.files.len());
            Ok(())
        }
        1 => bail!("tidy: 1 error"),
        _ => bail!("tidy: {errors} errors"),
    }
}
