//! The zoo: trained models that are shipped, by name. Each is a [bundle](crate::bundle) with the recipe that made it:
//!
//! ```text
//! FOLDER/NAME/recipe.toml      what it is, and the commands that made it
//! FOLDER/NAME/…                a bundle: manifest, receipt, model, card, license, hashes of all
//! ```
//!
//! Folders are those of the variable `SWM_ZOO`, those that a program named ([`add_folder`]: that of the package `stable-worldmodel-zoo`, `zoo` in the data folder), and
//! `share/swm/zoo` beside the folder of the running program, as archives of releases have it. The first that has a name counts.
//!
//! A name becomes the policy of its receipt, with the model by its path ([`policy_of`]). So `zoo:NAME` is what was evaluated, and further
//! settings change it.

mod recipe;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde_json::Value as Json;
use swm_core::PolicyArgs;
use swm_core::error::{did_you_mean, nearest};

use crate::bundle::Bundle;
use crate::error::TaskError;

pub use recipe::{RECIPE, Recipe};

/// The policy of that name is one of the zoo, and so is a run whose path begins with it and a colon.
pub const ZOO: &str = "zoo";

/// More folders, as those of `PATH`: the first to look in.
pub const VARIABLE: &str = "SWM_ZOO";

static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
static INSTALL: Mutex<Option<String>> = Mutex::new(None);

/// How the package is installed, where a program says nothing better.
const HOW: &str = "`pip install stable_worldmodel_zoo-*.whl`, the wheel of a release, for Python; unpack the folder of a release into `zoo` of the data folder ($SWM_HOME), or \
                   make one in a checkout: `cargo xtask zoo NAME`";

/// Models are looked for in this folder, too, after those that are known. A folder that is not there holds none.
pub fn add_folder(folder: PathBuf) {
    let mut folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    if !folders.contains(&folder) {
        folders.push(folder);
    }
}

/// What errors advise where no model is there.
pub fn set_advice(how: String) {
    *INSTALL.lock().unwrap_or_else(PoisonError::into_inner) = Some(how);
}

/// How models are installed.
pub fn advice() -> String {
    INSTALL.lock().unwrap_or_else(PoisonError::into_inner).clone().unwrap_or_else(|| HOW.to_owned())
}

/// The folders in which models are looked for, in order.
pub fn folders() -> Vec<PathBuf> {
    let named = std::env::var_os(VARIABLE).unwrap_or_default();
    let mut folders: Vec<PathBuf> =
        std::env::split_paths(&named).filter(|folder| !folder.as_os_str().is_empty()).collect();
    folders.extend(FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned());
    let program = std::env::current_exe().ok();
    let prefix = program.as_deref().and_then(Path::parent).and_then(Path::parent);
    folders.extend(prefix.map(|prefix| prefix.join("share/swm/zoo")));
    folders
}

/// A model of the zoo.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct ZooModel {
    /// Its name.
    pub name: String,
    /// What it is, in one line.
    pub about: String,
    /// The environment's id.
    pub env: String,
    /// The policy that was evaluated, with the model by its path.
    pub policy: String,
    /// By its SPDX identifier.
    pub license: String,
    /// Of all of its files.
    pub bytes: u64,
    /// In percent, over [`ZooModel::pairs`] of the manifest.
    pub success_rate: f64,
    /// Wilson's interval of it, in percent.
    pub ci95: [f64; 2],
    /// Pairs of the manifest.
    pub pairs: usize,
    /// The manifest's tier.
    pub tier: String,
    /// The name of the bundle's content: SHA-256 of its list of hashes.
    pub hash: String,
    /// The commands that made it, without the program's name.
    pub steps: Vec<String>,
    /// Its folder: a bundle.
    pub folder: PathBuf,
    /// Its card.
    pub card: PathBuf,
    /// Its receipt.
    pub receipt: PathBuf,
}

impl ZooModel {
    /// The model in a folder, after a comparison of its hashes.
    ///
    /// # Errors
    ///
    /// As of [`Bundle::open`]; its recipe or its license is missing.
    pub fn open(folder: &Path) -> Result<Self, TaskError> {
        let bundle = Bundle::open(folder)?;
        let recipe = Recipe::read(&folder.join(RECIPE))?;
        let license = bundle
            .info
            .license
            .clone()
            .ok_or_else(|| format!("{} has no license; bundle it with one", folder.display()))?;
        let receipt = &bundle.receipt;
        Ok(Self {
            name: bundle.name(),
            about: recipe.about,
            env: bundle.info.env.clone(),
            policy: receipt.candidate.policy.to_string(),
            license,
            bytes: size(folder)?,
            success_rate: receipt.summary.success_rate,
            ci95: receipt.summary.ci95,
            pairs: receipt.manifest.pairs.len(),
            tier: receipt.manifest.tier.name().to_owned(),
            hash: bundle.hash,
            steps: recipe.steps,
            folder: folder.to_owned(),
            card: folder.join("MODEL_CARD.md"),
            receipt: folder.join("receipt.json"),
        })
    }
}

/// The folders of all models, by name.
pub fn all() -> BTreeMap<String, PathBuf> {
    within(&folders())
}

fn within(folders: &[PathBuf]) -> BTreeMap<String, PathBuf> {
    let mut found = BTreeMap::new();
    let entries = folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten().flatten();
    for entry in entries {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if path.join(RECIPE).is_file() && !name.starts_with('.') {
            found.entry(name).or_insert(path);
        }
    }
    found
}

/// The folder of the model of a name.
///
/// # Errors
///
/// There is none of that name, or none at all: the message has a suggestion, or how to install the zoo.
pub fn find(name: &str) -> Result<PathBuf, TaskError> {
    find_in(&folders(), name)
}

fn find_in(folders: &[PathBuf], name: &str) -> Result<PathBuf, TaskError> {
    let mut known = within(folders);
    if let Some(folder) = known.remove(name) {
        return Ok(folder);
    }
    if known.is_empty() {
        let how = advice();
        return Err(
            format!("there is no model zoo:{name}, as no model of the zoo is installed: {how}").into()
        );
    }
    let names: Vec<&str> = known.keys().map(String::as_str).collect();
    let meant = did_you_mean(nearest(name, names.iter().copied()).as_deref());
    Err(format!("there is no model zoo:{name}{meant}; the zoo has: {}", names.join(", ")).into())
}

/// The policy that arguments `zoo:NAME,…` stand for: that of the model's receipt, its settings changed by those that are given.
///
/// # Errors
///
/// There is no such model; its files were changed; or no name is given.
pub fn policy_of(args: &PolicyArgs) -> Result<PolicyArgs, TaskError> {
    let [Json::String(name)] = &args.positional[..] else {
        return Err("name one model of the zoo, as in `zoo:NAME`; `swm zoo` lists them".into());
    };
    let mut policy = Bundle::open(&find(name)?)?.receipt.candidate.policy;
    policy.named.extend(args.named.clone());
    Ok(policy)
}

/// The run that `path` names: that of a model of the zoo for `zoo:NAME`, else the path itself.
///
/// # Errors
///
/// As of [`policy_of`]; the model is no run.
pub fn run_of(path: &str) -> Result<PathBuf, TaskError> {
    let Some(name) = path.strip_prefix(ZOO).and_then(|rest| rest.strip_prefix(':')) else {
        return Ok(PathBuf::from(path));
    };
    let args = PolicyArgs::parse(path)?;
    match &policy_of(&args)?.positional[..] {
        [Json::String(run)] => Ok(PathBuf::from(run)),
        _ => Err(format!("zoo:{name} is no training run; use it as a policy, `zoo:{name}`").into()),
    }
}

/// Arguments whose names of the zoo are replaced by what they stand for, with paths of this machine: what can be bundled.
///
/// # Errors
///
/// As of [`policy_of`] and [`run_of`].
pub fn expanded(args: &PolicyArgs) -> Result<PolicyArgs, TaskError> {
    let mut args = if args.name == ZOO { policy_of(args)? } else { args.clone() };
    for value in args.positional.iter_mut().chain(args.named.values_mut()) {
        if let Some(text) = value.as_str().filter(|text| text.starts_with("zoo:")) {
            *value = run_of(text)?.display().to_string().into();
        }
    }
    Ok(args)
}

/// Bytes of all files below a folder.
fn size(folder: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let about = entry.metadata()?;
        bytes += if about.is_dir() { size(&entry.path())? } else { about.len() };
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_names_are_told_with_what_there_is() {
        let folder = tempfile::tempdir().unwrap();
        let folders = [folder.path().join("none"), folder.path().to_owned()];
        let said = find_in(&folders, "tworoom-gcbc").unwrap_err().to_string();
        assert!(said.contains("no model of the zoo is installed") && said.contains("pip install"), "{said}");
        for name in ["tworoom-gcbc", "pusht-gcsl", ".draft", "other"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        for name in ["tworoom-gcbc", "pusht-gcsl", ".draft"] {
            fs::write(folder.path().join(name).join(RECIPE), "").unwrap();
        }
        let said = find_in(&folders, "tworoom-gcb").unwrap_err().to_string();
        assert!(said.contains("did you mean `tworoom-gcbc`?"), "{said}");
        let said = find_in(&folders, "other").unwrap_err().to_string();
        assert!(said.ends_with("the zoo has: pusht-gcsl, tworoom-gcbc"), "{said}");
        assert_eq!(find_in(&folders, "pusht-gcsl").unwrap(), folder.path().join("pusht-gcsl"));
    }

    #[test]
    fn arguments_without_the_zoo_stay() {
        let args = PolicyArgs::parse("mpc:runs/a,samples=3").unwrap();
        assert_eq!(expanded(&args).unwrap(), args);
        assert_eq!(run_of("runs/zoo:a").unwrap(), Path::new("runs/zoo:a"));
        for text in ["zoo", "zoo:a,b"] {
            let said = policy_of(&PolicyArgs::parse(text).unwrap()).unwrap_err().to_string();
            assert!(said.contains("name one model of the zoo"), "{said}");
        }
    }
}
