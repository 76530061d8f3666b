//! `swm new-env`: a crate with an environment of one's own, from a template.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;
use swm_tasks::request::make_folder;

use super::output::claim;
use super::{Failure, Output, usage};

/// The template's files. Its manifest has another name so that cargo does not take the folder for a package.
const FILES: [(&str, &str); 5] = [
    ("Cargo.toml", include_str!("../../templates/environment/Cargo.toml.txt")),
    ("README.md", include_str!("../../templates/environment/README.md")),
    ("src/lib.rs", include_str!("../../templates/environment/src/lib.rs")),
    ("src/main.rs", include_str!("../../templates/environment/src/main.rs")),
    ("tests/conformance.rs", include_str!("../../templates/environment/tests/conformance.rs")),
];
/// The crates of this workspace that the template builds: a line in its manifest is enough to use one.
const CRATES: [&str; 13] = [
    "swm",
    "swm-core",
    "swm-data",
    "swm-data-foreign",
    "swm-envs-2d",
    "swm-files",
    "swm-fov",
    "swm-jobs",
    "swm-lance",
    "swm-media",
    "swm-render",
    "swm-solvers",
    "swm-tasks",
];
/// The others, of which cargo would warn that nothing uses them.
const FURTHER: [&str; 11] = [
    "swm-baselines",
    "swm-checkpoints",
    "swm-data-lance",
    "swm-data-lerobot",
    "swm-envs-3d",
    "swm-envs-mujoco",
    "swm-mujoco",
    "swm-nn",
    "swm-onnx",
    "swm-ui",
    "swm-weights",
];

/// Names that cargo refuses, or that would hide a crate that the template uses.
const TAKEN: [&str; 12] = [
    "alloc",
    "core",
    "proc_macro",
    "std",
    "test",
    "build",
    "deps",
    "examples",
    "serde",
    "swm",
    "swm-core",
    "swm-fov",
];
/// Words of Rust, which cannot name a crate.
const KEYWORDS: [&str; 51] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate", "do", "dyn",
    "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop",
    "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "return", "self", "static",
    "struct", "super", "trait", "true", "try", "type", "typeof", "unsafe", "unsized", "use", "virtual",
    "where", "while", "yield",
];

/// Make a crate with a small environment, its conformance test and a command, to be changed into your own.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm new-env my-env
  swm new-env my-env --checkout ~/stable-worldmodel-rs     (build from this checkout, without the network)

In the new folder, `cargo test` builds the environment and its conformance test only: seconds, and no build tools. The command \
(`cargo run --release --features cli -- …`) builds in minutes, and needs a C compiler, cmake and ninja; MuJoCo's environments, MP4, training and \
others are features of `swm` in its Cargo.toml.")]
pub(super) struct NewEnv {
    /// Name of the crate: lower-case letters, digits, `-` and `_`.
    name: String,
    /// The folder to make. Default: the name.
    #[arg(long, short, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Take stable-worldmodel from this checkout. Default: from its repository, by git.
    #[arg(long, value_name = "DIR")]
    checkout: Option<PathBuf>,
}

impl NewEnv {
    pub(super) fn run(self, output: &Output) -> Result<(), Failure> {
        let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
        if !self.name.starts_with(|c: char| c.is_ascii_lowercase()) || !self.name.chars().all(is_name) {
            let reason = "a name begins with a letter, and has lower-case letters, digits, `-` and `_` only";
            return Err(usage(format!(
                "`{}` is no name of a crate: {reason}; --out names the folder",
                self.name
            )));
        }
        if KEYWORDS.contains(&self.name.as_str()) {
            return Err(usage(format!(
                "`{0}` is a word of Rust, and names no crate; use `my-{0}`",
                self.name
            )));
        }
        if TAKEN.contains(&self.name.as_str()) {
            return Err(usage(format!("`{0}` is the name of another crate; use `my-{0}`", self.name)));
        }
        let folder = self.out.clone().unwrap_or_else(|| PathBuf::from(&self.name));
        let _claim = claim(&folder)?;
        if fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(usage(format!("{} exists and is not empty; give another --out", folder.display())));
        }
        let source = self.source()?;
        let write = |name: &str, text: &str| {
            let path = folder.join(name);
            path.parent().map_or(Ok(()), make_folder)?;
            fs::write(&path, text)
                .map_err(|error| Failure::from(format!("cannot write {}: {error}", path.display())))
        };
        for (name, text) in FILES {
            let text = text.replace("{{project-name}}", &self.name);
            let mut text = text.replace("{{crate_name}}", &self.name.replace('-', "_"));
            if name == "Cargo.toml" {
                text += &source;
            }
            write(name, &text)?;
        }
        write(".gitignore", "target\n")?;
        if let Some(tools) = self.tools() {
            write(".cargo/config.toml", &tools)?;
        } else if !["cmake", "ninja"].into_iter().all(is_installed) {
            let of_setup = match &self.checkout {
                None => "--checkout takes those that `cargo xtask setup` put there".to_owned(),
                Some(checkout) => {
                    format!("`cargo xtask setup` puts both into {}, before this command", checkout.display())
                }
            };
            output.note(format!(
                "note: `cargo build --features cli` there builds HDF5 with cmake and ninja, which this machine lacks: `pip install cmake \
                 ninja` installs both, and {of_setup}"
            ));
        }
        let result = json!({"crate": self.name, "folder": folder});
        output.result(&result, || {
            format!(
                "made {}: `cargo test` there checks the environment, README.md says how to go on",
                folder.display()
            )
        })
    }

    /// Where cargo finds the crates of this workspace, as the end of a manifest.
    fn source(&self) -> Result<String, Failure> {
        let mut text =
            "\n# Where the crates are taken from, in place of the registry.\n[patch.crates-io]\n".to_owned();
        for name in CRATES.into_iter().chain(FURTHER) {
            if name == FURTHER[0] {
                text += "# Remove the `#` of those that you add to the dependencies.\n";
            }
            let place = match &self.checkout {
                None => toml::Table::from_iter([("git".to_owned(), env!("CARGO_PKG_REPOSITORY").into())]),
                Some(checkout) => {
                    let found = fs::canonicalize(checkout.join("crates").join(name)).map_err(|error| {
                        usage(format!("{} is no checkout of stable-worldmodel: {error}", checkout.display()))
                    })?;
                    toml::Table::from_iter([("path".to_owned(), found.display().to_string().into())])
                }
            };
            let mark = if FURTHER.contains(&name) { "# " } else { "" };
            text += &format!("{mark}{name} = {}\n", toml::Value::from(place));
        }
        Ok(text)
    }

    /// The build tools that `cargo xtask setup` put into the checkout, as a configuration of cargo.
    fn tools(&self) -> Option<String> {
        let tools = fs::canonicalize(self.checkout.as_ref()?.join(".tools")).ok()?;
        let at = |path: &str| Some(toml::Value::from(existing(&tools.join(path))?).to_string());
        let (cmake, ninja) = (at("cmake/cmake/data/bin/cmake")?, at("ninja/bin")?);
        // Tables, as in a checkout: cargo joins its configuration with those of the folders around, and refuses a text beside a table.
        let place = |path: String| format!("{{ value = {path}, relative = false }}");
        let (cmake, ninja) = (place(cmake), place(ninja));
        Some(format!(
            "# Build tools for the bundled HDF5.\n[env]\nCMAKE = {cmake}\nCMAKE_GENERATOR = \"Ninja\"\nCMAKE_PROGRAM_PATH = {ninja}\n"
        ))
    }
}

/// Whether a program is found by its name.
fn is_installed(program: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| folder.join(program).is_file())
}

fn existing(path: &Path) -> Option<String> {
    path.exists().then(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::{CRATES, FURTHER};

    #[test]
    fn every_crate_of_the_workspace_is_taken_from_the_checkout() {
        let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the folder of crates");
        let folders = std::fs::read_dir(crates).unwrap().map(|entry| entry.unwrap().file_name());
        let mut found: BTreeSet<String> =
            folders.map(|name| name.into_string().expect("names are ASCII")).collect();
        assert!(found.remove("swm-py"), "it is a package of Python, on which no crate depends");
        assert_eq!(found, CRATES.into_iter().chain(FURTHER).map(str::to_owned).collect());
    }

    #[test]
    fn the_template_has_the_features_that_it_names() {
        let manifest: toml::Table = include_str!("../../Cargo.toml").parse().unwrap();
        let features = manifest["features"].as_table().unwrap();
        let template = include_str!("../../templates/environment/Cargo.toml.txt");
        let named = template.lines().find_map(|line| line.split_once("Further features: ")).unwrap().1;
        let named: Vec<&str> = named.trim_end_matches('.').split(", ").chain(["cli", "faer"]).collect();
        let unknown: Vec<&&str> = named.iter().filter(|name| !features.contains_key(**name)).collect();
        assert!(unknown.is_empty(), "{unknown:?}");
        let missing: Vec<&String> = features.keys().filter(|name| !named.contains(&name.as_str())).collect();
        assert_eq!(missing, ["cuda", "default"]);
    }
}
