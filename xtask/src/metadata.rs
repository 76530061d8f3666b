//! The part of `cargo metadata` that the rules look at, as plain data.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::{Context as _, Result};
use serde::Deserialize;

use crate::process;

/// The workspace and everything it depends on, for every platform and with all features.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Metadata {
    /// Members and all crates that they depend on, directly or not.
    pub packages: Vec<Package>,
    /// Ids of the members.
    pub workspace_members: BTreeSet<String>,
    /// Which package got which others.
    pub resolve: Resolve,
    /// Where cargo builds.
    pub target_directory: PathBuf,
}

/// One crate at one version.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Package {
    pub id: String,
    pub name: String,
    pub version: String,
    pub description: Option<String>,
    /// SPDX expression; absent where the crate gives only a file.
    pub license: Option<String>,
    /// Where it comes from; none for a local path.
    pub source: Option<String>,
    /// Its Cargo.toml.
    pub manifest_path: PathBuf,
    pub repository: Option<String>,
    pub readme: Option<PathBuf>,
    pub keywords: Vec<String>,
    pub categories: Vec<String>,
    /// The oldest compiler that it promises to work with.
    pub rust_version: Option<String>,
    /// Where it may be published: none for everywhere, an empty list for nowhere.
    pub publish: Option<Vec<String>>,
    /// Its features, each with what it turns on.
    pub features: BTreeMap<String, Vec<String>>,
    /// Dependencies as the manifest declares them, optional and development ones included.
    pub dependencies: Vec<Dependency>,
    /// What it builds.
    pub targets: Vec<Target>,
}

/// A library, a program, a test, …
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Target {
    pub kind: Vec<String>,
}

/// A dependency as declared.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Dependency {
    pub name: String,
}

/// The resolved graph.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Resolve {
    pub nodes: Vec<Node>,
}

/// What one package got.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Node {
    pub id: String,
    pub deps: Vec<Edge>,
}

/// One resolved dependency.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Edge {
    pub pkg: String,
    pub dep_kinds: Vec<EdgeKind>,
}

/// Why it is there: `None` for a normal dependency, else `dev` or `build`.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct EdgeKind {
    pub kind: Option<String>,
}

impl Package {
    pub(crate) fn has_library(&self) -> bool {
        self.targets.iter().flat_map(|target| &target.kind).any(|kind| kind == "lib")
    }

    /// Whether it may go to a registry.
    pub(crate) fn is_published(&self) -> bool {
        self.publish.as_ref().is_none_or(|registries| !registries.is_empty())
    }
}

impl Metadata {
    /// Asks cargo.
    pub(crate) fn load() -> Result<Self> {
        let json =
            process::output(&mut process::cargo(["metadata", "--format-version=1", "--all-features"]))?;
        serde_json::from_slice(&json).context("failed to read what `cargo metadata` printed")
    }

    /// The crates of this workspace.
    pub(crate) fn members(&self) -> impl Iterator<Item = &Package> {
        self.packages.iter().filter(|package| self.workspace_members.contains(&package.id))
    }

    /// Names of all crates that end up in a build of `package` (development dependencies do not), without itself.
    pub(crate) fn built_into(&self, package: &Package) -> BTreeSet<&str> {
        let nodes: BTreeMap<&str, &Node> =
            self.resolve.nodes.iter().map(|node| (node.id.as_str(), node)).collect();
        let names: BTreeMap<&str, &str> =
            self.packages.iter().map(|package| (package.id.as_str(), package.name.as_str())).collect();
        let mut seen = BTreeSet::from([package.id.as_str()]);
        let mut queue = vec![package.id.as_str()];
        while let Some(id) = queue.pop() {
            for edge in nodes.get(id).map_or(&[][..], |node| &node.deps) {
                let is_built = edge.dep_kinds.iter().any(|kind| kind.kind.as_deref() != Some("dev"));
                if is_built && seen.insert(&edge.pkg) {
                    queue.push(&edge.pkg);
                }
            }
        }
        seen.remove(package.id.as_str());
        seen.into_iter().filter_map(|id| names.get(id).copied()).collect()
    }
}

/// Metadata of a made-up workspace: each line is `member: dependency …`; lines that start with `-` are foreign crates,
/// and a dependency written `~name` is for development.
#[cfg(test)]
pub(crate) fn fixture(text: &str) -> Metadata {
    let mut metadata = Metadata::default();
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let (name, dependencies) = line.split_once(':').expect("`name: dependencies`");
        let is_member = !name.starts_with('-');
        let name = name.trim_start_matches('-');
        let dependencies: Vec<&str> = dependencies.split_whitespace().collect();
        if is_member {
            metadata.workspace_members.insert(name.into());
        }
        metadata.packages.push(Package {
            id: name.into(),
            name: name.into(),
            version: "1.0.0".into(),
            description: Some("what it is".into()),
            license: Some("MIT OR Apache-2.0".into()),
            source: (!is_member).then(|| "registry+https://github.com/rust-lang/crates.io-index".into()),
            dependencies: dependencies
                .iter()
                .map(|name| Dependency { name: name.trim_start_matches('~').into() })
                .collect(),
            ..Package::default()
        });
        let edge = |name: &&str| Edge {
            pkg: name.trim_start_matches('~').into(),
            dep_kinds: vec![EdgeKind { kind: name.starts_with('~').then(|| "dev".into()) }],
        };
        metadata.resolve.nodes.push(Node { id: name.into(), deps: dependencies.iter().map(edge).collect() });
    }
    metadata
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_holds_indirect_dependencies_but_not_those_of_tests() {
        let metadata = fixture("a: b ~c\n-b: d\n-c: e\n-d:\n-e:");
        let a = metadata.members().next().unwrap();
        assert_eq!(metadata.built_into(a), BTreeSet::from(["b", "d"]));
    }

    #[test]
    fn cargo_knows_this_crate_and_its_dependencies() {
        let metadata = Metadata::load().unwrap();
        let xtask = metadata.members().find(|package| package.name == "xtask").unwrap();
        assert!(xtask.dependencies.iter().any(|dependency| dependency.name == "clap"));
        assert!(metadata.built_into(xtask).contains("clap_builder"));
        assert!(!xtask.has_library());
        assert!(
            metadata.packages.iter().find(|package| package.name == "clap_builder").unwrap().has_library()
        );
    }
}
