//! Folders of other programs: columns by what the tables and videos hold, and the names that they get here.

use std::path::Path;
use std::sync::Arc;

use serde_json::Value as Json;
use swm_core::{Column, Dtype, Field, FieldKind, Schema};
use swm_data::OpenOptions;
use swm_data::error::{At as _, DataError, Result, invalid, missing};
use swm_data::foreign::{LEROBOT_NAMES, REWARDS_NOTE, RewardsAt, source_record};

use super::contents::{Shared, Source, dataset_info, shape_of, video};
use super::episode_files::{EpisodeFiles, second, third};
use super::images::{self, Encoded};
use super::info::{Info, Version};
use super::rows::{Place, Places};
use super::table::{Table, is_no_column};
use super::tasks;

/// Columns that are made up, and what they hold.
const MADE_UP: [(&str, &str); 2] =
    [("ep_idx", "the number of the episode"), ("step_idx", "the number of the row in its episode")];

/// The column of the texts of tasks.
const TASK: &str = "task";
/// Names of the main camera, where there are several.
const MAIN_CAMERAS: [&str; 4] =
    ["pixels", "observation.image", "observation.images.image", "observation.images.pixels"];

/// A column.
struct Listed {
    /// The name of the feature.
    old: String,
    field: Field,
    source: Source,
    is_camera: bool,
}

/// A folder of another program.
pub(super) fn open(path: &Path, info: &Info, options: &OpenOptions) -> Result<Shared, DataError> {
    let damaged = |error| DataError::damaged(path, error);
    let cameras: Vec<String> = info
        .features
        .iter()
        .filter(|(_, feature)| feature["dtype"] == "video")
        .map(|(name, _)| name.clone())
        .collect();
    let episodes = match info.version().map_err(damaged)? {
        Version::V2 => second(path, info, &cameras),
        Version::V3 => third(path, info, &cameras),
    }
    .map_err(damaged)?;
    let (mut listed, skipped, notes) = list(path, info, &episodes, options).map_err(damaged)?;
    if let Some(main) = main_camera(&listed, options)? {
        "pixels".clone_into(&mut listed[main].field.name);
    }
    let features = |name: &str| info.features.contains_key(name);
    for column in &mut listed {
        let new = LEROBOT_NAMES.iter().find(|(old, _)| *old == column.old).map(|(_, new)| *new);
        if let Some(new) = new.filter(|new| !features(new)) {
            new.clone_into(&mut column.field.name);
        }
    }
    let renamed = listed.iter().filter(|column| column.field.name != column.old);
    let mapping: Vec<(String, String)> =
        renamed.map(|column| (column.field.name.clone(), column.old.clone())).collect();
    let (fields, columns) = listed.into_iter().map(|column| (column.field, column.source)).unzip();
    let schema = Schema::new(fields).map_err(|error| damaged(error.into()))?;
    let mut found = dataset_info(path, schema, &episodes);
    let rewards = found.schema.index("reward").map(|_| RewardsAt::Actions);
    found.notes = rewards.map(|_| REWARDS_NOTE.to_owned()).into_iter().chain(notes).collect();
    found.skipped = skipped.into();
    found.rows_per_second = Some(info.fps);
    let source = source_record(found.format, options, &mapping, None, Some(info.fps), rewards);
    found.runs = Arc::new([(0, source)]);
    found.mapping = mapping.into();
    let places = Places::new(path, &episodes);
    Ok(Shared { info: found, columns, episodes, places })
}

/// Names of features that are no columns, with the reason.
type Skipped = Vec<(String, String)>;

/// All columns under the names of the features, what is left out, with the reason, and notes.
///
/// # Errors
///
/// No episode; a damaged table; a list of tasks that is damaged and needed; damaged videos or images of a camera where the main one was not
/// chosen, for another camera would take its place.
fn list(
    path: &Path,
    info: &Info,
    episodes: &[EpisodeFiles],
    options: &OpenOptions,
) -> Result<(Vec<Listed>, Skipped, Vec<String>)> {
    let is_camera_chosen = options.camera.is_some() || options.map.contains_key("pixels");
    let (mut listed, mut skipped, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    let first = episodes.first().ok_or_else(|| missing("it holds no episode"))?;
    let places = Places::new(path, episodes);
    let stated = Place { data: first.data.clone(), first: first.first };
    // One that cannot be found is reported where it is read.
    let place = places.of(episodes, 0).unwrap_or(&stated);
    let table = Table::open(&place.data)?;
    for (name, feature) in &info.features {
        if let Some((_, meaning)) = MADE_UP.iter().find(|(made_up, _)| made_up == name) {
            let reason = format!("`{name}` is {meaning} here; rename the feature to read it");
            skipped.push((name.clone(), reason));
            continue;
        }
        let is_camera = feature["dtype"] == "video" || feature["dtype"] == "image";
        let found = match feature["dtype"].as_str() {
            Some("video") => {
                of_videos(name, first).map(|shape| (Dtype::U8, shape, Source::Video(name.clone())))
            }
            Some("image") => {
                let first = table.images(name, place.first..place.first.saturating_add(1));
                of_images(path, feature, decoded(first).at(places.name(&place.data))?)
                    .map(|shape| (Dtype::U8, shape, Source::Images(name.clone())))
            }
            _ => of_table(feature, decoded(table.column(name)).at(places.name(&place.data))?, table.rows())
                .map(|(dtype, shape)| (dtype, shape, Source::Table(name.clone()))),
        };
        match found {
            Ok(_) if name == "episode_index" => {}
            Ok((dtype, shape, source)) => {
                let is_camera = matches!(source, Source::Video(_) | Source::Images(_));
                let field = Field::step(name, dtype, &shape);
                listed.push(Listed { old: name.clone(), field, source, is_camera });
            }
            Err(error) if is_camera && !is_camera_chosen && !error.is_unsupported() => {
                return Err(error.at(name));
            }
            Err(error) => skipped.push((name.clone(), error.to_string())),
        }
    }
    if !info.features.contains_key(TASK) {
        let (column, note) = task(path, info.version()?, episodes, &table)?;
        notes.extend(note);
        match column {
            Ok(column) => listed.push(column),
            Err(error) => skipped.push((TASK.to_owned(), error.to_string())),
        }
    }
    for (name, dtype, source) in
        [("ep_idx", Dtype::I32, Source::Episode), ("step_idx", Dtype::I64, Source::Step)]
    {
        let field = Field::step(name, dtype, &[]);
        listed.push(Listed { old: name.to_owned(), field, source, is_camera: false });
    }
    Ok((listed, skipped, notes))
}

/// The size of the images of a camera.
fn of_videos(name: &str, first: &EpisodeFiles) -> Result<Vec<usize>> {
    let (path, _) = first.videos.get(name).ok_or_else(|| missing("there is no video"))?;
    let (height, width) = video(path)?.size();
    Ok(vec![height, width, 3])
}

/// What a column of a table is, whose error is that of a damaged file if it is there and cannot be decoded: it would be missing without a
/// word.
fn decoded<T>(column: Result<T>) -> Result<Result<T>> {
    match column {
        Err(error) if !is_no_column(&error) => Err(error),
        column => Ok(column),
    }
}

fn of_table(feature: &Json, values: Result<Column>, rows: usize) -> Result<(Dtype, Vec<usize>)> {
    let (values, shape) = (values?, shape_of(feature)?);
    match rows.checked_mul(shape.iter().product()) == Some(values.len()) {
        true => Ok((values.dtype(), shape)),
        false => Err(invalid(format!("{} values in {rows} rows", values.len()))),
    }
}

/// The size of the images of a column, the first of which must be one.
fn of_images(dataset: &Path, feature: &Json, first: Result<Vec<Encoded>>) -> Result<Vec<usize>> {
    let shape = images::shape(feature)?;
    let first = first?.into_iter().next().ok_or(missing("it holds no image"))?;
    first.decode(dataset, shape, &mut vec![0; shape.iter().product()])?;
    Ok(shape.to_vec())
}

/// The text of the task: one an episode, unless an episode has several; a reason why there is none; and a note.
fn task(
    path: &Path,
    version: Version,
    episodes: &[EpisodeFiles],
    table: &Table,
) -> Result<(Result<Listed>, Option<String>)> {
    let has_numbers = table.integers(tasks::TASK_INDEX)?.is_some();
    let listed = |kind, source| {
        let field = Field { kind, ..Field::step(TASK, Dtype::Str, &[]) };
        Listed { old: "tasks".to_owned(), field, source, is_camera: false }
    };
    if episodes.iter().all(|episode| episode.task.is_some()) {
        let (texts, note) = match has_numbers.then(|| tasks::read(path, version)).transpose() {
            Ok(texts) => (texts, None),
            Err(error) => (
                None,
                Some(format!(
                    "`{TASK}` has the texts of the list of episodes, and the `{}` of rows are not compared with the list of tasks: {error}",
                    tasks::TASK_INDEX
                )),
            ),
        };
        return Ok((Ok(listed(FieldKind::Episode, Source::Task(texts))), note));
    }
    let lacking = if !has_numbers {
        format!("the rows have no numbers of tasks (`{}`)", tasks::TASK_INDEX)
    } else if !path.join(tasks::file(version)).exists() {
        format!("the list of tasks, `{}`, is not there", tasks::file(version))
    } else {
        let texts = tasks::read(path, version)?;
        return Ok((Ok(listed(FieldKind::Step, Source::Tasks(texts))), None));
    };
    Ok((Err(missing(lacking)), None))
}

/// The camera that becomes `pixels`.
fn main_camera(listed: &[Listed], options: &OpenOptions) -> Result<Option<usize>, DataError> {
    let refuse = |reason| Err(DataError::Option { option: "camera", reason });
    let cameras: Vec<usize> = (0..listed.len()).filter(|&at| listed[at].is_camera).collect();
    let names = || cameras.iter().map(|&at| format!("`{}`", listed[at].old)).collect::<Vec<_>>().join(", ");
    if let Some(wanted) = &options.camera {
        let is_it =
            |name: &str| name == wanted || name.strip_suffix(wanted).is_some_and(|rest| rest.ends_with('.'));
        let fits: Vec<usize> = cameras.iter().copied().filter(|&at| is_it(&listed[at].old)).collect();
        return match fits[..] {
            [one] => Ok(Some(one)),
            _ if cameras.is_empty() => {
                refuse("the dataset has no images that can be read; leave it out".to_owned())
            }
            [] => refuse(format!("no camera is called `{wanted}`; there are {}", names())),
            _ => refuse(format!("several cameras are called `{wanted}`; there are {}", names())),
        };
    }
    if options.map.contains_key("pixels") {
        return Ok(None);
    }
    let main: Vec<usize> =
        cameras.iter().copied().filter(|&at| MAIN_CAMERAS.contains(&listed[at].old.as_str())).collect();
    match (&cameras[..], &main[..]) {
        ([], _) => Ok(None),
        ([one], _) | (_, [one]) => Ok(Some(*one)),
        _ => refuse(format!(
            "the dataset has several cameras, {}; name the one that becomes `pixels`",
            names()
        )),
    }
}
