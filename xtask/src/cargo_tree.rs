//! What a build of one crate pulls in, by `cargo tree`: exact for its features, where the graph of `cargo metadata` joins
//! those of the whole workspace. Development dependencies are not in it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use anyhow::{Context as _, Result, bail};

use crate::process;

/// The platform that tables and archives speak of, whatever machine makes them.
pub(crate) const PLATFORM: &str = "x86_64-unknown-linux-gnu";

/// One way to build a crate.
#[derive(Clone, Debug)]
pub(crate) struct Build {
    pub package: String,
    pub default_features: bool,
    pub features: Vec<String>,
}

/// A crate at a version.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Unit {
    pub name: String,
    pub version: String,
}

/// Who depends on whom.
#[derive(Debug)]
pub(crate) struct CargoTree {
    /// The crate that is built.
    pub root: Unit,
    /// Every crate of the build, the root among them, and what it depends on directly.
    pub edges: BTreeMap<Unit, BTreeSet<Unit>>,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.name, self.version)
    }
}

impl Build {
    /// Asks cargo.
    pub(crate) fn tree(&self) -> Result<CargoTree> {
        let mut command = process::cargo(["tree", "--edges=normal,build", "--prefix=depth", "--format={p}"]);
        let lines = process::output(command.args(["--target", PLATFORM]).args(self.selection()))?;
        let lines = String::from_utf8(lines).context("`cargo tree` printed no UTF-8")?;
        CargoTree::parse(&lines).with_context(|| format!("`cargo tree` of {}", self.package))
    }

    /// Cargo's options for it.
    pub(crate) fn selection(&self) -> Vec<String> {
        let mut options = vec!["--package".to_owned(), self.package.clone()];
        if !self.default_features {
            options.push("--no-default-features".into());
        }
        if !self.features.is_empty() {
            options.extend(["--features".into(), self.features.join(",")]);
        }
        options
    }
}

impl CargoTree {
    /// Lines such as `1swm-core v0.1.0 (path)`, each below the last line before it whose number is one less; what was shown
    /// above is marked `(*)` and not shown again.
    fn parse(lines: &str) -> Result<Self> {
        let mut edges: BTreeMap<Unit, BTreeSet<Unit>> = BTreeMap::new();
        let mut above: Vec<Unit> = Vec::new();
        for line in lines.lines().filter(|line| !line.is_empty()) {
            let digits = line.find(|c: char| !c.is_ascii_digit()).unwrap_or(line.len());
            let depth: usize = line[..digits].parse().with_context(|| format!("no depth in `{line}`"))?;
            let mut words = line[digits..].split_whitespace();
            let (Some(name), Some(version)) =
                (words.next(), words.next().and_then(|word| word.strip_prefix('v')))
            else {
                bail!("no crate in `{line}`");
            };
            let unit = Unit { name: name.into(), version: version.into() };
            above.truncate(depth);
            if let Some(parent) = above.last() {
                edges.entry(parent.clone()).or_default().insert(unit.clone());
            }
            edges.entry(unit.clone()).or_default();
            above.push(unit);
        }
        let root = above.into_iter().next().context("it is empty")?;
        Ok(Self { root, edges })
    }

    /// Every crate of the build but the one that is built.
    pub(crate) fn dependencies(&self) -> impl Iterator<Item = &Unit> {
        self.edges.keys().filter(|unit| **unit != self.root)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_become_edges_and_repeated_crates_keep_theirs() {
        let tree = CargoTree::parse(
            "0a v0.1.0 (/somewhere)\n1b v1.0.0+c.2\n2d v3.0.0 (proc-macro)\n1c v2.0.0\n2b v1.0.0+c.2 (*)\n",
        )
        .unwrap();
        let shown: Vec<String> = tree
            .edges
            .iter()
            .map(|(unit, on)| {
                format!("{unit}: {}", on.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "))
            })
            .collect();
        assert_eq!(
            shown,
            ["a 0.1.0: b 1.0.0+c.2, c 2.0.0", "b 1.0.0+c.2: d 3.0.0", "c 2.0.0: b 1.0.0+c.2", "d 3.0.0: "]
        );
        assert_eq!(tree.dependencies().count(), 3);
        assert!(CargoTree::parse("a v1").is_err() && CargoTree::parse("").is_err());
    }

    #[test]
    fn features_change_what_is_pulled_in() {
        let build = |features: &[&str]| Build {
            package: "swm-render".into(),
            default_features: false,
            features: features.iter().map(ToString::to_string).collect(),
        };
        let has_wide = |build: Build| build.tree().unwrap().dependencies().any(|unit| unit.name == "wide");
        assert!(!has_wide(build(&[])));
        assert!(has_wide(build(&["scene"])));
    }
}
