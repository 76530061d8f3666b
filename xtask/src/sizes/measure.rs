//! How long a build takes from nothing, and how large a small program with the crate is; and the file where figures are kept.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

use super::builds::Choice;
use crate::{process, setup};

/// What was measured of one build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Figure {
    /// CPU time of an optimized build of everything, all cores together.
    pub seconds: f64,
    /// The program, without symbols.
    pub bytes: u64,
}

/// By crate, then by choice.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Figures(BTreeMap<String, BTreeMap<String, Figure>>);

impl Figures {
    pub(super) fn load() -> Result<Self> {
        toml::from_str(&fs::read_to_string(path()).context("no xtask/recipes/sizes.toml")?)
            .context("xtask/recipes/sizes.toml")
    }

    pub(super) fn get(&self, choice: &Choice) -> Option<Figure> {
        self.0.get(&choice.build.package)?.get(&choice.called).cloned()
    }

    /// Keeps a figure, in the file too: the next may take long.
    pub(super) fn insert(&mut self, choice: &Choice, figure: Figure) -> Result<()> {
        self.0.entry(choice.build.package.clone()).or_default().insert(choice.called.clone(), figure);
        let text = format!("# Written by `cargo xtask sizes --measure`.\n\n{}", toml::to_string(self)?);
        fs::write(path(), text).context("cannot write xtask/recipes/sizes.toml")
    }
}

fn path() -> PathBuf {
    process::root().join("xtask/recipes/sizes.toml")
}

/// The program of each crate: a few lines that make it work. The others get one that calls nothing.
const PROGRAMS: &[(&str, &str)] = &[
    (
        "swm",
        "fn main() { let registry = swm::registry(); println!(\"{}\", registry.envs().filter(|env| env.make(&Default::default()).is_ok()).count()); }",
    ),
    ("swm-core", "fn main() { println!(\"{:?}\", swm_core::Registry::new().env(\"none\").err()); }"),
    (
        "swm-data",
        "fn main() { println!(\"{:?}\", swm_data::open(std::path::Path::new(\"none.h5\")).err()); }",
    ),
    (
        "swm-envs-2d",
        "fn main() { println!(\"{}\", swm_envs_2d::ENVS.iter().filter(|env| env.make(&Default::default()).is_ok()).count()); }",
    ),
    (
        "swm-envs-3d",
        "fn main() { println!(\"{}\", swm_envs_3d::ENVS.iter().filter(|env| env.make(&Default::default()).is_ok()).count()); }",
    ),
    (
        "swm-envs-mujoco",
        "fn main() { println!(\"{}\", swm_envs_mujoco::ENVS.iter().filter(|env| env.make(&Default::default()).is_ok()).count()); }",
    ),
    (
        "swm-fov",
        "fn main() { println!(\"{:?}\", swm_fov::FovSpace::new(vec![swm_fov::Factor::scalar(\"a\", 0.0, 1.0, 0.5)])); }",
    ),
    (
        "swm-media",
        "fn main() { println!(\"{:?}\", swm_media::Clip::new(16, 24, 10.0).save(std::path::Path::new(\"none.gif\"))); }",
    ),
    ("swm-mujoco", "fn main() { println!(\"{:?}\", swm_mujoco::Library::get().is_ok()); }"),
    (
        "swm-render",
        "use swm_render::{Geometry, Renderer, Style}; fn main() { println!(\"{:?}\", Renderer::new(Style::Exact, Geometry::new(64, 64)).is_ok()); }",
    ),
];

/// Builds a program with the crate from nothing in a folder of its own. The build directory of the workspace does not help.
pub(super) fn measure(choice: &Choice) -> Result<Figure> {
    eprintln!("sizes: measuring {}", choice.name());
    let folder = tempfile::tempdir().context("no folder for a program")?;
    let write =
        |name: &str, text: &str| fs::write(folder.path().join(name), text).with_context(|| name.to_owned());
    write("Cargo.toml", &manifest(choice)?)?;
    let name = &choice.build.package;
    let default = format!("use {} as _; fn main() {{}}", name.replace('-', "_"));
    let program =
        PROGRAMS.iter().find(|(package, _)| package == name).map_or(default.as_str(), |(_, text)| text);
    write("main.rs", program)?;
    let lock = process::root().join("Cargo.lock");
    fs::copy(lock, folder.path().join("Cargo.lock")).context("no Cargo.lock")?;

    let mut build = process::cargo(["build", "--release", "--quiet", "--config"]);
    build.arg(process::root().join(".cargo/config.toml")).current_dir(folder.path());
    build.env("CARGO_TARGET_DIR", folder.path().join("target")).envs(setup::tools::protoc());
    let before = cpu_seconds_of_children()?;
    process::run(&mut build)?;
    let seconds = cpu_seconds_of_children()? - before;
    let bytes = fs::metadata(folder.path().join("target/release/probe")).context("no program")?.len();
    Ok(Figure { seconds: (seconds * 10.0).round() / 10.0, bytes })
}

fn manifest(choice: &Choice) -> Result<String> {
    let mut dependency = toml::Table::new();
    let path = process::root().join("crates").join(&choice.build.package);
    dependency.insert("path".into(), path.display().to_string().into());
    dependency.insert("default-features".into(), choice.build.default_features.into());
    dependency.insert("features".into(), choice.build.features.clone().into());
    let mut manifest = toml::toml! {
        [package]
        name = "probe"
        version = "0.0.0"
        edition = "2024"
        [workspace]
        [[bin]]
        name = "probe"
        path = "main.rs"
        [profile.release]
        strip = true
    };
    let dependencies = toml::Table::from_iter([(choice.build.package.clone(), dependency.into())]);
    manifest.insert("dependencies".into(), dependencies.into());
    Ok(toml::to_string(&manifest)?)
}

/// What programs that we started and that have ended have used of all CPUs, as Linux counts it: `man 5 proc`, cutime
/// and cstime, in ticks of 10 ms.
fn cpu_seconds_of_children() -> Result<f64> {
    let line = fs::read_to_string("/proc/self/stat").context("CPU time is measured on Linux only")?;
    parse_stat(&line).context("/proc/self/stat has another form")
}

fn parse_stat(line: &str) -> Option<f64> {
    // The second field, the name, may hold blanks; it ends with the last parenthesis.
    let fields: Vec<&str> = line.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |index: usize| fields.get(index)?.parse::<f64>().ok();
    Some((ticks(13)? + ticks(14)?) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::Metadata;

    #[test]
    fn the_time_of_children_stands_behind_our_own() {
        let line = "7 (a b) c) S 1 2 3 4 5 6 7 8 9 10 11 12 250 150 20 0";
        assert_eq!(parse_stat(line), Some(4.0));
        assert_eq!(parse_stat("7 (a)"), None);
    }

    #[test]
    fn every_program_is_of_a_crate_that_exists() {
        let metadata = Metadata::load().unwrap();
        assert!(PROGRAMS.iter().all(|(name, _)| metadata.members().any(|package| package.name == *name)));
    }
}
