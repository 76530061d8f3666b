//! What a folder holds: its columns and where each comes from. Ours say it themselves (see `manifest`), others by their features (see
//! `others`).

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value as Json;
use swm_core::{Dtype, Field, Metadata, Schema};
use swm_data::OpenOptions;
use swm_data::dataset::DatasetInfo;
use swm_data::error::{At as _, DataError, Result, invalid, missing};
use swm_files::open_regular;
use swm_media::mp4::Mp4Reader;

use super::episode_files::EpisodeFiles;
use super::episodes;
use super::info::Info;
use super::manifest::{Manifest, is_video, whole};
use super::rows::Places;
use super::{last_row, tasks};

/// What all handles on a folder share; never changed after opening.
pub(super) struct Shared {
    pub(super) info: DatasetInfo,
    pub(super) columns: Vec<Source>,
    /// By episode.
    pub(super) episodes: Vec<EpisodeFiles>,
    /// Their rows.
    pub(super) places: Places,
}

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
    /// The text of the episode's task; with it, those of the tasks of rows, which are compared.
    Task(Option<BTreeMap<i64, String>>),
    /// The text of each row's task, by its number in a column of the tables.
    Tasks(BTreeMap<i64, String>),
}

impl Shared {
    pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Self, DataError> {
        let damaged = |error| DataError::damaged(path, error);
        let info = Info::read(path).map_err(damaged)?;
        match Manifest::read(path).map_err(damaged)? {
            Some(_) if options.camera.is_some() => Err(DataError::Option {
                option: "camera",
                reason: "this program wrote the dataset, and its images have names already; leave it out, or rename columns with `map`"
                    .to_owned(),
            }),
            Some(manifest) => Self::ours(path, manifest, &info).map_err(damaged),
            None => super::others::open(path, &info, options),
        }
    }

    /// A folder that this program wrote, with its description.
    fn ours(path: &Path, manifest: Manifest, about: &Info) -> Result<Self> {
        let counted = about.total_episodes;
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
            if let Some(checksum) = entry.last_row {
                let last = path.join(last_row::path_of(episode));
                files.checksums.insert(last.clone(), checksum);
                files.last_row = Some(last);
            }
            episodes.push(files);
        }
        let texts = if manifest.has_tasks { tasks::of_ours(path)? } else { BTreeMap::new() };
        let source = |field: &Field| match manifest.feature(&field.name) {
            camera if is_video(field) => Source::Video(camera),
            _ if manifest.is_task(&field.name) => Source::Tasks(texts.clone()),
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

pub(super) fn dataset_info(path: &Path, schema: Arc<Schema>, episodes: &[EpisodeFiles]) -> DatasetInfo {
    let lengths = episodes.iter().map(|files| files.rows + usize::from(files.last_row.is_some()));
    DatasetInfo::new(path, super::LEROBOT.name, schema, lengths.collect())
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
