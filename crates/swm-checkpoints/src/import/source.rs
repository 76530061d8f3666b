//! Which files a checkpoint is made of: a folder, a file, or a repository in a local cache. Nothing is fetched.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_baselines::train::{LONGEST_CONFIG, YAML_CONFIGS};
use swm_core::evaluate::sha256;
use swm_tasks::request::{Assignment, Fix, Message, TaskError};
use swm_weights::ENDINGS;

use super::{cache, yaml};

/// What an export of this program notes beside a checkpoint.
const NOTES: &str = "swm.json";
/// The folder of an archive's weights, and the name of the last of them.
const ARCHIVE: (&str, &str) = ("checkpoints", "model_latest.pth");

/// What published weights are called.
const PUBLISHED: &str = "weights.pt";
/// What stands before the number of an epoch or a step: `weights_epoch_10.pt`, `epoch=9-step=500.ckpt`, not `bfloat16.pt`.
const MARKS: [&str; 5] = ["epoch", "step", "_", "-", "="];

/// The files of a checkpoint.
#[derive(Debug)]
pub(super) struct Source {
    /// Its folder, where it has one.
    pub(super) folder: Option<PathBuf>,
    /// Its weights; `None`: there is a config alone.
    pub(super) weights: Option<PathBuf>,
    /// Its config.
    pub(super) config: Option<ConfigFile>,
    /// What an export of this program notes beside it.
    pub(super) notes: Option<Json>,
}

impl Source {
    /// All of them that there are.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let config = self.config.as_ref().map(|config| PathBuf::from(&config.name));
        let notes = self.notes.as_ref().and(self.folder.as_ref()).map(|folder| folder.join(NOTES));
        [config, self.weights.clone(), notes].into_iter().flatten().collect()
    }
}

/// A config, and where it is from.
#[derive(Debug)]
pub(super) struct ConfigFile {
    /// The file, for messages.
    pub(super) name: String,
    pub(super) value: Json,
    pub(super) sha256: String,
}

/// The files that `from` names; of a folder with several files of weights, `file`.
pub(super) fn find(from: &str, file: Option<&str>) -> Result<Source, TaskError> {
    let path = match from.strip_prefix("hf:") {
        Some(repository) => cache::find(repository)?,
        None => PathBuf::from(from),
    };
    if path.is_file() {
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = match parent.file_name() {
            Some(name) if name == ARCHIVE.0 => parent.parent().unwrap_or(parent),
            _ => parent,
        };
        let configs = ["config.json"].into_iter().chain(YAML_CONFIGS);
        let is_config = path.file_name().is_some_and(|name| configs.into_iter().any(|config| name == config));
        let weights = (!is_config).then(|| path.clone());
        return with_config(Some(folder.to_owned()), weights);
    }
    if let Err(error) = fs::metadata(&path)
        && error.kind() == std::io::ErrorKind::PermissionDenied
    {
        return Err(Message::about("from", from, error.to_string()).into());
    }
    if !path.is_dir() {
        let message = Message::about("from", from, "there is no such file or folder");
        let is_repository =
            from.split('/').filter(|part| !part.is_empty()).count() == 2 && !from.starts_with(['.', '/']);
        return Err(match is_repository {
            true => message.fix(Fix::set("from", format!("hf:{from}"))).into(),
            false => message.into(),
        });
    }
    let weights = match file {
        Some(name) => {
            let found =
                [path.join(name), path.join(ARCHIVE.0).join(name)].into_iter().find(|file| file.is_file());
            let wrong = || Message::about("file", name, format!("{} has no such file", path.display()));
            Some(found.ok_or_else(wrong)?)
        }
        None => only_weights(&path)?,
    };
    if let Some(weights) = &weights {
        check_inside(&path, weights)?;
    }
    with_config(Some(path), weights)
}

/// The weights of a folder, if it has any: the one file of PyTorch's that the reference would take, else the one of any kind.
fn only_weights(folder: &Path) -> Result<Option<PathBuf>, TaskError> {
    let latest = folder.join(ARCHIVE.0).join(ARCHIVE.1);
    if latest.is_file() {
        return Ok(Some(latest));
    }
    let entries =
        fs::read_dir(folder).map_err(|error| Message::new(format!("{}: {error}", folder.display())))?;
    let ending = |path: &PathBuf| path.extension().and_then(|ending| ending.to_str()).map(str::to_owned);
    let mut all: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    all.retain(|path| {
        path.is_file() && ending(path).is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    });
    all.sort();
    let plain: Vec<&PathBuf> = all.iter().filter(|path| ending(path).as_deref() == Some("pt")).collect();
    match (&plain[..], &all[..]) {
        ([one], _) => Ok(Some((*one).clone())),
        ([], [one]) => Ok(Some(one.clone())),
        (_, []) => Ok(None),
        _ => {
            let index = all.iter().find_map(|path| {
                let (start, _) = path.file_name()?.to_str()?.split_once("-00001-of-")?;
                Some(format!("{start}.safetensors.index.json"))
            });
            if let Some(index) = index.filter(|index| plain.is_empty() && folder.join(index).is_file()) {
                let text = format!(
                    "{} holds its weights in {} parts ({index}), and one file is read; join them, in Python: `from safetensors.torch \
                     import load_file, save_file`, then `save_file({{k: v for part in PARTS for k, v in load_file(part).items()}}, \
                     \"weights.safetensors\")` into a folder with its config.json",
                    folder.display(),
                    all.len()
                );
                return Err(Message::new(text).into());
            }
            let several: Vec<&PathBuf> = if plain.is_empty() { all.iter().collect() } else { plain };
            let names: Vec<String> = several
                .iter()
                .map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned())
                .collect();
            let text =
                format!("{} holds {} files of weights: {}", folder.display(), names.len(), names.join(", "));
            // The last of several epochs, else the published one.
            let last = names.iter().filter(|name| number(name).is_some()).max_by_key(|name| number(name));
            let last = last.or_else(|| names.iter().find(|name| *name == PUBLISHED));
            Err(Message::new(text)
                .fix(last.map_or(Fix::give("file"), |last| Fix::set("file", last.as_str())))
                .into())
        }
    }
}

/// The number of an epoch or a step in the name of a file: the last that is marked as one.
fn number(name: &str) -> Option<u64> {
    let is_digit = |letter: char| letter.is_ascii_digit();
    let (mut rest, mut last) = (name, None);
    while let Some(start) = rest.find(is_digit) {
        let (before, from) = rest.split_at(start);
        let (digits, behind) = from.split_at(from.find(|letter| !is_digit(letter)).unwrap_or(from.len()));
        if MARKS.iter().any(|mark| before.ends_with(mark)) && !behind.starts_with(char::is_alphanumeric) {
            last = digits.parse().ok().or(last);
        }
        rest = behind;
    }
    last
}

/// Refuses a link that leads out of the folder, but for those of the Hub's cache, which lead to its blobs.
fn check_inside(folder: &Path, file: &Path) -> Result<(), TaskError> {
    let real = |path: &Path| {
        let found = path.canonicalize();
        found.map_err(|error| TaskError::from(Message::new(format!("{}: {error}", path.display()))))
    };
    let (inside, found) = (real(folder)?, real(file)?);
    let blobs = inside.ancestors().nth(2).map(|repository| repository.join("blobs"));
    if found.starts_with(&inside) || blobs.is_some_and(|blobs| found.starts_with(blobs)) {
        return Ok(());
    }
    let text = format!(
        "{} is a link out of its folder, to {}; name that file itself",
        file.display(),
        found.display()
    );
    Err(Message::new(text).into())
}

fn with_config(folder: Option<PathBuf>, weights: Option<PathBuf>) -> Result<Source, TaskError> {
    let beside = |name: &str| folder.as_ref().map(|folder| folder.join(name)).filter(|file| file.is_file());
    let config = match (beside("config.json"), YAML_CONFIGS.into_iter().find_map(beside)) {
        (Some(file), _) => Some(read_json(&file)?),
        (None, Some(file)) => Some(read_yaml(&file)?),
        (None, None) => None,
    };
    if let (Some(config), Some(folder)) = (&config, &folder)
        && config.value.get("version").is_some()
        && (config.value.get("model_config").is_some() || config.value.get("agent").is_some())
    {
        let text = format!("{} is a run of this program already; use it as it is", folder.display());
        return Err(Message::new(text).into());
    }
    if weights.is_none() && config.is_none() {
        let shown = folder.as_ref().map_or(String::new(), |folder| folder.display().to_string());
        return Err(Message::new(format!("{shown} holds neither weights nor a config.json")).into());
    }
    let notes = beside(NOTES).map(|file| read_json(&file)).transpose()?.map(|file| file.value);
    Ok(Source { folder, weights, config, notes })
}

fn read_text(file: &Path) -> Result<Vec<u8>, TaskError> {
    let wrong = |reason: String| Message::new(format!("{}: {reason}", file.display()));
    let len =
        File::open(file).and_then(|file| file.metadata()).map_err(|error| wrong(error.to_string()))?.len();
    if len > LONGEST_CONFIG {
        return Err(wrong(format!("{len} bytes are no config; {LONGEST_CONFIG} are read")).into());
    }
    fs::read(file).map_err(|error| wrong(error.to_string()).into())
}

fn read_json(file: &Path) -> Result<ConfigFile, TaskError> {
    let bytes = read_text(file)?;
    let name = file.display().to_string();
    let value = serde_json::from_slice(&bytes).map_err(|error| Message::new(format!("{name}: {error}")))?;
    Ok(ConfigFile { name, value, sha256: sha256(&bytes) })
}

fn read_yaml(file: &Path) -> Result<ConfigFile, TaskError> {
    let bytes = read_text(file)?;
    let name = file.display().to_string();
    let value = yaml::read_yaml(&String::from_utf8_lossy(&bytes))
        .map_err(|reason| Message::new(format!("{name}: {reason}")))?;
    Ok(ConfigFile { name, value, sha256: sha256(&bytes) })
}

/// A setting without a value.
pub(super) fn give(name: &str, to: &'static str) -> Fix {
    Fix::Set { setting: Assignment::name(name), to }
}

#[cfg(test)]
mod tests {
    use super::number;

    #[test]
    fn epochs_and_steps_are_told_from_other_numbers_in_names() {
        let cases = [
            ("weights_epoch_10.pt", Some(10)),
            ("epoch=9-step=500.ckpt", Some(500)),
            ("step12.pt", Some(12)),
            ("model-3.pth", Some(3)),
            ("bfloat16.pt", None),
            ("vit_16x16.pt", None),
            ("weights.pt", None),
            ("lewm_v2.pt", None),
        ];
        for (name, expected) in cases {
            assert_eq!(number(name), expected, "{name}");
        }
    }
}
