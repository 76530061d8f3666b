//! Repositories of the Hugging Face Hub that were fetched before: in its own cache, or in the reference's.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use swm_tasks::request::{Message, TaskError};

/// The folder of a repository, `USER/REPO` or `USER/REPO@REVISION`.
pub(super) fn find(repository: &str) -> Result<PathBuf, TaskError> {
    if let Some(found) = look(repository)? {
        return Ok(found);
    }
    let name = repository.split_once('@').map_or(repository, |(name, _)| name);
    let hub = hub().map_or_else(|| "the Hub's cache".to_owned(), |hub| hub.display().to_string());
    let text = format!(
        "hf:{name} is not in {hub}; fetch it with `hf download {name}`, or put its config.json and weights into a folder"
    );
    Err(Message::new(text).into())
}

/// The same; `None` where it is in no cache.
pub(super) fn look(repository: &str) -> Result<Option<PathBuf>, TaskError> {
    let (name, revision) = repository.split_once('@').unwrap_or((repository, "main"));
    let sound = |part: &str| {
        !part.is_empty()
            && part != "."
            && part != ".."
            && part.chars().all(|letter| letter.is_ascii_alphanumeric() || "-_.".contains(letter))
    };
    let Some((user, model)) =
        name.split_once('/').filter(|(user, model)| sound(user) && sound(model) && sound(revision))
    else {
        return Err(Message::about(
            "from",
            format!("hf:{repository}"),
            "name it as hf:USER/REPO or hf:USER/REPO@REVISION",
        )
        .into());
    };
    let folder = format!("models--{user}--{model}");
    let hub = hub();
    if let Some(hub) = &hub
        && let Some(found) = snapshot(&hub.join(&folder), revision)?
    {
        return Ok(Some(found));
    }
    let home =
        env::var_os("STABLEWM_HOME").map(PathBuf::from).or_else(|| Some(home()?.join(".stable_worldmodel")));
    Ok(home.map(|home| home.join("checkpoints").join(&folder)).filter(|path| path.is_dir()))
}

fn home() -> Option<PathBuf> {
    env::var_os("HOME").map(PathBuf::from)
}

/// The Hub's cache.
fn hub() -> Option<PathBuf> {
    let of = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    of("HF_HUB_CACHE").or_else(|| Some(of("HF_HOME")?.join("hub"))).or_else(|| {
        let cache = of("XDG_CACHE_HOME").or_else(|| Some(home()?.join(".cache")))?;
        Some(cache.join("huggingface/hub"))
    })
}

/// The files of a revision: the one that `refs` names, or the only one.
fn snapshot(repository: &Path, revision: &str) -> Result<Option<PathBuf>, TaskError> {
    let snapshots = repository.join("snapshots");
    let named = fs::read_to_string(repository.join("refs").join(revision)).ok();
    let named = named
        .map(|commit| commit.trim().to_owned())
        .filter(|commit| commit.chars().all(|c| c.is_ascii_alphanumeric()));
    for commit in named.iter().map(String::as_str).chain([revision]) {
        if snapshots.join(commit).is_dir() {
            return Ok(Some(snapshots.join(commit)));
        }
    }
    let Ok(entries) = fs::read_dir(&snapshots) else { return Ok(None) };
    let mut all: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    all.sort();
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let begins: Vec<&PathBuf> = all.iter().filter(|path| name(path).starts_with(revision)).collect();
    match (&begins[..], &all[..]) {
        ([one], _) => Ok(Some((*one).clone())),
        (_, [one]) if revision == "main" => Ok(Some(one.clone())),
        (_, []) => Ok(None),
        _ => {
            let names: Vec<String> = all.iter().map(name).collect();
            let text = format!(
                "{} has several revisions: {}; name one with @REVISION",
                repository.display(),
                names.join(", ")
            );
            Err(Message::new(text).into())
        }
    }
}
