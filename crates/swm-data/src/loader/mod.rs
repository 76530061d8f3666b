//! The windowed loader: clips of `num_steps` rows at a `frameskip`, for training world models.
//!
//! A clip spans `num_steps × frameskip` rows of one episode. Columns are taken every `frameskip` rows and have the
//! shape `[num_steps, …]`; the column `action` stays dense, since all actions between two observations matter, and
//! has the shape `[num_steps, frameskip × A]`. Batches are filled by several threads into a table that is reused;
//! what they hold depends on nothing but the dataset, the options, the seed and the epoch.

mod clips;
mod epoch;

use std::sync::Arc;

use rayon::prelude::*;
use swm_core::{Batch, Dtype, Field, RowsMut, Schema, SliceMut};

use crate::dataset::{Dataset, Steps};
use crate::error::DataError;

pub use clips::{Clip, Clips};
pub use epoch::Epoch;

use clips::ClipIndex;

/// The column that stays dense under a frame skip.
const ACTION: &str = "action";

/// What a clip is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClipOptions {
    /// Rows of a clip, as seen by the model.
    pub num_steps: usize,
    /// Distance in the dataset between two of them.
    pub frameskip: usize,
    /// The wanted columns; `None` or an empty list: all.
    pub keys: Option<Vec<String>>,
    /// Where clips start.
    pub clips: Clips,
    /// The order of picture axes.
    pub pictures: Pictures,
    /// Threads that read; `None`: one per core. Results do not depend on it.
    pub threads: Option<usize>,
}

/// The order of axes of pictures (u8 columns of rank 3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pictures {
    /// `[num_steps, H, W, C]`, as stored.
    #[default]
    ChannelsLast,
    /// `[num_steps, C, H, W]`, as the reference's loader gives them.
    ChannelsFirst,
}

impl Default for ClipOptions {
    /// Single rows, all columns, every start.
    fn default() -> Self {
        Self {
            num_steps: 1,
            frameskip: 1,
            keys: None,
            clips: Clips::default(),
            pictures: Pictures::default(),
            threads: None,
        }
    }
}

/// Reads clips of one dataset.
pub struct Loader {
    workers: Vec<Worker>,
    index: ClipIndex,
    windows: Vec<Window>,
    schema: Arc<Schema>,
}

/// One column of a clip: what is read for it.
#[derive(Clone, Debug)]
struct Window {
    /// Position in the dataset.
    column: usize,
    count: usize,
    stride: usize,
    /// `[H × W, C]` of pictures whose axes are swapped.
    swap: Option<(usize, usize)>,
}

/// A handle on the dataset, and memory for one clip's pictures.
struct Worker {
    dataset: Box<dyn Dataset>,
    pictures: Vec<u8>,
}

impl Loader {
    /// Checks the options against the dataset.
    pub fn new(dataset: Box<dyn Dataset>, options: &ClipOptions) -> Result<Self, DataError> {
        let wrong = |setting, reason: String| Err(DataError::Loader { setting, reason });
        let (steps, skip) = (options.num_steps, options.frameskip);
        if steps == 0 {
            return wrong("num_steps", "0 rows; use 1 or more".to_owned());
        }
        if skip == 0 {
            return wrong("frameskip", "0; use 1 for every row".to_owned());
        }
        let Some(span) = steps.checked_mul(skip) else {
            return wrong("num_steps", format!("{steps} × frameskip {skip} rows are too many"));
        };
        let (mut windows, mut fields) = (Vec::new(), Vec::new());
        for column in chosen(dataset.as_ref(), options.keys.as_deref())? {
            let stored = &dataset.schema().fields()[column];
            let dense = stored.name == ACTION;
            let mut shape = stored.shape.clone();
            let mut swap = None;
            if dense {
                shape = vec![skip * stored.width()];
            } else if let ([h, w, c], Dtype::U8, Pictures::ChannelsFirst) =
                (&stored.shape[..], stored.dtype, options.pictures)
            {
                swap = Some((h * w, *c));
                shape = vec![*c, *h, *w];
            }
            shape.insert(0, steps);
            fields.push(Field { shape, ..stored.clone() });
            let (count, stride) = if dense { (span, 1) } else { (steps, skip) };
            windows.push(Window { column, count, stride, swap });
        }
        let schema = Schema::new(fields)
            .map_err(|error| DataError::Loader { setting: "keys", reason: error.to_string() })?;

        let lengths = (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode));
        let index = ClipIndex::new(lengths.clone(), span, options.clips);
        if index.len() == 0 {
            let longest = lengths.max().unwrap_or(0);
            return wrong(
                "num_steps",
                format!(
                    "a clip spans {span} rows ({steps} × frameskip {skip}), the longest episode has {longest}"
                ),
            );
        }
        let threads = options.threads.unwrap_or_else(rayon::current_num_threads).max(1);
        let worker = |dataset| Worker { dataset, pictures: Vec::new() };
        let mut workers: Vec<_> = (1..threads).map(|_| worker(dataset.share())).collect();
        workers.push(worker(dataset));
        Ok(Self { workers, index, windows, schema })
    }

    /// The number of clips.
    pub fn len(&self) -> usize {
        self.index.len()
    }

    /// Never true: a loader without clips is an error.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where clip `index` lies; `None` if there is no such clip.
    pub fn clip(&self, index: usize) -> Option<Clip> {
        self.index.get(index)
    }

    /// The columns of a batch: one row per clip, shapes `[num_steps, …]`.
    pub fn schema(&self) -> &Arc<Schema> {
        &self.schema
    }

    /// An empty table for [`Loader::read`] and [`Epoch::next_into`].
    pub fn new_batch(&self) -> Batch {
        Batch::new(self.schema.clone(), 0)
    }

    /// One pass over all clips in batches of `batch`; shuffled by `(seed, epoch)`, or in order.
    pub fn epoch(&mut self, batch: usize, shuffle: Option<(u64, u64)>) -> Epoch<'_> {
        Epoch::new(self, batch, shuffle)
    }

    /// Reads clips into `out`, a table of this loader; its old rows are replaced, its memory is reused.
    pub fn read(&mut self, clips: &[usize], out: &mut Batch) -> Result<(), DataError> {
        let wrong = |reason| Err(DataError::Loader { setting: "clips", reason });
        if out.schema() != &self.schema {
            return wrong("the batch was made for another loader; use `new_batch`".to_owned());
        }
        if let Some(index) = clips.iter().find(|&&index| index >= self.len()) {
            return wrong(format!("clip {index} does not exist, there are {}", self.len()));
        }
        out.resize(clips.len());
        let (index, windows) = (&self.index, &self.windows);
        let per_worker = clips.len().div_ceil(self.workers.len()).max(1);
        let mut rest = out.rows_mut();
        let mut jobs = Vec::with_capacity(self.workers.len());
        for (worker, clips) in self.workers.iter_mut().zip(clips.chunks(per_worker)) {
            let (part, after) = rest.split_at(clips.len());
            rest = after;
            jobs.push((worker, clips, part));
        }
        let run = |(worker, clips, part): (&mut Worker, &[usize], RowsMut<'_>)| {
            worker.read(clips.iter().filter_map(|&clip| index.get(clip)), windows, part)
        };
        // Of several errors, the one that comes first in the batch.
        match jobs.len() {
            1 => jobs.into_iter().try_for_each(run),
            _ => jobs.into_par_iter().map(run).collect::<Vec<_>>().into_iter().collect(),
        }
    }
}

impl Worker {
    fn read(
        &mut self,
        clips: impl Iterator<Item = Clip>,
        windows: &[Window],
        mut rows: RowsMut<'_>,
    ) -> Result<(), DataError> {
        for clip in clips {
            let (mut row, after) = rows.split_at(1);
            rows = after;
            for (target, window) in windows.iter().enumerate() {
                let steps = Steps { first: clip.start, count: window.count, stride: window.stride };
                let out = row.slice_mut(target);
                match (window.swap, out) {
                    (Some((pixels, channels)), SliceMut::U8(out)) => {
                        self.pictures.resize(out.len(), 0);
                        let stored = SliceMut::U8(&mut self.pictures);
                        self.dataset.read_column(window.column, clip.episode, steps, stored)?;
                        channels_first(&self.pictures, pixels, channels, out);
                    }
                    (_, out) => self.dataset.read_column(window.column, clip.episode, steps, out)?,
                }
            }
        }
        Ok(())
    }
}

/// `[T, H × W, C]` → `[T, C, H × W]`.
fn channels_first(stored: &[u8], pixels: usize, channels: usize, out: &mut [u8]) {
    let picture = (pixels * channels).max(1);
    for (from, into) in stored.chunks_exact(picture).zip(out.chunks_exact_mut(picture)) {
        if channels == 3 {
            // Of known size, for the compiler: several times faster.
            let (red, rest) = into.split_at_mut(pixels);
            let (green, blue) = rest.split_at_mut(pixels);
            for (((pixel, red), green), blue) in from.as_chunks::<3>().0.iter().zip(red).zip(green).zip(blue)
            {
                [*red, *green, *blue] = *pixel;
            }
            continue;
        }
        for (channel, plane) in into.chunks_exact_mut(pixels).enumerate() {
            for (value, pixel) in plane.iter_mut().zip(from.chunks_exact(channels)) {
                *value = pixel[channel];
            }
        }
    }
}

/// Positions of the wanted columns.
fn chosen(dataset: &dyn Dataset, keys: Option<&[String]>) -> Result<Vec<usize>, DataError> {
    let schema = dataset.schema();
    match keys {
        None | Some([]) => Ok((0..schema.fields().len()).collect()),
        Some(keys) => {
            let position = |key: &String| {
                let unknown = |error: swm_core::BatchError| DataError::Loader {
                    setting: "keys",
                    reason: error.to_string(),
                };
                schema.require(key).map_err(unknown)
            };
            keys.iter().map(position).collect()
        }
    }
}
