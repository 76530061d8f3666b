//! The table itself: one row per build, as Markdown.

use std::cmp::Reverse;

use anyhow::Result;

use super::builds::Choice;
use super::measure::Figure;
use crate::cargo_tree::CargoTree;
use crate::metadata::Metadata;

/// One build.
#[derive(Debug)]
pub(super) struct Row {
    package: String,
    called: String,
    default_features: bool,
    /// Packages in it besides itself, and how many of them are ours.
    packages: usize,
    ours: usize,
    /// The newest compiler that one of them asks for, and who does.
    compiler: Compiler,
    figure: Option<Figure>,
}

/// A version of Rust, and the package that asks for it.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Compiler {
    version: Vec<u32>,
    package: Reverse<String>,
}

impl Compiler {
    fn new(version: &str, package: &str) -> Self {
        let mut parts: Vec<u32> = version.split('.').filter_map(|part| part.parse().ok()).collect();
        parts.resize(2, 0);
        Self { version: parts, package: Reverse(package.into()) }
    }

    fn number(&self) -> String {
        self.version.iter().map(ToString::to_string).collect::<Vec<_>>().join(".")
    }
}

impl Row {
    pub(super) fn new(
        metadata: &Metadata,
        choice: &Choice,
        tree: &CargoTree,
        figure: Option<Figure>,
    ) -> Result<Self> {
        let origin = |unit: &crate::cargo_tree::Unit| {
            metadata
                .packages
                .iter()
                .find(|package| package.name == unit.name && package.version == unit.version)
        };
        let packages: Vec<_> = tree.dependencies().filter_map(origin).collect();
        let compilers = packages
            .iter()
            .filter(|package| package.source.is_some())
            .filter_map(|package| Some(Compiler::new(package.rust_version.as_deref()?, &package.name)));
        Ok(Self {
            package: choice.build.package.clone(),
            called: choice.called.clone(),
            default_features: choice.build.default_features,
            packages: packages.len(),
            ours: packages.iter().filter(|package| package.source.is_none()).count(),
            compiler: compilers.max().unwrap_or_default(),
            figure,
        })
    }

    /// A crate promises to be built by a compiler that its dependencies without optional ones, or with the default ones, refuse.
    pub(super) fn promises_too_much(&self, metadata: &Metadata) -> Option<String> {
        if self.called != "none" && !self.default_features {
            return None;
        }
        let package = metadata.members().find(|package| package.name == self.package)?;
        let promised = Compiler::new(package.rust_version.as_deref().unwrap_or("1.0"), "");
        (promised.version < self.compiler.version).then(|| {
            format!(
                "{} promises Rust {}, and {} needs {}: change `rust-version` in its Cargo.toml",
                self.package,
                promised.number(),
                self.compiler.package.0,
                self.compiler.number()
            )
        })
    }
}

/// The whole table.
pub(super) fn text(rows: &[Row]) -> String {
    let mut text = "| crate | features | packages | of them ours | Rust, by whom | build, s | program, MB |\n|---|---|--:|--:|---|--:|--:|\n".to_owned();
    for row in rows {
        let package = if row.called == "none" { format!("`{}`", row.package) } else { String::new() };
        let called = match row.called.as_str() {
            "none" | "default" => row.called.clone(),
            feature => format!("`{feature}`"),
        };
        let Compiler { package: Reverse(asks), .. } = &row.compiler;
        let compiler =
            if asks.is_empty() { "-".into() } else { format!("{} `{asks}`", row.compiler.number()) };
        let (seconds, megabytes) = row.figure.as_ref().map_or_else(
            || ("-".into(), "-".into()),
            |figure| (format!("{:.0}", figure.seconds), format!("{:.1}", figure.bytes as f64 / 1e6)),
        );
        text += &format!(
            "| {package} | {called} | {} | {} | {compiler} | {seconds} | {megabytes} |\n",
            row.packages, row.ours
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(called: &str, compiler: Compiler) -> Row {
        let package = "swm-render".to_owned();
        Row {
            package,
            called: called.into(),
            default_features: false,
            packages: 9,
            ours: 1,
            compiler,
            figure: None,
        }
    }

    #[test]
    fn versions_of_rust_are_compared_by_value() {
        assert!(Compiler::new("1.100", "a") > Compiler::new("1.89.0", "b"));
        assert_eq!(Compiler::new("1.89.0", "a").number(), "1.89");
        // Of two that ask for the same, the first by name.
        assert!(Compiler::new("1.89", "a") > Compiler::new("1.89.0", "b"));
    }

    #[test]
    fn a_crate_that_promises_an_old_compiler_is_found() {
        let mut metadata = crate::metadata::fixture("swm-render:");
        metadata.packages[0].rust_version = Some("1.80".into());
        let new = || Compiler::new("1.89", "wide");
        assert!(row("none", new()).promises_too_much(&metadata).unwrap().contains("wide needs 1.89"));
        assert_eq!(row("scene", new()).promises_too_much(&metadata), None);
        assert_eq!(row("none", Compiler::new("1.80.1", "wide")).promises_too_much(&metadata), None);
    }

    #[test]
    fn the_name_of_a_crate_stands_once() {
        let measured = Row {
            figure: Some(Figure { seconds: 12.4, bytes: 1_260_000 }),
            ..row("scene", Compiler::new("1.89", "wide"))
        };
        let text = text(&[row("none", Compiler::default()), measured]);
        assert!(text.contains("| `swm-render` | none | 9 | 1 | - | - | - |"), "{text}");
        assert!(text.ends_with("|  | `scene` | 9 | 1 | 1.89 `wide` | 12 | 1.3 |\n"), "{text}");
    }
}
