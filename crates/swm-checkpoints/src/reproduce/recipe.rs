//! What it takes to repeat a published result, as data.

use std::path::{Component, Path};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::error::nearest;
use swm_core::evaluate::Tier;
use swm_data::OpenOptions;
use swm_tasks::request::{Fix, Message, TaskError};
use swm_tasks::text_file::{read_text, toml_error};

/// Those that this program has.
const RECIPES: [&str; 4] = [
    include_str!("recipes/lewm-pusht.toml"),
    include_str!("recipes/lewm-cube.toml"),
    include_str!("recipes/lewm-reacher.toml"),
    include_str!("recipes/lewm-tworooms.toml"),
];

/// A published result and what it takes to repeat it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Recipe {
    /// Its name: `lewm-pusht`.
    pub name: String,
    /// What it is, in a line.
    pub about: String,
    /// The environment's id.
    pub env: String,
    /// The side of the images that the model sees.
    pub image: usize,
    /// Settings of the environment, by name.
    #[serde(default)]
    pub env_option: Map<String, Json>,
    /// The model.
    pub checkpoint: Checkpoint,
    /// What starts and goals are taken from, and the scale of actions.
    pub dataset: Data,
    /// The solver and its settings.
    #[serde(default)]
    pub policy: Map<String, Json>,
    /// What was reported, each with its protocol.
    #[serde(rename = "figure")]
    pub figures: Vec<Figure>,
}

/// A published checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Checkpoint {
    /// What it is, as of `import`: `lewm`.
    pub model: String,
    /// `USER/REPO` on the Hugging Face Hub.
    pub repository: String,
    /// Its commit.
    pub revision: String,
    /// The name of its file of weights.
    pub weights: String,
    /// SHA-256 of that file; `None`: any.
    #[serde(default)]
    pub sha256: Option<String>,
    /// SHA-256 of its `config.json`.
    #[serde(default)]
    pub config_sha256: Option<String>,
    /// About how large it is, for people.
    #[serde(default)]
    pub size: Option<String>,
}

/// A published dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Data {
    /// The name of its file or folder, unpacked.
    pub name: String,
    /// `USER/REPO` of the dataset on the Hugging Face Hub.
    #[serde(default)]
    pub repository: Option<String>,
    /// The one file of the repository that is needed; `None`: all.
    #[serde(default)]
    pub file: Option<String>,
    /// The command that unpacks it, in the folder that it was fetched into.
    #[serde(default)]
    pub unpack: Option<String>,
    /// About how large the download is, for people.
    #[serde(default)]
    pub size: Option<String>,
    /// SHA-256 of the unpacked file; `None`: any.
    #[serde(default)]
    pub sha256: Option<String>,
    /// How it is opened: map, camera, … by name.
    #[serde(default)]
    pub opening: OpenOptions,
}

/// A reported success rate and its protocol: pairs that are made, or those of published manifests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Figure {
    /// A word: `moderate`.
    pub name: String,
    /// The protocol in words.
    pub protocol: String,
    /// The rate in percent.
    pub reported: f64,
    /// Its standard deviation over repetitions, where that was reported.
    #[serde(default)]
    pub std: Option<f64>,
    /// Where it was reported.
    pub source: String,
    /// Pairs that this program makes.
    #[serde(default)]
    pub made: Option<Made>,
    /// Manifests of CLEAR-LeWM.
    #[serde(default)]
    pub clear: Option<Clear>,
}

/// Pairs that are made from the dataset, as `swm manifest make` does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Made {
    /// How pairs are chosen, and what success is.
    pub tier: Tier,
    /// Pairs of one manifest.
    pub episodes: usize,
    /// The goal is this many steps after the start.
    pub goal_offset: usize,
    /// Actions allowed.
    pub budget: u64,
    /// The share of episodes that pairs of other tiers than historic are taken from.
    #[serde(default)]
    pub held_out: Option<f64>,
    /// A manifest for each seed.
    pub seeds: Vec<u64>,
}

/// Published manifests of CLEAR-LeWM.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Clear {
    /// `USER/REPO` on GitHub.
    pub repository: String,
    /// Its commit.
    pub revision: String,
    /// The manifests.
    pub manifest: Vec<ClearFile>,
}

/// A file of a repository.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ClearFile {
    /// Its path in the repository.
    pub path: String,
    /// The seed that it was made with.
    pub seed: u64,
    /// SHA-256 of it.
    pub sha256: String,
}

/// All recipes of this program.
pub fn recipes() -> Vec<Recipe> {
    RECIPES.iter().map(|text| toml::from_str(text).expect("tests read all of them")).collect()
}

impl Recipe {
    /// The recipe of this name.
    pub(super) fn named(name: &str) -> Result<Self, TaskError> {
        let all = recipes();
        if let Some(found) = all.iter().find(|recipe| recipe.name == name) {
            return Ok(found.clone());
        }
        let names: Vec<String> = all.into_iter().map(|recipe| recipe.name).collect();
        let hint = nearest(name, names.iter().map(String::as_str))
            .map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
        let reason = format!("is no recipe that this program has{hint}");
        Err(Message::about("name", name, reason).fix(Fix::Choose(names)).into())
    }

    /// The recipe in a file of TOML.
    pub(super) fn read(path: &Path) -> Result<Self, TaskError> {
        let wrong =
            |reason: &str| TaskError::from(Message::about("recipe", path.display().to_string(), reason));
        let text = read_text(path).map_err(|error| wrong(&error.to_string()))?;
        let recipe: Self = toml::from_str(&text).map_err(|error| wrong(&toml_error(&text, &error)))?;
        recipe.check().map_err(|reason| wrong(&reason))?;
        Ok(recipe)
    }

    /// What is wrong with it.
    pub(super) fn check(&self) -> Result<(), String> {
        let Self { checkpoint, dataset, figures, .. } = self;
        let paths =
            figures.iter().filter_map(|figure| figure.clear.as_ref()).flat_map(|clear| &clear.manifest);
        let paths = paths.map(|file| &file.path).chain([&checkpoint.weights, &dataset.name]);
        if let Some(path) = paths.into_iter().find(|path| !is_below(path)) {
            return Err(format!("`{path}` is no path below a folder"));
        }
        if checkpoint.repository.rsplit('/').next().is_none_or(|name| !is_below(name)) {
            return Err(format!(
                "the checkpoint's repository is `{}`; name it USER/REPO",
                checkpoint.repository
            ));
        }
        if figures.is_empty() {
            return Err("has no figure to compare with".to_owned());
        }
        for (at, figure) in figures.iter().enumerate() {
            let name = &figure.name;
            if !is_below(name) || name.contains('/') || figures[..at].iter().any(|other| other.name == *name)
            {
                return Err(format!("the figure's name `{name}` is no word, or given twice"));
            }
            if !(0.0..=100.0).contains(&figure.reported) {
                return Err(format!("{name}: reported {} is no percentage", figure.reported));
            }
            let manifests = match (&figure.made, &figure.clear) {
                (Some(made), None) => made.seeds.len(),
                (None, Some(clear)) => clear.manifest.len(),
                _ => return Err(format!("{name}: give its pairs as `made` or as `clear`")),
            };
            if manifests == 0 {
                return Err(format!("{name}: has no manifest"));
            }
        }
        Ok(())
    }
}

/// Whether a path leads below the folder that it is joined to.
fn is_below(path: &str) -> bool {
    let mut parts = Path::new(path).components().peekable();
    parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_recipes_are_sound() {
        let all = recipes();
        let names: Vec<&str> = all.iter().map(|recipe| recipe.name.as_str()).collect();
        assert_eq!(names, ["lewm-pusht", "lewm-cube", "lewm-reacher", "lewm-tworooms"]);
        for recipe in &all {
            recipe.check().unwrap();
            assert_eq!(recipe.checkpoint.sha256.as_ref().map(String::len), Some(64), "{}", recipe.name);
            let figures: Vec<&str> = recipe.figures.iter().map(|figure| figure.name.as_str()).collect();
            assert_eq!(figures, ["moderate", "strict", "historic"], "{}", recipe.name);
            let seeds: Vec<u64> = recipe.figures[0]
                .clear
                .iter()
                .flat_map(|clear| &clear.manifest)
                .map(|file| file.seed)
                .collect();
            assert_eq!(seeds, [0, 1, 42], "{}", recipe.name);
        }
        // Reported: README.md of CLEAR-LeWM, docs/baselines.md of stable-worldmodel.
        let reported = |at: usize| all[at].figures.iter().map(|figure| figure.reported).collect::<Vec<_>>();
        assert_eq!(reported(0), [86.33, 70.33, 96.0]);
        assert_eq!(reported(3), [84.0, 58.33, 87.0]);
    }

    #[test]
    fn wrong_recipes_are_refused() {
        let good = Recipe::named("lewm-cube").unwrap();
        let error = Recipe::named("lewm-cubes").unwrap_err();
        assert!(
            error.to_string().contains("that this program has (did you mean `lewm-cube`?); use lewm-"),
            "{error}"
        );
        assert!(matches!(error.fix(), Some(Fix::Choose(names)) if names.len() == 4));
        let wrong = |change: &dyn Fn(&mut Recipe)| {
            let mut recipe = good.clone();
            change(&mut recipe);
            recipe.check().unwrap_err()
        };
        assert!(wrong(&|recipe| recipe.dataset.name = "../x.h5".to_owned()).contains("no path below"));
        assert!(wrong(&|recipe| recipe.checkpoint.weights = "/etc/x".to_owned()).contains("no path below"));
        assert!(wrong(&|recipe| recipe.figures.clear()).contains("no figure"));
        assert!(wrong(&|recipe| recipe.figures[1].name = "moderate".to_owned()).contains("given twice"));
        assert!(wrong(&|recipe| recipe.figures[0].reported = 860.0).contains("no percentage"));
        assert!(wrong(&|recipe| recipe.figures[0].clear = None).contains("`made` or as `clear`"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recipe.toml");
        std::fs::write(&path, "name = \"x\"\nepisodes = 3\n").unwrap();
        let error = Recipe::read(&path).unwrap_err().to_string();
        assert!(error.contains("recipe.toml") && error.contains("episodes"), "{error}");
    }
}
