//! What a reader found in the files of another program: columns, each in arrays, and where the rows of episodes are in them.
//! What follows is the same for all: which camera becomes `pixels`, names, images of bytes, and the record of it all.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use swm_core::{Dtype, Field, FieldKind, Schema, SliceMut};
use swm_data::OpenOptions;
use swm_data::dataset::{Dataset, DatasetInfo, Steps};
use swm_data::element;
use swm_data::error::{At as _, DataError, Result, unsupported};
use swm_data::foreign::{REWARDS_NOTE, RewardsAt, source_record};

use super::array::{Scratch, Shared, Widened, common, of_other_program, values};
use super::dataset::{Column, ForeignDataset, Span};
use super::images;

/// What a reader found.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Rows of each episode.
    pub(super) lengths: Vec<usize>,
    pub(super) sources: Vec<Source>,
    /// What becomes no column, with the reason.
    pub(super) skipped: Vec<(String, String)>,
    /// What a user of the dataset has to know.
    pub(super) notes: Vec<String>,
    pub(super) fps: Option<f64>,
    /// The environment, where the files leave no doubt.
    pub(super) env: Option<&'static str>,
    /// Whether `reward` is in the row that an action led to, as in recordings of the reference and of this program.
    pub(super) has_rewards_of_arrival: bool,
}

/// A column.
#[derive(Debug)]
pub(super) struct Source {
    /// As the files name it; parts of a path are divided by `/`.
    pub(super) old: String,
    /// The name that it gets if nothing else is asked for.
    pub(super) new: String,
    pub(super) kind: FieldKind,
    pub(super) arrays: Vec<Shared>,
    /// By episode.
    pub(super) spans: Vec<Span>,
}

impl Source {
    /// A column of steps that is named after its path.
    pub(super) fn step(old: &str, new: &str, arrays: Vec<Shared>, spans: Vec<Span>) -> Self {
        Self { old: old.to_owned(), new: new.to_owned(), kind: FieldKind::Step, arrays, spans }
    }

    /// Gives the arrays the type that holds the values of all.
    fn unify(&mut self) -> Result<()> {
        let Some(first) = self.arrays.first().cloned() else { return Ok(()) };
        let mut dtype = first.dtype();
        for array in &self.arrays {
            let wider = common(dtype, array.dtype()).filter(|_| array.shape() == first.shape());
            dtype = wider.ok_or_else(|| {
                let of = |array: &Shared| format!("{} {:?}", array.dtype(), array.shape());
                let (first, array) = (of(&first), of(array));
                unsupported(format!("its rows are {first} in some episodes, and {array} in others; store all in one type and shape"))
            })?;
        }
        for array in self.arrays.iter_mut().filter(|array| array.dtype() != dtype) {
            *array = Arc::new(Widened(array.clone(), dtype));
        }
        Ok(())
    }
}

/// Why a column of u64 is left out, of which the first values of the first arrays are looked at: see [`element::too_large`].
fn too_large(arrays: &[Shared], scratch: &mut Scratch) -> Option<String> {
    let mut left = element::LOOKED_AT;
    arrays.iter().take_while(|array| array.is_u64()).find_map(|array| {
        let looked_at = left;
        left = left.saturating_sub(array.rows() * array.dim());
        let read = |steps, out: SliceMut<'_>| array.read(steps, out, scratch);
        let look = || element::too_large(looked_at, array.rows(), array.dim(), read);
        (looked_at > 0).then(look).flatten()
    })
}

/// Why a column of texts is left out, of which the first few are looked at: its values are bytes.
fn not_text(arrays: &[Shared], scratch: &mut Scratch) -> Option<String> {
    /// Texts of an array that are looked at.
    const LOOKED_AT: usize = 16;
    let array = arrays.iter().find(|array| array.rows() > 0).filter(|array| array.dtype() == Dtype::Str)?;
    let rows = Steps { first: 0, count: LOOKED_AT.min(array.rows()), stride: 1 };
    let error = values(array.as_ref(), rows, scratch).map_err(of_other_program).err()?;
    error.is_unsupported().then(|| error.to_string())
}

/// Names of the main camera, where there are several.
const MAIN_CAMERAS: &[&str] = &[
    "pixels",
    "image",
    "img",
    "observation.image",
    "observations.image",
    "obs.image",
    "obs.agentview_image",
    "obs.agentview_rgb",
];

impl Found {
    /// Where the rows of episodes are that lie end to end in an array.
    pub(super) fn end_to_end(&self) -> Vec<Span> {
        let mut first = 0;
        let mut spans = Vec::with_capacity(self.lengths.len());
        for &count in &self.lengths {
            spans.push(Span { array: 0, first, count, tail: None });
            first += count;
        }
        spans
    }

    /// Adds a column of steps whose arrays some files lack: it is missing in the episodes of these. `spans` are those of all files.
    pub(super) fn add_partial(&mut self, old: &str, new: &str, arrays: Vec<Option<Shared>>, spans: &[Span]) {
        let has: Vec<bool> = spans.iter().map(|span| arrays[span.array].is_some()).collect();
        self.note_absent(old, &has);
        let mut before = 0;
        let places: Vec<Option<usize>> = arrays
            .iter()
            .map(|array| {
                before += usize::from(array.is_some());
                array.as_ref().map(|_| before - 1)
            })
            .collect();
        let span = |span: &Span| match places[span.array] {
            Some(array) => Span { array, ..*span },
            None => Span::NONE,
        };
        let spans = spans.iter().map(span).collect();
        self.sources.push(Source::step(old, new, arrays.into_iter().flatten().collect(), spans));
    }

    /// Notes in how many episodes an array is not, if there are such: `has` says in which it is.
    pub(super) fn note_absent(&mut self, path: &str, has: &[bool]) {
        let without: Vec<usize> = (0..has.len()).filter(|&episode| !has[episode]).collect();
        let Some(first) = without.first() else { return };
        self.notes.push(format!(
            "`{path}` is not in {} of its {} episodes, the first of which is {first}: its rows are missing there (NaN, -1, no text, \
             black images)",
            without.len(),
            has.len()
        ));
    }

    /// The dataset. `known` names the options that acted already.
    pub(super) fn open(
        mut self,
        path: &Path,
        format: &'static str,
        options: &OpenOptions,
        known: &[&str],
    ) -> Result<Box<dyn Dataset>, DataError> {
        let all: Vec<&str> =
            ["map", "camera", "flip", "fps", "env"].into_iter().chain(known.iter().copied()).collect();
        options.only(format, &all)?;
        let damaged = |error| DataError::damaged(path, error);
        let mut scratch = Scratch::default();
        self.leave_out_empty();
        self.unify().map_err(damaged)?;
        self.leave_out_unreadable(&mut scratch);
        let cameras = self.cameras(path)?;
        let main = self.main_camera(options, &cameras)?;
        let names = self.names(options, &cameras, main)?;
        let (mut fields, mut columns, mut mapping) = (Vec::new(), Vec::new(), Vec::new());
        for (index, (source, name)) in std::mem::take(&mut self.sources).into_iter().zip(names).enumerate() {
            let old = source.old.clone();
            let Source { kind, spans, mut arrays, .. } = source;
            if let Some(&(_, layout)) = cameras.iter().find(|(at, _)| *at == index) {
                match images::converted(arrays, &spans, layout, options.flip, &mut scratch)
                    .at(&old)
                    .map_err(damaged)?
                {
                    Ok(converted) => arrays = converted,
                    Err(reason) if Some(index) == main && options.camera.is_some() => {
                        let reason = format!("the images of `{old}` cannot be read: {reason}");
                        return Err(DataError::Option { option: "camera", reason });
                    }
                    Err(reason) => {
                        self.skipped.push((name, reason));
                        continue;
                    }
                }
            }
            let Some(first) = arrays.first() else { continue };
            fields.push(Field {
                name: name.clone(),
                dtype: first.dtype(),
                shape: first.shape().to_vec(),
                kind,
            });
            columns.push(Column { arrays, spans });
            mapping.push((name, old));
        }
        if options.flip.is_some() && cameras.is_empty() {
            return Err(DataError::Option {
                option: "flip",
                reason: "the dataset has no images; leave it out".to_owned(),
            });
        }
        let has_rewards = !self.has_rewards_of_arrival && fields.iter().any(|field| field.name == "reward");
        let rewards = has_rewards.then_some(RewardsAt::Actions);
        self.notes.extend(rewards.map(|_| REWARDS_NOTE.to_owned()));
        let schema = Schema::new(fields).map_err(|error| damaged(error.into()))?;
        let mut info = DatasetInfo::new(path, format, schema, std::mem::take(&mut self.lengths));
        info.rows_per_second = options.fps.or(self.fps);
        let metadata = source_record(format, options, &mapping, self.env, self.fps, rewards);
        info.runs = Arc::new([(0, metadata)]);
        info.mapping = mapping.into();
        info.skipped = self.skipped.into();
        info.notes = self.notes.into();
        info.opening = Arc::new(options.record());
        Ok(Box::new(ForeignDataset::new(info, columns)))
    }

    /// Leaves out episodes without rows, which no dataset of this program has.
    fn leave_out_empty(&mut self) {
        let has_rows: Vec<bool> = self.lengths.iter().map(|&length| length > 0).collect();
        let empty: Vec<usize> = (0..has_rows.len()).filter(|&episode| !has_rows[episode]).collect();
        let Some(first) = empty.first() else { return };
        self.notes.push(format!(
            "{} of its {} episodes have no rows and are left out; the first of them is episode {first}",
            empty.len(),
            has_rows.len()
        ));
        self.lengths.retain(|&length| length > 0);
        for source in &mut self.sources {
            let mut has_rows = has_rows.iter();
            source.spans.retain(|_| has_rows.next() == Some(&true));
        }
    }

    /// Gives the arrays of each column one type; leaves out those that have none, or rows of several shapes, but for actions.
    fn unify(&mut self) -> Result<()> {
        for mut source in std::mem::take(&mut self.sources) {
            match source.unify() {
                Ok(()) => self.sources.push(source),
                Err(error) if source.new == "action" => return Err(error.at(&source.old)),
                Err(error) => self.skipped.push((source.new, error.to_string())),
            }
        }
        Ok(())
    }

    /// Leaves out columns that this program has no values for: rows of none, whole numbers beyond the range of i64, and texts that are
    /// bytes.
    fn leave_out_unreadable(&mut self, scratch: &mut Scratch) {
        let Self { sources, skipped, .. } = self;
        sources.retain(|source| {
            let reason = match source.arrays.first() {
                Some(array) if array.dim() == 0 => Some("its rows hold no values".to_owned()),
                _ => too_large(&source.arrays, scratch).or_else(|| not_text(&source.arrays, scratch)),
            };
            let is_read = reason.is_none();
            skipped.extend(reason.map(|reason| (source.new.clone(), reason)));
            is_read
        });
    }

    /// Positions of columns that are images, with their layout.
    fn cameras(&self, path: &Path) -> Result<Vec<(usize, images::Layout)>, DataError> {
        let mut cameras = Vec::new();
        for (index, source) in self.sources.iter().enumerate() {
            let Some(first) = source.arrays.first() else { continue };
            if source.kind == FieldKind::Step
                && let Some(layout) = images::layout(first.dtype(), first.shape())
            {
                let layout = layout.map_err(|reason| DataError::damaged(path, reason.at(&source.old)))?;
                cameras.push((index, layout));
            }
        }
        Ok(cameras)
    }

    /// The one that becomes `pixels`.
    fn main_camera(
        &self,
        options: &OpenOptions,
        cameras: &[(usize, images::Layout)],
    ) -> Result<Option<usize>, DataError> {
        let name = |index: usize| self.sources[index].new.as_str();
        let listed =
            || cameras.iter().map(|&(index, _)| format!("`{}`", name(index))).collect::<Vec<_>>().join(", ");
        let refuse = |reason| Err(DataError::Option { option: "camera", reason });
        if let Some(wanted) = &options.camera {
            let fits: Vec<usize> = cameras
                .iter()
                .map(|&(index, _)| index)
                .filter(|&index| self.is_camera(index, wanted))
                .collect();
            return match fits[..] {
                [one] => Ok(Some(one)),
                _ if cameras.is_empty() => refuse("the dataset has no images; leave it out".to_owned()),
                [] => refuse(format!("no camera is called `{wanted}`; there are {}", listed())),
                _ => refuse(format!("several cameras are called `{wanted}`; there are {}", listed())),
            };
        }
        if options.map.contains_key("pixels") {
            return Ok(None);
        }
        match cameras[..] {
            [] => Ok(None),
            [(one, _)] => Ok(Some(one)),
            _ => {
                let mut main = cameras
                    .iter()
                    .map(|&(index, _)| index)
                    .filter(|&index| MAIN_CAMERAS.contains(&name(index)));
                match (main.next(), main.next()) {
                    (Some(one), None) => Ok(Some(one)),
                    _ => refuse(format!(
                        "the dataset has several cameras, {}; name the one that becomes `pixels`",
                        listed()
                    )),
                }
            }
        }
    }

    /// Whether a camera is called so: by either of its names, or a part of it.
    fn is_camera(&self, index: usize, wanted: &str) -> bool {
        let Source { old, new, .. } = &self.sources[index];
        let is_name = |part: &str| {
            let short = part.strip_suffix("_image").or_else(|| part.strip_suffix("_rgb"));
            part == wanted || short == Some(wanted)
        };
        old == wanted || new == wanted || old.split('/').any(is_name) || new.rsplit('.').take(2).any(is_name)
    }

    /// The names of all columns: each once.
    fn names(
        &self,
        options: &OpenOptions,
        cameras: &[(usize, images::Layout)],
        main: Option<usize>,
    ) -> Result<Vec<String>, DataError> {
        let mut names: Vec<String> = self.sources.iter().map(|source| source.new.clone()).collect();
        let mut fixed = BTreeSet::new();
        if let Some(main) = main {
            names[main] = "pixels".to_owned();
            fixed.insert(main);
        }
        for (new, old) in &options.map {
            let found = self.sources.iter().position(|source| source.old == *old || source.new == *old);
            let Some(at) = found.or_else(|| names.iter().position(|name| name == old)) else {
                let known: Vec<String> =
                    self.sources.iter().map(|source| format!("`{}`", source.old)).collect();
                let reason =
                    format!("the dataset has no `{old}` to become `{new}`; it has {}", known.join(", "));
                return Err(DataError::Option { option: "map", reason });
            };
            if new == "pixels" && !cameras.iter().any(|&(camera, _)| camera == at) {
                let reason = format!("`{old}` holds no images, and cannot become `pixels`");
                return Err(DataError::Option { option: "map", reason });
            }
            if !fixed.insert(at) {
                let reason = format!("`{old}` would get two names, `{}` and `{new}`", names[at]);
                return Err(DataError::Option { option: "map", reason });
            }
            new.clone_into(&mut names[at]);
        }
        // What lost its name to another has the one of the file.
        for at in (0..names.len()).filter(|at| !fixed.contains(at)).collect::<Vec<_>>() {
            let is_taken = |name: &str, names: &[String]| {
                names.iter().enumerate().any(|(other, there)| other != at && there == name)
            };
            if is_taken(&names[at], &names) {
                let plain = self.sources[at].old.replace('/', ".");
                let free = (1..).map(|n| if n == 1 { plain.clone() } else { format!("{plain}_{n}") });
                names[at] = free.into_iter().find(|name| !is_taken(name, &names)).unwrap_or_default();
            }
        }
        for name in &mut names {
            if ["ep_idx", "step_idx", "ep_len", "ep_offset"].contains(&name.as_str()) {
                name.insert_str(0, "source.");
            }
        }
        Ok(names)
    }
}
