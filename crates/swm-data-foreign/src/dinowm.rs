//! Folders of DINO-WM: tensors `[episodes, longest episode, …]`, padded, and a video or a tensor of images for each episode.
//!
//! Source of the layout: dino_wm 0a9492f, `datasets/*_dset.py`.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_data::OpenOptions;
use swm_data::dataset::Dataset;
use swm_data::error::{At as _, DataError, FormatError, Result, invalid, missing, unsupported};

use super::array::{Divided, Joined, Scratch, Shared, numbers};
use super::dataset::Span;
use super::found::{Found, Source};
use super::torch::{Archive, TensorFile, pickled_integers};

pub(super) const NAME: &str = "dinowm";

/// What `rel_actions` are divided by: `action_scale` of their loader, which gives the actions of PushT.
const ACTION_SCALE: f32 = 100.0;
/// Rows per second of PushT's recordings.
const PUSHT_FPS: f64 = 10.0;

pub(super) fn detect(path: &Path) -> bool {
    part(path, None).is_ok_and(|(folder, _)| folder.join("states.pth").is_file())
}

/// The folder of a part, and the names of the parts that there are.
fn part(path: &Path, split: Option<&str>) -> Result<(PathBuf, Vec<String>), DataError> {
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    let is_part = |name: &String| path.join(name).join("states.pth").is_file();
    let mut parts: Vec<String> =
        entries.filter_map(|entry| entry.file_name().into_string().ok()).filter(is_part).take(1000).collect();
    parts.sort();
    let chosen = match split {
        None if path.join("states.pth").is_file() => return Ok((path.to_owned(), Vec::new())),
        None if parts.iter().any(|part| part == "train") => "train".to_owned(),
        None => parts.first().cloned().unwrap_or_default(),
        Some(split) if parts.iter().any(|part| part == split) => split.to_owned(),
        Some(split) => {
            let reason = match &parts[..] {
                [] => format!("the folder has no parts, so no `{split}` either; leave it out"),
                parts => format!("the folder has no part `{split}`; it has {}", parts.join(", ")),
            };
            return Err(DataError::Option { option: "split", reason });
        }
    };
    Ok((path.join(&chosen), parts))
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let (folder, parts) = part(path, options.split.as_deref())?;
    let mut found = find(&folder).map_err(|error| DataError::damaged(path, error))?;
    if options.split.is_none() && parts.len() > 1 {
        let name = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        found.notes.push(format!(
            "this is the part `{name}` of {}; the option `split` names another",
            parts.join(", ")
        ));
    }
    found.open(path, NAME, options, &["split"])
}

/// A padded tensor: rows of all episodes end to end, and the numbers of episodes and steps.
fn padded(folder: &Path, name: &str) -> Result<Option<(Shared, [usize; 2])>> {
    let path = folder.join(name);
    if !path.is_file() {
        return Ok(None);
    }
    let (tensor, sizes) = Archive::open(&path).and_then(|archive| archive.tensor()?.by_step()).at(name)?;
    Ok(Some((Arc::new(tensor), sizes)))
}

fn find(folder: &Path) -> Result<Found> {
    let (states, sizes) = padded(folder, "states.pth")?.ok_or_else(|| missing("`states.pth` is missing"))?;
    let [episodes, steps] = sizes;
    let optional = |name: &str| match padded(folder, name)? {
        Some((_, found)) if found != sizes => {
            Err(invalid(format!("`{name}` is of {found:?} episodes and steps, `states.pth` of {sizes:?}")))
        }
        array => Ok(array.map(|(array, _)| array)),
    };
    let lengths = lengths(folder, episodes, steps)?;
    let mut found = Found { lengths, ..Found::default() };
    let spans = found.lengths.iter().enumerate();
    let spans: Vec<Span> =
        spans.map(|(episode, &count)| Span { array: 0, first: episode * steps, count, tail: None }).collect();
    let step = |old: &str, new: &str, array: Shared| Source::step(old, new, vec![array], spans.clone());
    let velocities = optional("velocities.pth")?;
    let relative = optional("rel_actions.pth")?;
    let is_pusht = relative.is_some()
        && states.shape() == [5]
        && velocities.as_ref().is_some_and(|velocities| velocities.shape() == [2]);
    match velocities {
        Some(velocities) if states.shape().len() == 1 && velocities.shape().len() == 1 => {
            let whole = vec![(states.clone(), states.dim()), (velocities.clone(), velocities.dim())];
            found.sources.push(step("states.pth + velocities.pth", "state", Joined::of(whole)?));
            let own = vec![(states.clone(), states.dim().min(2)), (velocities.clone(), velocities.dim())];
            found.sources.push(step("states.pth[:2] + velocities.pth", "proprio", Joined::of(own)?));
        }
        velocities => {
            found.sources.push(step("states.pth", "state", states));
            found.sources.extend(velocities.map(|array| step("velocities.pth", "velocities", array)));
        }
    }
    let has_relative = relative.is_some();
    if let Some(array) = relative {
        found.sources.push(step("rel_actions.pth / 100", "action", Arc::new(Divided(array, ACTION_SCALE))));
        found.notes.push("`action` is `rel_actions` / 100, as DINO-WM's loader divides them".to_owned());
    }
    for name in others(folder) {
        let plain = name.trim_end_matches(".pth");
        match optional(&name) {
            Ok(Some(array)) => {
                let new = if name == "actions.pth" && !has_relative { "action" } else { plain };
                found.sources.push(step(&name, new, array));
            }
            Ok(None) => {}
            Err(error) if !plain.ends_with("actions") => {
                found.skipped.push((plain.to_owned(), error.to_string()));
            }
            Err(error) => return Err(error),
        }
    }
    images(folder, &mut found)?;
    if is_pusht {
        found.env = Some("swm/PushT-v1");
        found.fps = Some(PUSHT_FPS);
    }
    Ok(found)
}

/// The tensors that have no meaning of their own here: actions first, then others by name.
fn others(folder: &Path) -> Vec<String> {
    const KNOWN: [&str; 4] = ["states.pth", "velocities.pth", "rel_actions.pth", "seq_lengths.pth"];
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().take(1000);
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> =
        names.filter(|name| name.ends_with(".pth") && !KNOWN.contains(&name.as_str())).collect();
    names.sort_by_key(|name| (!name.ends_with("actions.pth"), name.clone()));
    names
}

/// How lengths are stored that are read.
const LIST: &str = "store a list of whole numbers: pickle.dump([int(length) for length in lengths], file)";

/// Steps of each episode: what is behind them is padding.
fn lengths(folder: &Path, episodes: usize, steps: usize) -> Result<Vec<usize>> {
    let (pickled, tensor) = ("seq_lengths.pkl", "seq_lengths.pth");
    let (name, found) = if folder.join(pickled).is_file() {
        let lengths = pickled_integers(&folder.join(pickled)).map_err(|error| match error.is_unsupported() {
            true => unsupported(format!("{error}; {LIST}")),
            false => error,
        });
        let lengths = lengths.at(pickled)?;
        (pickled, lengths.into_iter().map(|length| length as f64).collect::<Vec<_>>())
    } else if folder.join(tensor).is_file() {
        let lengths = Archive::open(&folder.join(tensor)).and_then(|archive| archive.tensor());
        let lengths = lengths.and_then(|lengths| numbers(&lengths, &mut Scratch::default()));
        (tensor, lengths.at(tensor)?)
    } else {
        return Ok(vec![steps; episodes]);
    };
    if found.len() != episodes {
        return Err(invalid(format!(
            "`{name}` has {} lengths, `states.pth` {episodes} episodes",
            found.len()
        )));
    }
    let length = |(episode, &length): (usize, &f64)| match length.fract() == 0.0
        && length >= 0.0
        && length <= steps as f64
    {
        true => Ok(length as usize),
        false => Err(invalid(format!("`{name}` gives episode {episode} {length} steps of {steps}"))),
    };
    found.iter().enumerate().map(length).collect()
}

/// Images: a file for each episode.
fn images(folder: &Path, found: &mut Found) -> Result<()> {
    let file = |episode: usize, kind: &str| folder.join("obses").join(format!("episode_{episode:03}.{kind}"));
    let deformable = |episode: usize| folder.join(format!("{episode:06}/obses.pth"));
    let spans: Vec<Span> = found
        .lengths
        .iter()
        .enumerate()
        .map(|(array, &count)| Span { array, first: 0, count, tail: None })
        .collect();
    let numbered = || found.lengths.iter().copied().enumerate();
    let mut tensors = |old: &str, file: &dyn Fn(usize) -> PathBuf| -> Result<()> {
        let first = Archive::open(&file(0)).and_then(|archive| archive.tensor()).at(file(0).display())?;
        let one = |(episode, rows)| -> Shared { Arc::new(TensorFile::new(file(episode), rows, &first)) };
        let arrays = numbered().map(one).collect();
        found.sources.push(Source::step(old, "pixels", arrays, spans.clone()));
        Ok(())
    };
    if file(0, "pth").is_file() {
        tensors("obses/episode_*.pth", &|episode| file(episode, "pth"))?;
    } else if deformable(0).is_file() {
        tensors("*/obses.pth", &deformable)?;
    } else if file(0, "mp4").is_file() {
        match super::video::files(numbered().map(|(episode, rows)| (file(episode, "mp4"), rows))) {
            Ok(arrays) => found.sources.push(Source::step("obses/episode_*.mp4", "pixels", arrays, spans)),
            Err(FormatError::Unsupported(reason)) => {
                found.skipped.push(("pixels".to_owned(), reason.to_string()));
            }
            Err(error) => return Err(error.at("obses/episode_000.mp4")),
        }
    } else if fs::read_dir(folder.join("obses")).is_ok_and(|mut files| files.next().is_some()) {
        let reason = "its `obses` has no `episode_000.mp4` or `episode_000.pth`; name its files like this, or copy the folder again";
        found.skipped.push(("pixels".to_owned(), reason.to_owned()));
    } else if !found.lengths.is_empty() {
        found.skipped.push(("pixels".to_owned(), "`obses` has no files".to_owned()));
    }
    Ok(())
}
