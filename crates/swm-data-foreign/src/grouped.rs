//! HDF5 files with a group for each episode: robomimic, LIBERO, RoboCasa, MimicGen; ManiSkill; Minari.
//!
//! Sources of the layouts: robomimic 0.5, LIBERO 1952000 `scripts/create_dataset.py`, ManiSkill 3 `utils/wrappers/record.py`, Minari 0.5.4.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value;
use swm_core::{Column, Dtype, FieldKind};
use swm_data::OpenOptions;
use swm_data::dataset::Dataset;
use swm_data::error::{At as _, DataError, FormatError, Result, invalid, missing, unsupported};
use swm_data::hdf5::Tree;

use super::array::{Constant, Joined, Memory, Reshaped, Scratch, Shared, numbers};
use super::dataset::Span;
use super::found::{Found, Source};
use super::groups::{Episodes, Family, part};
use super::hdf5::{Rows, array, scalars};
use super::libero::{Shift, shift_of};

/// The file of a dataset that may be a folder, as those of Minari are.
fn file_of(path: &Path) -> Option<PathBuf> {
    let places = [path.to_owned(), path.join("main_data.hdf5"), path.join("data/main_data.hdf5")];
    places.into_iter().find(|place| place.is_file())
}

pub(super) fn detect(path: &Path) -> bool {
    let tree = file_of(path).and_then(|file| super::hdf5::open(&file));
    tree.is_some_and(|tree| Episodes::of(&tree).is_some())
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let damaged = |error| DataError::damaged(path, error);
    let file = file_of(path).ok_or_else(|| damaged(missing("its file is missing")))?;
    let tree = Tree::open(&file)?;
    let episodes = Episodes::of(&tree).ok_or_else(|| damaged(invalid("it has no groups of episodes")))?;
    let linked = episodes.about_links().map_err(damaged)?;
    let Episodes { family, mut groups, .. } = episodes;
    let (mut known, mut notes) = (vec![], vec![]);
    let mut shift = Shift::No;
    if family == Family::Robomimic {
        known = vec!["split", "shift"];
        if let Some(split) = &options.split {
            let (chosen, absent) = part(&tree, &groups, split)?;
            (groups, notes) = (chosen, absent.into_iter().collect());
        }
        shift = shift_of(&tree, &groups, options.shift)
            .map_err(damaged)?
            .map_err(|reason| DataError::Option { option: "shift", reason })?;
    }
    let is_jpeg = family == Family::Minari && super::hdf5::is_jpeg(&file);
    let mut found = find(&tree, family, &groups, shift, is_jpeg).map_err(damaged)?;
    found.notes.extend(linked.into_iter().chain(notes));
    match family {
        Family::Robomimic => about_robomimic(&tree, &groups, shift, &mut found),
        Family::ManiSkill => about_maniskill(&file, &mut found),
        Family::Minari => about_minari(&file, &mut found),
    }
    found.open(path, family.signs().0, options, &known)
}

/// Rows of one array in one episode, where it has some.
type ByEpisode = Vec<Option<Rows>>;

/// Arrays of one value a row, which some programs store as `[T, 1]`.
const SCALARS: [&str; 8] =
    ["rewards", "dones", "terminated", "truncated", "terminations", "truncations", "success", "fail"];

fn find(tree: &Tree, family: Family, groups: &[String], shift: Shift, is_jpeg: bool) -> Result<Found> {
    let mut found = Found::default();
    let mut columns: BTreeMap<String, ByEpisode> = BTreeMap::new();
    let mut reasons: BTreeMap<String, String> = BTreeMap::new();
    let mut steps = Vec::new();
    for (episode, group) in groups.iter().enumerate() {
        let mut rows: BTreeMap<String, usize> = BTreeMap::new();
        for path in tree.tables(group).at(group)? {
            match array(tree, group, &path, is_jpeg) {
                Ok(table) => {
                    let table = if SCALARS.contains(&path.as_str()) { scalars(table) } else { table };
                    rows.insert(path.clone(), table.rows());
                    let all = columns.entry(path).or_default();
                    all.resize_with(episode, || None);
                    all.push(Some(table));
                }
                Err(FormatError::Unsupported(reason)) => drop(reasons.insert(path, reason.to_string())),
                Err(error) => return Err(error.at(format_args!("`{group}/{path}`"))),
            }
        }
        let below = |start: &str| {
            let is_below = |path: &&String| {
                path.strip_prefix(start).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
            };
            rows.iter().find(|(path, _)| is_below(path)).map(|(_, &rows)| rows)
        };
        let actions = below("actions").or_else(|| below("rewards"));
        let actions = actions.ok_or_else(|| {
            let fix = "its steps are those of its actions; delete the group from a copy of the file";
            let reason = match reasons.get("actions") {
                Some(reason) => format!("`actions`: {reason}"),
                None => format!("it has no `actions`, and {fix}"),
            };
            unsupported(reason).at(format_args!("`{group}`"))
        })?;
        let whole = match family {
            Family::Robomimic if below("next_obs").is_some() || below("obs") == Some(actions + 1) => {
                actions + 1
            }
            Family::Robomimic => actions,
            Family::ManiSkill if below("obs").or_else(|| below("env_states")).is_some() => actions + 1,
            Family::ManiSkill => actions,
            Family::Minari => actions + 1,
        };
        steps.push(actions);
        found.lengths.push(whole);
    }
    for all in columns.values_mut() {
        all.resize_with(groups.len(), || None);
    }
    if family == Family::Robomimic {
        marks(&mut columns, &mut found, shift)?;
    }
    let mut next: BTreeMap<String, ByEpisode> = BTreeMap::new();
    if family == Family::Robomimic {
        let names: Vec<String> =
            columns.keys().filter(|name| name.starts_with("next_obs/")).cloned().collect();
        for name in names {
            next.extend(columns.remove(&name).map(|all| (name, all)));
        }
    }
    for (path, mut all) in columns {
        if let Some(reason) = reasons.remove(&path).or_else(|| differs(&all, &found.lengths, &steps)) {
            found.skipped.push((path.replace('/', "."), reason));
            continue;
        }
        let moved =
            usize::from(shift == Shift::Yes && ["actions", "states", "rewards"].contains(&path.as_str()));
        found.note_absent(&path, &all.iter().map(Option::is_some).collect::<Vec<_>>());
        let mut last = next.remove(&format!("next_{path}"));
        let (mut arrays, mut spans): (Vec<Shared>, Vec<Span>) = Default::default();
        for (episode, rows) in all.iter_mut().enumerate() {
            let Some(rows) = rows.take() else {
                spans.push(Span::NONE);
                continue;
            };
            let (array, count) = (arrays.len(), rows.rows().saturating_sub(moved));
            arrays.push(if path == "rewards" { floats(rows)? } else { rows });
            let tail = last.as_mut().and_then(|last| last[episode].take()).filter(|tail| tail.rows() > 0);
            let tail = tail.map(|tail| {
                let row = tail.rows() - 1;
                arrays.push(tail);
                (array + 1, row)
            });
            spans.push(Span { array, first: moved, count, tail });
        }
        let new = name_of(family, &path);
        found.sources.push(Source::step(&path, &new, arrays, spans));
    }
    found.skipped.extend(reasons.into_iter().map(|(path, reason)| (path.replace('/', "."), reason)));
    Ok(found)
}

/// Whole numbers as floats, of which one can be missing; they are marks of success.
fn floats(rows: Rows) -> Result<Rows> {
    match (rows.dtype(), rows.shape()) {
        (Dtype::U8 | Dtype::I32 | Dtype::I64, []) => {
            Ok(Arc::new(Reshaped(Joined::of(vec![(rows, 1)])?, Vec::new())))
        }
        _ => Ok(rows),
    }
}

/// Why an array is no column: it has not a row for each step in some episode.
fn differs(all: &ByEpisode, lengths: &[usize], steps: &[usize]) -> Option<String> {
    for (episode, rows) in all.iter().enumerate() {
        let Some(rows) = rows else { continue };
        if rows.rows() != lengths[episode] && rows.rows() != steps[episode] {
            return Some(format!(
                "it has {} rows in episode {episode} of {} steps",
                rows.rows(),
                steps[episode]
            ));
        }
    }
    None
}

/// What a column of Minari is called here.
#[cfg(feature = "lerobot")]
pub(super) fn name_in_minari(path: &str) -> String {
    name_of(Family::Minari, path)
}

fn name_of(family: Family, path: &str) -> String {
    let plain = path.replace("_index_", "").replace('/', ".");
    match (family, path) {
        (Family::Minari, "observations") | (Family::ManiSkill, "obs") => "observation".to_owned(),
        (Family::Minari, "observations/desired_goal" | "observations/achieved_goal") => {
            plain.trim_start_matches("observations.").to_owned()
        }
        (_, "actions") => "action".to_owned(),
        (_, "rewards") => "reward".to_owned(),
        (Family::Minari, "terminations") => "terminated".to_owned(),
        (Family::Minari, "truncations") => "truncated".to_owned(),
        (Family::Robomimic, "states") => "state".to_owned(),
        _ => plain,
    }
}

/// `dones` mark success or the end of a recording: `truncated`, and `success` where the last reward is positive.
fn marks(columns: &mut BTreeMap<String, ByEpisode>, found: &mut Found, shift: Shift) -> Result<()> {
    let Some(dones) = columns.remove("dones") else { return Ok(()) };
    let (mut truncated, mut success) = (Vec::new(), Vec::new());
    let moved = usize::from(shift == Shift::Yes);
    let scratch = &mut Scratch::default();
    for (episode, &length) in found.lengths.iter().enumerate() {
        let mut of = |all: Option<&Rows>| all.map_or(Ok(Vec::new()), |rows| numbers(rows.as_ref(), scratch));
        let ends = of(dones[episode].as_ref())?;
        let rewards = of(columns.get("rewards").and_then(|all| all[episode].as_ref()))?;
        let is_end = |row: usize| ends.get(row + moved).is_some_and(|&end| end != 0.0);
        let is_last = |row: usize| row + moved + 1 == rewards.len() && rewards[row + moved] > 0.0;
        truncated.extend((0..length).map(is_end));
        success.extend((0..length).map(is_last));
    }
    for (old, new, marks) in [("dones", "truncated", truncated), ("rewards > 0", "success", success)] {
        let spans = found.end_to_end();
        found.sources.push(Source::step(old, new, vec![Memory::marks(marks)], spans));
    }
    found.notes.push(
        "`dones` mark success or the end of a recording: they are `truncated` here, and there is no `terminated`".to_owned(),
    );
    Ok(())
}

pub(super) fn json_in(text: Option<String>) -> Value {
    text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

pub(super) fn json_at(path: &Path) -> Value {
    /// Files of metadata are never longer.
    const MAX_BYTES: u64 = 256 << 20;
    let is_small =
        std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() <= MAX_BYTES);
    json_in(is_small.then(|| std::fs::read_to_string(path).ok()).flatten())
}

fn rate(found: &mut Found, value: &Value) {
    found.fps = value.as_f64().filter(|fps| fps.is_finite() && *fps > 0.0 && *fps <= 1e6);
}

/// A text beside the episodes of robomimic; noted if it cannot be read.
fn attribute(tree: &Tree, name: &str, found: &mut Found) -> Option<String> {
    tree.attribute("/data", name).unwrap_or_else(|error| {
        found.notes.push(format!("its attribute `{name}` cannot be read: {error}"));
        None
    })
}

fn about_robomimic(tree: &Tree, groups: &[String], shift: Shift, found: &mut Found) {
    let env = json_in(attribute(tree, "env_args", found));
    rate(found, &env["env_kwargs"]["control_freq"]);
    if found.fps.is_none() {
        found.fps = Some(20.0);
        found.notes.push("it does not say its rate; 20 rows per second are assumed".to_owned());
    }
    if let Some(name) = env["env_name"].as_str() {
        found.notes.push(format!("its environment is {name}"));
    }
    if attribute(tree, "macros_image_convention", found).as_deref() == Some("opengl") {
        found.notes.push("its images are upside down (OpenGL); the option `flip` turns them over".to_owned());
    }
    if shift == Shift::Yes {
        found.notes.push(
            "its observations are those after the action of the same row: `action`, `state` and `reward` of a row are those of the next \
             one here, and missing in the last"
                .to_owned(),
        );
    }
    let problem = json_in(attribute(tree, "problem_info", found));
    if let Some(language) = problem["language_instruction"].as_str() {
        let texts = vec![Some(language.to_owned()); groups.len()];
        add_language("problem_info.language_instruction", texts, found);
        return;
    }
    let language = |group: &String| {
        let about = json_in(tree.attribute(group, "ep_meta").ok()?);
        about["lang"].as_str().map(str::to_owned)
    };
    add_language("ep_meta.lang", groups.iter().map(language).collect(), found);
}

/// Adds the instructions of episodes, if some have one.
fn add_language(old: &str, texts: Vec<Option<String>>, found: &mut Found) {
    if texts.iter().all(Option::is_none) {
        return;
    }
    let array = |(text, &rows): (Option<String>, &usize)| -> Option<Shared> {
        text.map(|text| Arc::new(Constant { value: Column::Str(vec![text]), rows }) as Shared)
    };
    let arrays = texts.into_iter().zip(&found.lengths).map(array).collect();
    let span = |(array, &count): (usize, &usize)| Span { array, first: 0, count, tail: None };
    let spans: Vec<Span> = found.lengths.iter().enumerate().map(span).collect();
    found.add_partial(old, "language", arrays, &spans);
    found.sources.last_mut().into_iter().for_each(|source| source.kind = FieldKind::Episode);
}

fn about_maniskill(file: &Path, found: &mut Found) {
    let about = json_at(&file.with_extension("json"));
    let kwargs = &about["env_info"]["env_kwargs"];
    rate(found, &kwargs["sim_config"]["control_freq"]);
    if let Some(name) = about["env_info"]["env_id"].as_str() {
        let mode = kwargs["control_mode"].as_str().unwrap_or("unknown");
        found.notes.push(format!("its environment is {name}, its control mode {mode}"));
    }
    if !found.sources.iter().any(|source| source.old.starts_with("obs")) {
        found.notes.push(
            "it has no observations (`obs_mode` none): ManiSkill's `replay_trajectory` makes them".to_owned(),
        );
    }
}

pub(super) fn about_minari(file: &Path, found: &mut Found) {
    let about = json_at(&file.with_file_name("metadata.json"));
    let spec = json_in(about["env_spec"].as_str().map(str::to_owned));
    if let Some(name) = spec["id"].as_str() {
        found.notes.push(format!("its environment is {name}; the option `env` records which of ours it is"));
    }
}
