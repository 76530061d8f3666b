//! Clips for training: which episodes they come from, which columns they hold, and the statistics that standardize
//! vectors. The loader reads; tensors are not known here.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::env::PIXELS;
use swm_core::evaluate::is_held_out;
use swm_core::{ImageSize, Metadata, Registry};
use swm_data::adapt::{Subset, split_episodes};
use swm_data::loader::{GoalOptions, Images};
use swm_data::rendered::CANONICAL;
use swm_data::stats::{ColumnStatistics, Statistics, StatisticsOptions};
use swm_data::tools::sample_digest;
use swm_data::{ClipOptions, DataError, Dataset, Loader, OpenOptions, Rendered};

use super::looks::ImageLooks;
use super::scale::Scale;
use crate::baseline::{InputSpec, Phase, PhaseGoals};
use crate::data::DataDims;
use crate::error::BaselineError;

/// The column that actions stand in.
pub const ACTION: &str = "action";

/// The column that says where the agent is.
pub const PROPRIO: &str = "proprio";

/// Which episodes train and validate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Split {
    /// The share of training episodes; the others validate. By episode: clips of one episode overlap.
    pub train: f64,
    /// The share of episodes that is left out of both, for evaluation: [`is_held_out`].
    pub held_out: f64,
    /// Seed of the choice.
    pub seed: u64,
}

impl Default for Split {
    /// 0.9, nothing held out, seed 42.
    fn default() -> Self {
        Self { train: 0.9, held_out: 0.0, seed: 42 }
    }
}

/// What using the model requires to know of the data: part of the run's `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct DataConfig {
    /// The dataset.
    pub path: PathBuf,
    /// How it is opened, where it is of another program.
    #[serde(default, skip_serializing_if = "OpenOptions::is_default")]
    pub opening: OpenOptions,
    /// The environment that it was recorded in, if it says so.
    pub env: Option<String>,
    /// The environment's settings that were given; `None` where the environment is unknown, and in runs of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub env_settings: Option<Map<String, Json>>,
    /// Environment steps per row; `None` as for `env_settings`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_skip: Option<u32>,
    /// Its number of episodes.
    pub episodes: usize,
    /// Steps of all episodes.
    pub rows: usize,
    /// [`sample_digest`] of the columns that it learns from; `None` in runs of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<String>,
    /// The split into training and validation.
    pub split: Split,
    /// Side of images.
    pub image: usize,
    /// Values of one action.
    pub action: usize,
    /// How its images are rendered, where these are others than it holds.
    #[serde(default, skip_serializing_if = "ImageLooks::is_default")]
    pub looks: ImageLooks,
    /// How vectors are scaled, by column; from the training episodes.
    pub scales: BTreeMap<String, Scale>,
}

impl DataConfig {
    /// That of a dataset of which nothing else is known: side of images, values of one action, and how vectors are scaled.
    pub fn new(path: PathBuf, image: usize, action: usize, scales: BTreeMap<String, Scale>) -> Self {
        Self {
            path,
            opening: OpenOptions::default(),
            env: None,
            env_settings: None,
            frame_skip: None,
            episodes: 0,
            rows: 0,
            sample: None,
            split: Split::default(),
            image,
            action,
            looks: ImageLooks::default(),
            scales,
        }
    }
}

/// Loaders over the two parts of a dataset, for every phase of a training.
#[non_exhaustive]
pub struct TrainData {
    /// One per phase: they differ in their goals.
    pub phases: Vec<PhaseClips>,
    /// What using the model requires to know of the data.
    pub config: DataConfig,
    /// Episodes to learn from and to validate with: what the loaders read.
    pub(super) parts: [Box<dyn Dataset>; 2],
    /// What their clips are, but for goals.
    pub(super) options: ClipOptions,
}

/// The clips of a phase.
#[non_exhaustive]
pub struct PhaseClips {
    /// Training clips.
    pub train: Loader,
    /// Clips of the other episodes, if any has one.
    pub validation: Option<Loader>,
}

impl PhaseClips {
    /// Clips of the episodes to learn from and to validate with.
    pub(super) fn new(
        [train, validation]: &[Box<dyn Dataset>; 2],
        options: &ClipOptions,
    ) -> Result<Self, BaselineError> {
        // Episodes that are too short for a clip have none: then nothing validates.
        let validation = Loader::new(validation.share(), options).ok();
        Ok(Self { train: Loader::new(train.share(), options)?, validation })
    }

    /// Batches of `batch` clips in a pass over the clips; what is left over waits for another order.
    pub fn steps_per_epoch(&self, batch: usize) -> u64 {
        (self.train.len() / batch.clamp(1, self.train.len())) as u64
    }
}

/// The dimensions of a dataset that `baseline` shall be trained on.
///
/// # Errors
///
/// It has no actions.
pub fn data_dims(dataset: &dyn Dataset, baseline: &str) -> Result<DataDims, BaselineError> {
    let action_dim = check_columns(dataset, baseline, &[ACTION])?;
    let schema = dataset.schema();
    let proprio_dim = schema.index(PROPRIO).map_or(0, |index| schema.fields()[index].dim());
    Ok(DataDims { action_dim, proprio_dim })
}

/// The dataset with images to train on: its own, or else images of side `image` (pixels) that are rendered when they are read, in
/// other looks if `looks` has some. `baseline` is the name of what is trained, for messages.
///
/// # Errors
///
/// It has no images, or other looks are asked for, and it does not say how it was recorded, its environment is not in `registry`, or
/// has no such looks.
pub fn with_images(
    dataset: &dyn Dataset,
    registry: &Registry,
    baseline: &str,
    image: usize,
    looks: &ImageLooks,
) -> Result<Box<dyn Dataset>, BaselineError> {
    let holds_images = dataset.schema().index(PIXELS).is_some();
    if holds_images && looks.is_default() {
        return Ok(dataset.share());
    }
    let rendered = Rendered::new(dataset.share(), registry, &looks.options(image)?);
    let refuse = |error: DataError| {
        let reason = match looks.is_default() {
            true => format!(
                "it has no column `{PIXELS}`, and its images cannot be rendered: {error}; record it with images of \
                 {image}x{image}"
            ),
            false => format!("its images cannot be rendered in these looks: {error}"),
        };
        columns_error(dataset, baseline, reason)
    };
    Ok(Box::new(rendered.map_err(refuse)?))
}

impl TrainData {
    /// Loaders for a model of this input spec. `baseline` is its name, for messages.
    ///
    /// # Errors
    ///
    /// A column that training needs is missing or of another shape, a part of the split has no episode that is long
    /// enough, or reading fails.
    pub fn new(
        dataset: &dyn Dataset,
        baseline: &str,
        input_spec: &InputSpec,
        phases: &[Phase],
        split: Split,
        seed: u64,
    ) -> Result<Self, BaselineError> {
        let columns: &[&str] =
            if input_spec.proprio { &[PIXELS, ACTION, PROPRIO] } else { &[PIXELS, ACTION] };
        let action = check_columns(dataset, baseline, columns)?;
        let [train, validation] = parts(dataset, split)?;
        let spanned = input_spec.num_steps * input_spec.frameskip;
        let longest = train.iter().map(|&episode| dataset.episode_len(episode)).max().unwrap_or(0);
        if longest < spanned {
            let reason = format!(
                "a clip of its training spans {spanned} steps, {} of every {}, and the longest episode has {longest}; record \
                 longer ones, or lower the settings `model.history` or `model.frameskip`",
                input_spec.num_steps, input_spec.frameskip
            );
            return Err(columns_error(dataset, baseline, reason));
        }
        let part = |episodes: &[usize]| Subset::new(dataset.share(), episodes);
        let scales = scales(&mut part(&train)?, baseline, &columns[1..])?;
        let parts: [Box<dyn Dataset>; 2] = [Box::new(part(&train)?), Box::new(part(&validation)?)];
        // Pairs, where the images have been rendered in two looks.
        let pairs = dataset.schema().index(CANONICAL).is_some().then_some(CANONICAL);
        let keys: Vec<&str> = columns.iter().copied().chain(pairs).collect();
        let options = options(input_spec, &keys);
        let clips = |phase: &Phase| {
            let goals = phase.goals.as_ref().map(|goals| goal_options(goals, columns, seed));
            PhaseClips::new(&parts, &options.clone().goals(goals))
        };
        let phases = phases.iter().map(clips).collect::<Result<_, _>>()?;
        let episodes = dataset.num_episodes();
        let recorded = dataset.metadata().and_then(Metadata::of_known_env);
        let config = DataConfig {
            path: dataset.path().to_owned(),
            opening: OpenOptions::of(dataset.info()),
            env: recorded.map(|recorded| recorded.env.clone()),
            env_settings: recorded.map(|recorded| recorded.settings.clone()),
            frame_skip: recorded.map(|recorded| recorded.frame_skip),
            episodes,
            rows: (0..episodes).map(|episode| dataset.episode_len(episode)).sum(),
            sample: Some(sample_digest(dataset, columns)?),
            split,
            image: input_spec.image,
            action,
            looks: ImageLooks::default(),
            scales,
        };
        Ok(Self { phases, config, parts, options })
    }
}

/// Refuses a dataset that lacks something, with all that it lacks; the dim of its actions.
fn check_columns(dataset: &dyn Dataset, baseline: &str, needed: &[&str]) -> Result<usize, BaselineError> {
    let schema = dataset.schema();
    let refuse = |reason: String| Err(columns_error(dataset, baseline, reason));
    let missing: Vec<&str> = needed.iter().copied().filter(|name| schema.index(name).is_none()).collect();
    if !missing.is_empty() {
        let known: Vec<&str> = schema.fields().iter().map(|field| field.name.as_str()).collect();
        let fix = match missing.contains(&PIXELS) {
            true => "record it with images, such as of 64x64",
            false => "record it with `swm collect`, or choose another baseline",
        };
        return refuse(format!(
            "it has no column `{}`, only `{}`; {fix}",
            missing.join("`, `"),
            known.join("`, `")
        ));
    }
    let field = |name: &str| schema.index(name).map(|index| &schema.fields()[index]);
    let action = field(ACTION).expect("checked above").dim();
    match field(PIXELS).map(|field| &field.shape[..]) {
        None => Ok(action),
        Some([height, width, 3]) if height == width => Ok(action),
        Some([height, width, 3]) => refuse(format!(
            "its images are {height} × {width} pixels, and square ones are needed; record such, as of \
             64x64"
        )),
        Some(shape) => refuse(format!("its images are {shape:?}, and color images [H, W, 3] are needed")),
    }
}

fn columns_error(dataset: &dyn Dataset, baseline: &str, reason: String) -> BaselineError {
    BaselineError::Columns { path: dataset.path().to_owned(), baseline: baseline.to_owned(), reason }
}

/// Episodes to learn from and to validate with.
fn parts(dataset: &dyn Dataset, split: Split) -> Result<[Vec<usize>; 2], BaselineError> {
    let wrong =
        |setting: &str, reason: String| Err(BaselineError::Training { setting: setting.to_owned(), reason });
    if !(split.train > 0.0 && split.train <= 1.0) {
        return wrong("split", format!("{}; use a share above 0 and up to 1", split.train));
    }
    if !(0.0..1.0).contains(&split.held_out) {
        return wrong("held_out", format!("{}; use a share from 0 up to, but not, 1", split.held_out));
    }
    let open: Vec<usize> =
        (0..dataset.num_episodes()).filter(|&episode| !is_held_out(episode, split.held_out)).collect();
    let chosen = split_episodes(open.len(), &[split.train, 1.0 - split.train], split.seed)?;
    let [train, validation] =
        [0, 1].map(|part: usize| -> Vec<usize> { chosen[part].iter().map(|&index| open[index]).collect() });
    if train.is_empty() {
        return wrong("split", format!("no episode of {} is left to learn from", dataset.num_episodes()));
    }
    Ok([train, validation])
}

/// The episodes that validate; those that are learnt from where none is left for that.
///
/// # Errors
///
/// A share out of range, or no episode to learn from.
pub fn validation_episodes(dataset: &dyn Dataset, split: Split) -> Result<Vec<usize>, BaselineError> {
    let [train, validation] = parts(dataset, split)?;
    Ok(if validation.is_empty() { train } else { validation })
}

fn scales(
    dataset: &mut dyn Dataset,
    baseline: &str,
    columns: &[&str],
) -> Result<BTreeMap<String, Scale>, BaselineError> {
    let keys = columns.iter().map(|&name| name.to_owned()).collect();
    let options = StatisticsOptions { keys: Some(keys), quantiles: Vec::new(), sample: 1 };
    let statistics = Statistics::compute(dataset, &options)?;
    let scale = |(name, column): (String, ColumnStatistics)| match Scale::of(&column) {
        Some(scale) => Ok((name, scale)),
        None => {
            let reason = format!("no row of its column `{name}` is finite; record it anew");
            Err(columns_error(dataset, baseline, reason))
        }
    };
    statistics.columns.into_iter().map(scale).collect()
}

fn options(input_spec: &InputSpec, columns: &[&str]) -> ClipOptions {
    ClipOptions::default()
        .num_steps(input_spec.num_steps)
        .frameskip(input_spec.frameskip)
        .keys(Some(columns.iter().map(|&name| name.to_owned()).collect()))
        .images(Images::ChannelsFirst)
        .image(Some(ImageSize { height: input_spec.image, width: input_spec.image }))
        // As many read ahead as compute, so that a limit on threads is one on readers.
        .threads(Some(rayon::current_num_threads()))
}

fn goal_options(goals: &PhaseGoals, columns: &[&str], seed: u64) -> GoalOptions {
    let seen = columns.iter().filter(|name| **name != ACTION).map(|&name| name.to_owned()).collect();
    GoalOptions::default()
        .weights(goals.weights)
        .gamma(goals.gamma)
        .offset(Some(goals.offset))
        .keys(Some(seen))
        .seed(seed)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use swm_core::{Batch, Dtype, Field, Schema};
    use swm_data::MemoryDataset;

    use super::*;
    use crate::train::tests::toy_phase;

    /// Episodes of 6 steps with 2×2 images; the first action component is 5 everywhere, the second the step.
    fn dataset(episodes: usize, images: bool) -> MemoryDataset {
        let mut fields = vec![Field::step(ACTION, Dtype::F32, &[2])];
        if images {
            fields.push(Field::step(PIXELS, Dtype::U8, &[2, 2, 3]));
        }
        let schema = Schema::new(fields).unwrap();
        let mut episode = Batch::new(schema.clone(), 6);
        for row in 0..6 {
            let value = if row == 5 { f32::NAN } else { row as f32 };
            episode.rows_mut().select(row).write(0, &[5.0, value]);
        }
        let episode = Arc::new(episode);
        MemoryDataset::new("toy", schema, None, (0..episodes).map(|_| episode.clone())).unwrap()
    }

    fn open(episodes: usize, images: bool, proprio: bool, split: Split) -> Result<TrainData, BaselineError> {
        let input_spec = InputSpec { num_steps: 2, frameskip: 2, image: 2, proprio, batch: 4 };
        TrainData::new(&dataset(episodes, images), "lewm", &input_spec, &[toy_phase()], split, 0)
    }

    #[test]
    fn episodes_are_split_whole() {
        let clips = |split| open(10, true, false, split).unwrap().phases.remove(0);
        // 3 clips of 4 steps fit into 6.
        let data = clips(Split { train: 0.8, ..Split::default() });
        assert_eq!((data.train.len(), data.validation.unwrap().len()), (8 * 3, 2 * 3));
        let held_out = (0..10).filter(|&episode| is_held_out(episode, 0.5)).count();
        let data = clips(Split { train: 1.0, held_out: 0.5, seed: 1 });
        assert_eq!(data.train.len(), (10 - held_out) * 3);
        assert!(data.validation.is_none());
    }

    #[test]
    fn scales_are_those_of_scikit_learn() {
        let data = open(3, true, false, Split::default()).unwrap();
        // StandardScaler().fit([[5, 0], [5, 1], [5, 2], [5, 3], [5, 4]]): scale_ [1, sqrt(2)]
        let scale = &data.config.scales[ACTION];
        let near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-12;
        assert!(near(scale.mean[0], 5.0) && near(scale.mean[1], 2.0), "{scale:?}");
        assert!(scale.std[0] == 1.0 && near(scale.std[1], 2.0_f64.sqrt()), "{scale:?}");
        let mut rows = [5.0, 4.0, 6.0, f32::NAN];
        scale.apply(&mut rows);
        assert_eq!(rows, [0.0, 2.0_f32.sqrt(), 1.0, 0.0]);
    }

    #[test]
    fn what_is_missing_is_named() {
        let message = |images| open(3, images, true, Split::default()).err().unwrap().to_string();
        let no_images = message(false);
        assert!(no_images.contains("no column `pixels`, `proprio`, only `action`"), "{no_images}");
        assert!(no_images.contains("record it with images"), "{no_images}");
        assert!(message(true).contains("another baseline"));
        let input_spec = InputSpec { num_steps: 4, frameskip: 2, image: 2, proprio: false, batch: 4 };
        let short =
            TrainData::new(&dataset(3, true), "lewm", &input_spec, &[toy_phase()], Split::default(), 0);
        let short = short.err().unwrap().to_string();
        assert!(short.starts_with("toy cannot train lewm: ") && short.contains("spans 8 steps"), "{short}");
        assert!(short.contains("has 6; record longer ones"), "{short}");
        let share = |split| open(3, true, false, split).err().unwrap().to_string();
        assert!(share(Split { train: 0.0, ..Split::default() }).contains("above 0"));
        assert!(share(Split { held_out: 1.0, ..Split::default() }).contains("held_out"));
    }
}
