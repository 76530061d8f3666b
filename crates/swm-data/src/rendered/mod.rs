//! Datasets whose images are drawn when they are read: of any size, with any factors in place of the recorded ones.
//!
//! A recording without images is a hundredth to a thousandth of one with them. What it holds (seed, factors, actions,
//! and now and then the environment's saved state) determines every image, so [`Rendered`] replays the episode from
//! the checkpoint before the wanted row and draws. Where it passes a checkpoint, it compares: a simulator that has
//! changed since is an error and not a wrong image.
//!
//! This module knows the traits of environments and no environment: the registry is the caller's.

mod looks;
mod stage;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde_json::{Map, Value as Json};
use swm_core::dataset::{CHECKPOINT, Checkpoints};
use swm_core::env::VARIATION_PREFIX;
use swm_core::error::{BoxError, did_you_mean, nearest};
use swm_core::{
    BatchError, Dtype, EnvConfig, EnvEntry, EnvSpec, FactorSpec, Field, FieldKind, ImageSize, MAX_FRAME_SKIP,
    Metadata, Registry, Schema, SliceMut, Value,
};

use crate::dataset::{Dataset, DatasetInfo, Steps};
use crate::error::DataError;

pub use looks::Looks;

use looks::{LookSampler, not_visual};
use stage::{Shown, Stage};

/// The column of images in the canonical look.
pub const CANONICAL: &str = "canonical";

/// How images are drawn.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RenderOptions {
    /// Their size.
    pub image: ImageSize,
    /// Factors to set in place of the recorded ones: other colors, another light. One that is not visual is an error, as the recorded
    /// states would not be those in the images; without `verify`, it is replayed with.
    pub factors: BTreeMap<String, Value>,
    /// Looks that a loader samples for every clip and epoch. Reads without a loader show the usual look.
    pub looks: Option<Looks>,
    /// Visual factors of the canonical look: adds the column `canonical`, the image of the same row with these values in place of those
    /// that `factors` and `looks` give. An empty table is the recorded look.
    pub canonical: Option<BTreeMap<String, Value>>,
    /// Settings of the environment on top of the recorded ones, such as its image style.
    pub settings: Map<String, Json>,
    /// Compare with the checkpoints on the way.
    pub verify: bool,
}

setters!(RenderOptions {
    image: ImageSize,
    factors: BTreeMap<String, Value>,
    looks: Option<Looks>,
    canonical: Option<BTreeMap<String, Value>>,
    settings: Map<String, Json>,
    verify: bool,
});

impl Default for RenderOptions {
    /// As recorded, 64 × 64, verified.
    fn default() -> Self {
        let image = ImageSize { height: 64, width: 64 };
        Self {
            image,
            factors: BTreeMap::new(),
            looks: None,
            canonical: None,
            settings: Map::new(),
            verify: true,
        }
    }
}

/// The environment `id` that a file names; `said` begins the error, such as "it was recorded in".
///
/// # Errors
///
/// This program does not have it: it is of another program, or of another build of this one.
pub fn env_named(registry: &Registry, id: &str, said: &str) -> Result<&'static EnvEntry, BoxError> {
    registry.env(id).map_err(|error| match error.fix {
        Some(_) => error.into(),
        None => format!(
            "{said} `{id}`, an environment of another program; use the program that has it, such as the command of a plugin \
             crate"
        )
        .into(),
    })
}

/// A dataset with images that are drawn on demand: the columns of the recording, without `checkpoint`, and the
/// environment's image columns behind them (in place of stored ones).
pub struct Rendered {
    inner: Box<dyn Dataset>,
    script: Arc<Script>,
    info: DatasetInfo,
    /// For every column, where its values come from.
    columns: Arc<[Origin]>,
    /// Made at the first image.
    stage: Option<Stage>,
    /// Factors that are sampled for the clip that is read.
    sampled: BTreeMap<String, Value>,
}

#[derive(Clone, Copy, Debug)]
enum Origin {
    /// A column of the recording.
    Stored(usize),
    /// An image field of the environment.
    Drawn(usize),
    /// The image field of this position in the canonical look.
    Canonical(usize),
    /// The factor of this position in the environment, as images show it; where it is a column of the recording, which.
    Factor(usize, Option<usize>),
}

/// What the replay of any episode needs to know.
struct Script {
    entry: EnvEntry,
    /// How the environment that replays is made: as the recorded one, without images.
    sim: EnvConfig,
    /// How the environment that draws is made.
    painter: EnvConfig,
    /// Factors of the replay that differ from the recorded ones.
    factors: BTreeMap<String, Value>,
    /// Visual factors of all images that differ from the recorded ones.
    look: BTreeMap<String, Value>,
    /// What a loader samples.
    looks: Option<LookSampler>,
    /// Visual factors of the column `canonical`.
    canonical: Option<BTreeMap<String, Value>>,
    /// Of the environment, for columns of factors: names and defaults.
    defaults: Vec<(String, Value)>,
    frame_skip: u32,
    checkpoints: Option<Checkpoints>,
    verify: bool,
}

/// Without checkpoints, the state's columns are compared so often.
const COMPARED_ROWS: usize = 16;

impl Script {
    /// The visual factors of images that are not the recorded ones, where a loader has sampled these.
    fn shown(&self, sampled: &BTreeMap<String, Value>) -> BTreeMap<String, Value> {
        let mut look = self.look.clone();
        look.extend(sampled.clone());
        look
    }

    /// From one comparison with the recording to the next.
    fn compared_rows(&self) -> usize {
        self.checkpoints.map_or(COMPARED_ROWS, |checkpoints| checkpoints.every())
    }
}

impl Rendered {
    /// Draws the images of `dataset`, which must say how it was recorded; `registry` knows its environment.
    ///
    /// # Errors
    ///
    /// The dataset does not say how it was recorded, its environment is unknown, refuses the settings or factors, or
    /// draws no images.
    pub fn new(
        dataset: Box<dyn Dataset>,
        registry: &Registry,
        options: &RenderOptions,
    ) -> Result<Self, DataError> {
        let refuse = |reason: BoxError| DataError::request(dataset.path(), reason);
        let Some(metadata) = dataset.metadata().and_then(Metadata::of_known_env) else {
            return Err(refuse(
                "images cannot be drawn: it does not say how it was recorded (by another program)".into(),
            ));
        };
        if metadata.frame_skip > MAX_FRAME_SKIP {
            let reason = format!("its frame skip of {} is more than {MAX_FRAME_SKIP}", metadata.frame_skip);
            return Err(refuse(reason.into()));
        }
        let said = "images cannot be drawn: it was recorded in";
        let entry = *env_named(registry, &metadata.env, said).map_err(refuse)?;
        let mut settings = metadata.settings.clone();
        settings.extend(options.settings.clone());
        let painter = EnvConfig { image: Some(options.image), settings: settings.clone() };
        let spec = entry.make(&painter).map_err(|error| refuse(error.into()))?.spec().clone();
        let set = factors(dataset.path(), &spec, &options.factors)?;
        let is_visual =
            |name: &String| spec.factors.iter().any(|factor| factor.visual && factor.name == *name);
        let (look, factors): (BTreeMap<_, _>, BTreeMap<_, _>) =
            set.into_iter().partition(|(name, _)| is_visual(name));
        // Checkpoints would find most of them, late, and let pass what touches nothing that they hold.
        if let Some(name) = factors.keys().next().filter(|_| options.verify) {
            return Err(refuse(not_visual(&spec, name).into()));
        }
        let looks = options.looks.as_ref().map(|looks| LookSampler::new(looks, &spec)).transpose();
        let looks = looks.map_err(|reason| refuse(reason.into()))?;
        let canonical =
            options.canonical.as_ref().map(|look| self::factors(dataset.path(), &spec, look)).transpose()?;
        if let Some(name) = canonical.iter().flatten().map(|(name, _)| name).find(|name| !is_visual(name)) {
            return Err(refuse(not_visual(&spec, name).into()));
        }
        let drawn = images(&spec, options.image);
        if drawn.is_empty() {
            return Err(refuse(format!("`{}` draws no images", spec.id).into()));
        }
        let shown = |name: &str| {
            look.contains_key(name)
                || looks.iter().flat_map(LookSampler::factors).any(|factor| factor.name == name)
        };
        let (columns, fields) = columns(dataset.schema(), &spec, &drawn, canonical.is_some(), &shown);
        let schema = Schema::new(fields).map_err(|error| refuse(error.to_string().into()))?;
        let script = Script {
            entry,
            sim: EnvConfig { image: None, settings },
            painter,
            factors,
            look,
            looks,
            canonical,
            defaults: defaults(&spec).map_err(|error| refuse(error.into()))?,
            frame_skip: metadata.frame_skip.max(1),
            checkpoints: Checkpoints::of(dataset.schema(), metadata.checkpoints),
            verify: options.verify,
        };
        let mut info = dataset.info().with_schema(schema);
        let set: Vec<(String, Json)> =
            script.look.iter().map(|(name, value)| (name.clone(), value.to_json())).collect();
        let with_images = |(first, run): &(u64, Metadata)| {
            let mut run = Metadata { image: Some(options.image), checkpoints: None, ..run.clone() };
            run.variation_values.extend(set.clone());
            (*first, run)
        };
        info.runs = info.runs.iter().map(with_images).collect();
        Ok(Self {
            info,
            columns: columns.into(),
            script: Arc::new(script),
            stage: None,
            sampled: BTreeMap::new(),
            inner: dataset,
        })
    }

    /// Replays a whole episode and compares it with all of its checkpoints; how many there were.
    ///
    /// # Errors
    ///
    /// No such episode, reading or simulating fails, or a checkpoint differs.
    pub fn verify(&mut self, episode: usize) -> Result<usize, DataError> {
        let len = self.inner.episode_len(episode);
        if episode >= self.inner.num_episodes() {
            let reason = format!("episode {episode} of {} does not exist", self.inner.num_episodes());
            return Err(DataError::request(self.path(), reason));
        }
        let Some(checkpoints) = self.script.checkpoints else { return Ok(0) };
        let stage = stage(&mut self.stage, self.inner.as_ref(), &self.script, &self.sampled)?;
        stage.rewind(self.inner.as_mut(), &self.script, episode)?;
        stage.advance(self.inner.as_mut(), &self.script, len.saturating_sub(1), true)?;
        Ok(len / checkpoints.every())
    }

    /// Rows of a factor as images show it.
    fn factor_rows(
        &mut self,
        factor: usize,
        stored: Option<usize>,
        episode: usize,
        steps: Steps,
        mut out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let (name, default) = &self.script.defaults[factor];
        let shown = self.sampled.get(name).or_else(|| self.script.look.get(name));
        let value = match (shown, stored) {
            (Some(value), _) => value,
            (None, Some(stored)) => return self.inner.rows(stored, episode, steps, out),
            (None, None) => default,
        };
        while !out.is_empty() {
            let (mut row, rest) = out.split_at(value.data.len());
            out = rest;
            assert!(row.copy_from(value.data.as_slice()), "the value was cast to the factor's type");
        }
        Ok(())
    }

    /// The distance of checkpoints in rows; `None` if the dataset has none, and every episode is replayed from its start.
    pub fn checkpoint_rows(&self) -> Option<usize> {
        self.script.checkpoints.map(|checkpoints| checkpoints.every())
    }
}

/// The stage of one handle, made if it is not there yet.
fn stage<'a>(
    stage: &'a mut Option<Stage>,
    dataset: &dyn Dataset,
    script: &Script,
    sampled: &BTreeMap<String, Value>,
) -> Result<&'a mut Stage, DataError> {
    match stage {
        Some(stage) => Ok(stage),
        None => {
            let mut made = Stage::new(dataset, script)?;
            made.dress(dataset, &script.shown(sampled))?;
            Ok(stage.insert(made))
        }
    }
}

/// The columns of the dataset with images, and where their values come from: those of the recording, without `checkpoint` and with factors
/// as images show them, those that images show otherwise than always, and images.
fn columns(
    recorded: &Schema,
    spec: &EnvSpec,
    drawn: &[(usize, Field)],
    with_canonical: bool,
    is_shown: &dyn Fn(&str) -> bool,
) -> (Vec<Origin>, Vec<Field>) {
    let (mut columns, mut fields) = (Vec::new(), Vec::new());
    let position = |name: &str| spec.factors.iter().position(|factor| factor.name == name);
    let shown =
        |column: &str| column.strip_prefix(VARIATION_PREFIX).filter(|name| is_shown(name)).and_then(position);
    for (column, field) in recorded.fields().iter().enumerate() {
        let is_drawn = drawn.iter().any(|(_, image)| image.name == field.name);
        if field.name == CHECKPOINT || is_drawn || (with_canonical && field.name == CANONICAL) {
            continue;
        }
        columns.push(match shown(&field.name) {
            Some(factor) => Origin::Factor(factor, Some(column)),
            None => Origin::Stored(column),
        });
        fields.push(field.clone());
    }
    for (at, factor) in spec.factors.iter().enumerate() {
        let name = format!("{VARIATION_PREFIX}{}", factor.name);
        if is_shown(&factor.name)
            && recorded.index(&name).is_none()
            && let Some(field) = spec.fields.iter().find(|field| field.name == name)
        {
            columns.push(Origin::Factor(at, None));
            fields.push(field.clone());
        }
    }
    for (index, field) in drawn {
        columns.push(Origin::Drawn(*index));
        fields.push(field.clone());
    }
    if with_canonical
        && let Some((index, field)) = drawn.iter().find(|(_, field)| field.kind == FieldKind::Step)
    {
        columns.push(Origin::Canonical(*index));
        fields.push(Field { name: CANONICAL.to_owned(), ..field.clone() });
    }
    (columns, fields)
}

/// Names and defaults of the factors of an environment.
fn defaults(spec: &EnvSpec) -> Result<Vec<(String, Value)>, BatchError> {
    let default = |factor: &FactorSpec| {
        let value = Value::from_json(&factor.name, &factor.default)?;
        let value = match factor.space.dtype() {
            Some(dtype) => value.cast(&factor.name, dtype, &factor.space.shape())?,
            None => value,
        };
        Ok((factor.name.clone(), value))
    };
    spec.factors.iter().map(default).collect()
}

/// The image fields of an environment, with their positions.
fn images(spec: &EnvSpec, image: ImageSize) -> Vec<(usize, Field)> {
    let fields = spec.fields.iter().enumerate();
    let drawn = fields.filter(|(_, field)| field.dtype == Dtype::U8 && field.shape == image.shape());
    drawn.map(|(index, field)| (index, field.clone())).collect()
}

/// The factors to set, as the environment's types.
fn factors(
    path: &Path,
    spec: &EnvSpec,
    wanted: &BTreeMap<String, Value>,
) -> Result<BTreeMap<String, Value>, DataError> {
    let refuse = |error: BatchError| DataError::request(path, error);
    let mut values = BTreeMap::new();
    for (name, value) in wanted {
        let name = name.strip_prefix(VARIATION_PREFIX).unwrap_or(name);
        let Some(factor) = spec.factors.iter().find(|factor| factor.name == name) else {
            let near = nearest(name, spec.factors.iter().map(|factor| factor.name.as_str()));
            let hint = did_you_mean(near.as_deref());
            return Err(DataError::request(path, format!("`{}` has no factor `{name}`{hint}", spec.id)));
        };
        let Some(dtype) = factor.space.dtype() else {
            return Err(DataError::request(path, format!("factor `{name}` has no single type")));
        };
        let value = value.cast(name, dtype, &factor.space.shape()).map_err(refuse)?;
        factor.space.check(name, value.data.as_slice()).map_err(refuse)?;
        values.insert(name.to_owned(), value);
    }
    Ok(values)
}

impl Dataset for Rendered {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let (index, painter) = match self.columns[column] {
            Origin::Stored(stored) => return self.inner.rows(stored, episode, steps, out),
            Origin::Factor(factor, stored) => return self.factor_rows(factor, stored, episode, steps, out),
            Origin::Drawn(index) => (index, Shown::Look),
            Origin::Canonical(index) => (index, Shown::Canonical),
        };
        let field = self.info.field(column);
        let (kind, width) = (field.kind, field.dim());
        let SliceMut::U8(out) = out else { return Ok(()) };
        let stage = stage(&mut self.stage, self.inner.as_ref(), &self.script, &self.sampled)?;
        if kind == FieldKind::Episode {
            let Some((first, rest)) = out.split_at_mut_checked(width) else { return Ok(()) };
            stage.draw_episode(self.inner.as_mut(), &self.script, episode, steps.first, index, first)?;
            rest.chunks_exact_mut(width).for_each(|copy| copy.copy_from_slice(first));
            return Ok(());
        }
        for (at, image) in out.chunks_exact_mut(width).enumerate() {
            let row = steps.first + at * steps.stride;
            let last = steps.first + (steps.count - 1) * steps.stride;
            stage.draw(self.inner.as_mut(), &self.script, [episode, row, last], (painter, index), image)?;
        }
        Ok(())
    }

    fn dress(&mut self, key: Option<[u64; 2]>) -> Result<(), DataError> {
        let Some(looks) = &self.script.looks else { return Ok(()) };
        self.sampled = key.map(|key| looks.look(key)).unwrap_or_default();
        match &mut self.stage {
            Some(stage) => stage.dress(self.inner.as_ref(), &self.script.shown(&self.sampled)),
            None => Ok(()),
        }
    }

    fn share(&self) -> Box<dyn Dataset> {
        let Self { inner, script, info, columns, .. } = self;
        let (script, info, columns) = (script.clone(), info.clone(), columns.clone());
        Box::new(Self { inner: inner.share(), script, info, columns, stage: None, sampled: BTreeMap::new() })
    }
}
