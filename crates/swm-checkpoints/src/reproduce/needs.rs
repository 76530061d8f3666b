//! What must be downloaded, where it is looked for, and the commands that fetch it. Nothing is fetched unless that is asked for.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde::Serialize;
use swm_core::evaluate::sha256;
use swm_tasks::evaluation::file_hash;
use swm_tasks::request::{Fix, Message, TaskError};

use super::Reproduce;
use super::recipe::{Clear, Figure, Recipe};
use crate::import::cached;

/// The folder of CLEAR-LeWM's manifests, as a clone of the repository is called.
const CLONE: &str = "CLEAR-LeWM";

/// Something that a reproduction needs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Need {
    /// `checkpoint`, `dataset` or `manifest`.
    pub what: &'static str,
    /// Its file or folder where it was found; of a repository in a cache, `hf:USER/REPO@REVISION`.
    pub found: Option<String>,
    /// Where it is looked for.
    pub looked_in: Vec<String>,
    /// About how large it is.
    pub size: Option<String>,
    /// The words of the command that fetches it; empty where none does.
    pub fetch: Vec<String>,
    /// The command that unpacks it, in the same folder.
    pub unpack: Option<String>,
}

impl Need {
    /// What to do about it, in a line.
    pub fn advice(&self) -> String {
        let size = self.size.as_ref().map_or(String::new(), |size| format!(" ({size})"));
        let fetch = self.fetch.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
        let unpack =
            self.unpack.as_ref().map_or(String::new(), |unpack| format!(", then unpack it: {unpack}"));
        let fetch =
            if fetch.is_empty() { "name it".to_owned() } else { format!("fetch it: {fetch}{unpack}") };
        format!("{}{size}: not in {}; {fetch}", self.what, self.looked_in.join(", "))
    }
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "-_./:@=".contains(letter);
    if word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// The first of these that is there.
fn first(paths: &[PathBuf]) -> Option<String> {
    paths.iter().find(|path| path.exists()).map(|path| path.display().to_string())
}

fn shown(paths: &[PathBuf]) -> Vec<String> {
    paths.iter().map(|path| path.display().to_string()).collect()
}

/// Everything that the figures need: the checkpoint, the dataset, then manifests in the order of the figures.
pub(super) fn find(request: &Reproduce, recipe: &Recipe, figures: &[&Figure], folder: &Path) -> Vec<Need> {
    let mut needs = vec![checkpoint(request, recipe, folder), dataset(request, recipe, folder)];
    for clear in figures.iter().filter_map(|figure| figure.clear.as_ref()) {
        needs.extend(manifests(clear, folder));
    }
    needs
}

fn checkpoint(request: &Reproduce, recipe: &Recipe, folder: &Path) -> Need {
    let checkpoint = &recipe.checkpoint;
    let name = checkpoint.repository.rsplit('/').next().unwrap_or_default();
    let own = folder.join(name);
    let repository = format!("{}@{}", checkpoint.repository, checkpoint.revision);
    let found = match &request.checkpoint {
        Some(given) => Some(given.clone()),
        None if own.join(&checkpoint.weights).is_file() => Some(own.display().to_string()),
        // A cache that holds other revisions does not have it.
        None => cached(&repository).ok().flatten().map(|_| format!("hf:{repository}")),
    };
    let config = ["config.json", &checkpoint.weights];
    let words = ["hf", "download", &checkpoint.repository].into_iter().chain(config);
    let own = own.display().to_string();
    let options = ["--revision", &checkpoint.revision, "--local-dir", &own];
    Need {
        what: "checkpoint",
        found,
        looked_in: vec![own.clone(), "the Hub's cache".to_owned()],
        size: checkpoint.size.clone(),
        fetch: words.chain(options).map(str::to_owned).collect(),
        unpack: None,
    }
}

fn dataset(request: &Reproduce, recipe: &Recipe, folder: &Path) -> Need {
    let data = &recipe.dataset;
    let places = [folder.join(&data.name), folder.join("datasets").join(&data.name)];
    let found = match &request.dataset {
        Some(given) => Some(given.display().to_string()),
        None => first(&places),
    };
    let into = folder.display().to_string();
    let words = |repository: &str| {
        let options = ["--repo-type", "dataset", "--local-dir", &into];
        let words = ["hf", "download", repository].into_iter().chain(data.file.as_deref()).chain(options);
        words.map(str::to_owned).collect()
    };
    Need {
        what: "dataset",
        found,
        looked_in: shown(&places),
        size: data.size.clone(),
        fetch: data.repository.as_deref().map(words).unwrap_or_default(),
        unpack: data.unpack.clone(),
    }
}

fn manifests<'a>(clear: &'a Clear, folder: &'a Path) -> impl Iterator<Item = Need> + 'a {
    clear.manifest.iter().map(move |file| {
        let places = manifest_places(folder, &file.path);
        let Clear { repository, revision, .. } = clear;
        let address = format!("https://raw.githubusercontent.com/{repository}/{revision}/{}", file.path);
        let into = places[0].display().to_string();
        let words = ["curl", "--fail", "--location", "--create-dirs", "--output", &into, &address];
        Need {
            what: "manifest",
            found: first(&places),
            looked_in: shown(&places),
            size: None,
            fetch: words.map(str::to_owned).to_vec(),
            unpack: None,
        }
    })
}

fn manifest_places(folder: &Path, path: &str) -> [PathBuf; 2] {
    [folder.join(CLONE).join(path), folder.join(path)]
}

/// The file of a manifest of CLEAR-LeWM, which must be the one of the recipe.
pub(super) fn manifest(folder: &Path, path: &str, hash: &str) -> Result<PathBuf, TaskError> {
    let places = manifest_places(folder, path);
    let found = places.iter().find(|place| place.is_file()).unwrap_or(&places[0]);
    let bytes = std::fs::read(found).map_err(|error| wrong(found, &error.to_string()))?;
    match sha256(&bytes) {
        same if same == hash => Ok(found.clone()),
        other => {
            Err(wrong(found, &format!("its SHA-256 is {other}, and that of the recipe's manifest {hash}")))
        }
    }
}

/// Refuses weights that are not those of the recipe.
pub(super) fn check_weights(file: &Path, recipe: &Recipe) -> Result<(), TaskError> {
    let Some(wanted) = &recipe.checkpoint.sha256 else { return Ok(()) };
    match file_hash(file)? {
        same if same == *wanted => Ok(()),
        other => {
            let text = format!(
                "{} has the SHA-256 {other}, and the weights of {} at {} have {wanted}: it is another checkpoint",
                file.display(),
                recipe.checkpoint.repository,
                recipe.checkpoint.revision
            );
            Err(Message::new(text).fix(Fix::Change("checkpoint")).into())
        }
    }
}

fn wrong(file: &Path, reason: &str) -> TaskError {
    Message::new(format!("{}: {reason}", file.display())).into()
}

/// Runs a command, and whether it succeeded.
pub(super) type Start<'a> = dyn FnMut(&[String]) -> io::Result<bool> + 'a;

/// Starts a program of the system; what it prints goes to the standard error alone.
pub(super) fn start(words: &[String]) -> io::Result<bool> {
    let [program, arguments @ ..] = words else { return Ok(false) };
    Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .status()
        .map(|done| done.success())
}

/// Fetches what is missing.
pub(super) fn fetch(needs: &[Need], start: &mut Start<'_>) -> Result<(), TaskError> {
    for need in needs.iter().filter(|need| need.found.is_none() && !need.fetch.is_empty()) {
        let program = &need.fetch[0];
        let reason = match start(&need.fetch) {
            Ok(true) => continue,
            Ok(false) => format!("`{program}` failed"),
            Err(error) => format!("`{program}` cannot be started ({error})"),
        };
        return Err(Message::new(format!("{reason}; {}", need.advice())).into());
    }
    Ok(())
}

/// Refuses to begin without what is missing.
pub(super) fn check_found(recipe: &Recipe, needs: &[Need]) -> Result<(), TaskError> {
    let missing: Vec<String> = needs
        .iter()
        .filter(|need| need.found.is_none())
        .map(|need| format!("\n  {}", need.advice()))
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let text = format!("{} needs what is not there:{}\n", recipe.name, missing.concat());
    Err(Message::new(text.trim_end()).fix(Fix::set_to("fetch", true, "to fetch all of it")).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> Reproduce {
        // In no cache of this machine.
        Reproduce { name: "lewm-pusht".to_owned(), ..Reproduce::default() }
    }

    fn recipe() -> Recipe {
        let mut recipe = Recipe::named("lewm-pusht").unwrap();
        recipe.checkpoint.repository = "nobody-here/no-such-repository".to_owned();
        recipe
    }

    #[test]
    fn what_is_missing_is_named_with_the_command_that_fetches_it() {
        let folder = tempfile::tempdir().unwrap();
        let recipe = recipe();
        let figures: Vec<&Figure> = recipe.figures.iter().collect();
        let needs = || find(&request(), &recipe, &figures, folder.path());
        let missing = needs();
        assert_eq!(missing.len(), 2 + 6);
        assert!(missing.iter().all(|need| need.found.is_none()));
        let text = check_found(&recipe, &missing).unwrap_err().to_string();
        let into = folder.path().display();
        for part in [
            &*format!(
                "hf download nobody-here/no-such-repository config.json weights.pt --revision {}",
                recipe.checkpoint.revision
            ),
            &format!(
                "hf download quentinll/lewm-pusht pusht_expert_train.h5.zst --repo-type dataset --local-dir {into}"
            ),
            "then unpack it: zstd -d pusht_expert_train.h5.zst",
            &format!("{into}/CLEAR-LeWM/manifests/v0.5/pusht/strict-seed42-n100.json"),
            "(13.1 GB)",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }

        // Fetched into the places that are named.
        let mut begun = Vec::new();
        let mut stand_in = |words: &[String]| {
            begun.push(words[0].clone());
            let path = |option: &str| {
                PathBuf::from(&words[1 + words.iter().position(|word| word == option).unwrap()])
            };
            let file = match words[0].as_str() {
                "curl" => path("--output"),
                _ if words.contains(&"dataset".to_owned()) => {
                    path("--local-dir").join("pusht_expert_train.h5")
                }
                _ => path("--local-dir").join("weights.pt"),
            };
            std::fs::create_dir_all(file.parent().unwrap())?;
            std::fs::write(file, "{}")?;
            Ok(true)
        };
        fetch(&missing, &mut stand_in).unwrap();
        assert_eq!(begun.join(" "), "hf hf curl curl curl curl curl curl");
        let found = needs();
        assert!(found.iter().all(|need| need.found.is_some()), "{found:?}");
        check_found(&recipe, &found).unwrap();
        fetch(&found, &mut |_| panic!("all is there")).unwrap();

        // Files that are others than the recipe's.
        let [weights, text] = [
            folder.path().join("no-such-repository/weights.pt"),
            "manifests/v0.5/pusht/strict-seed1-n100.json".into(),
        ];
        let error = check_weights(&weights, &recipe).unwrap_err();
        assert!(error.to_string().contains("it is another checkpoint"), "{error}");
        let error = manifest(folder.path(), text.to_str().unwrap(), &"0".repeat(64)).unwrap_err();
        assert!(error.to_string().contains("its SHA-256 is 44136fa355b3678a"), "{error}");
    }

    #[test]
    fn a_download_that_fails_ends_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let recipe = recipe();
        let needs = find(&request(), &recipe, &[], folder.path());
        let error = fetch(&needs, &mut |_| Ok(false)).unwrap_err().to_string();
        assert!(error.contains("`hf` failed; checkpoint (72 MB): not in"), "{error}");
        let error = fetch(&needs, &mut |_| Err(io::ErrorKind::NotFound.into())).unwrap_err().to_string();
        assert!(error.contains("`hf` cannot be started"), "{error}");
        assert_eq!(quoted("a b'c"), "'a b'\\''c'");
    }
}
