//! What a folder holds: its columns and where each comes from. Ours say it themselves (see `manifest`), others by their features.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value as Json;
use swm_core::{Dtype, Field, Metadata, Schema};
use swm_media::mp4::Mp4Reader;

use super::episode_files::{EpisodeFiles, second, third};
use super::info::{Info, Version};
use super::manifest::{Manifest, is_video, whole};
use super::rows::{Place, Places};
use super::table::Table;
use super::{episodes, images};
use crate::dataset::DatasetInfo;
use crate::error::{At as _, Result, invalid, missing};
use crate::formats::disk::open_regular;

/// What all handles on a folder share; never changed after opening.
pub(super) struct Shared {
    pub(super) info: DatasetInfo,
    pub(super) columns: Vec<Source>,
    /// By episode.
    pub(super) episodes: Vec<EpisodeFiles>,
    /// Their rows.
    pub(super) places: Places,
}

/// Columns that are made up for folders of other programs, and what they hold.
const MADE_UP: [(&str, &str); 2] =
    [("ep_idx", "the number of the episode"), ("step_idx", "the number of the row in its episode")];

/// Where the values of a column come from.
pub(super) enum Source {
    /// A column of the tables.
    Table(String),
    /// A camera, in videos.
    Video(String),
    /// A camera, in the tables.
    Images(String),
    /// The episode's number, the row's number.
    Episode,
    Step,
}

impl Shared {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let info = Info::read(path)?;
        if let Some(manifest) = Manifest::read(path)? {
            return Self::ours(path, manifest, info.total_episodes);
        }
        let cameras: Vec<String> = info
            .features
            .iter()
            .filter(|(_, feature)| feature["dtype"] == "video")
            .map(|(name, _)| name.clone())
            .collect();
        let episodes = match info.version()? {
            Version::V2 => second(path, &info, &cameras)?,
            Version::V3 => third(path, &info, &cameras)?,
        };
        Self::foreign(path, &info, &cameras, episodes)
    }

    /// A folder of another program, by what its tables and videos hold.
    fn foreign(path: &Path, info: &Info, cameras: &[String], episodes: Vec<EpisodeFiles>) -> Result<Self> {
        let (mut fields, mut columns, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
        let Some(first) = episodes.first() else { return Err(missing("it holds no episode")) };
        let places = Places::new(path, &episodes);
        let listed = Place { data: first.data.clone(), first: first.first };
        // One that cannot be found is told where it is read.
        let place = places.of(&episodes, 0).unwrap_or(&listed);
        let table = Table::open(&place.data)?;
        let mut add = |name: &str, dtype, shape: &[usize], source| {
            fields.push(Field::step(name, dtype, shape));
            columns.push(source);
        };
        let is_camera = |feature: &Json| feature["dtype"] == "video" || feature["dtype"] == "image";
        let first_camera = info.features.iter().find(|(_, feature)| is_camera(feature)).map(|(name, _)| name);
        for (name, feature) in &info.features {
            if let Some((_, meaning)) = MADE_UP.iter().find(|(made_up, _)| made_up == name) {
                let reason = format!("`{name}` is {meaning} here; rename the feature to read it");
                skipped.push((name.clone(), reason));
                continue;
            }
            let known = if Some(name) == first_camera { "pixels" } else { name };
            if cameras.contains(name) {
                let size = first.videos.get(name).ok_or(missing("there is no video"));
                match size.and_then(|(path, _)| video(path)).map(|video| video.size()) {
                    Ok((height, width)) => {
                        add(known, Dtype::U8, &[height, width, 3], Source::Video(name.clone()));
                    }
                    Err(error) => skipped.push((name.clone(), error.to_string())),
                }
                continue;
            }
            if feature["dtype"] == "image" {
                let decoded = images::shape(feature)
                    .and_then(|shape| images::check(&table, name, place.first, shape).map(|()| shape));
                match decoded {
                    Ok(shape) => add(known, Dtype::U8, &shape, Source::Images(name.clone())),
                    Err(error) => skipped.push((name.clone(), error.to_string())),
                }
                continue;
            }
            let found = table.column(name).and_then(|values| {
                let width = shape_of(feature)?.iter().product::<usize>();
                match table.rows().checked_mul(width) == Some(values.len()) {
                    true => Ok(values.dtype()),
                    false => Err(invalid(format!("{} values in {} rows", values.len(), table.rows()))),
                }
            });
            match found {
                Ok(_) if name == "episode_index" => {}
                Ok(dtype) => {
                    let known = if name == "observation.state" { "proprio" } else { name };
                    add(known, dtype, &shape_of(feature)?, Source::Table(name.clone()));
                }
                Err(error) => skipped.push((name.clone(), error.to_string())),
            }
        }
        add("ep_idx", Dtype::I32, &[], Source::Episode);
        add("step_idx", Dtype::I64, &[], Source::Step);
        let schema = Schema::new(fields)?;
        let mut found = dataset_info(path, schema, &episodes);
        found.skipped = skipped.into();
        found.rows_per_second = Some(info.fps);
        Ok(Self { info: found, columns, episodes, places })
    }

    /// A folder that this program wrote, and in which it counted so many episodes.
    fn ours(path: &Path, manifest: Manifest, counted: usize) -> Result<Self> {
        let cameras: Vec<String> = manifest.cameras().map(|(_, camera)| camera).collect();
        let mut episodes = Vec::new();
        for (episode, entry) in episodes::read_all(path, &manifest, counted)?.into_iter().enumerate() {
            let data = path.join(episodes::data_path(episode));
            let (number, rows) = (episode as i64, entry.rows);
            let mut files = EpisodeFiles { number, rows, data: data.clone(), ..EpisodeFiles::default() };
            let videos = cameras.iter().map(|camera| path.join(episodes::video_path(camera, episode)));
            for (camera, video) in cameras.iter().zip(videos.clone()) {
                files.videos.insert(camera.clone(), (video, None));
            }
            files.checksums = std::iter::once(data).chain(videos).zip(entry.checksums).collect();
            episodes.push(files);
        }
        let source = |field: &Field| match manifest.feature(&field.name) {
            camera if is_video(field) => Source::Video(camera),
            name => Source::Table(name),
        };
        let mut columns: Vec<Source> = manifest.columns.iter().map(source).collect();
        let mut fields = manifest.columns;
        fields.push(Field::step("ep_idx", Dtype::I32, &[]));
        columns.push(Source::Episode);
        let schema = Schema::new(fields)?;
        let mut info = dataset_info(path, schema, &episodes);
        let rate = manifest.frames_per_second;
        info.runs = manifest.runs.into_iter().map(|(first, run)| (first, at_rate(run, rate))).collect();
        info.has_checksums = episodes.iter().any(|files| !files.checksums.is_empty());
        let places = Places::new(path, &episodes);
        Ok(Self { info, columns, episodes, places })
    }
}

/// The record of a run whose rows were stored at this rate: its own, up to rounding, unless `--fps` asked for another.
fn at_rate(run: Metadata, rate: f64) -> Metadata {
    let rows_per_second = run.rows_per_second.map(|own| if whole(own) == rate { own } else { rate });
    Metadata { rows_per_second, ..run }
}

fn dataset_info(path: &Path, schema: Arc<Schema>, episodes: &[EpisodeFiles]) -> DatasetInfo {
    DatasetInfo::new(path, super::FORMAT.name, schema, episodes.iter().map(|files| files.rows).collect())
}

/// The shape of a row; one value is a scalar.
pub(super) fn shape_of(feature: &Json) -> Result<Vec<usize>> {
    let sizes = feature["shape"].as_array().ok_or(missing("a feature has no shape"))?;
    let sizes: Option<Vec<usize>> =
        sizes.iter().map(|size| size.as_u64().map(|size| size as usize)).collect();
    let sizes = sizes.ok_or(missing("a feature's shape holds no numbers"))?;
    let values = sizes.iter().try_fold(1usize, |values, &size| values.checked_mul(size));
    match values {
        Some(1) => Ok(Vec::new()),
        Some(2..=0x1000_0000) => Ok(sizes),
        _ => Err(invalid(format!("a feature has the shape {sizes:?}"))),
    }
}

/// An open video.
pub(super) fn video(path: &Path) -> Result<Mp4Reader<BufReader<File>>> {
    let file = open_regular(path).at(path.display())?;
    Mp4Reader::new(BufReader::new(file)).at(path.display())
}
