//! Copies of datasets, in any format: what conversion, merging and splitting share.

mod convert;
mod images;
mod merge;
mod split;

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;
use serde_json::{Map, Value as Json, json};
use swm_core::{ImageSize, Metadata, Registry, WorldError};
use swm_data::adapt::{Fit, Resized, Watched};
use swm_data::format::StoredImages;
use swm_data::tools::compatibility::rate_doubt;
use swm_data::tools::copy::{self, Piece, copy_in, is_same};
use swm_data::{DataError, Dataset, LastRow, OpenOptions, RenderOptions, Rendered, WriteMode, WriteOptions};

use super::report::apart;
use super::{
    Fix, ImageChoice, Message, Report, Stage, TaskError, create_parent, look_of, open_dataset_with, wrong,
};

pub use convert::Convert;
use images::first_size;
pub use images::holds_images;
pub use merge::Merge;
pub(super) use merge::check_exists;
pub use split::{Parts, Split};

/// The size of images where a recording without images is copied to a format that is for them.
const RENDERED: ImageSize = ImageSize { height: 64, width: 64 };
/// Frames between key frames, at most.
const MAX_KEY_FRAMES: u32 = 10_000;
/// Rows per second, at most.
const MAX_RATE: f64 = 1e6;

swm_core::settings! {
    /// How a copy of datasets is written.
    pub struct CopyOptions {
        /// The format of the copy.
        format: Option<String> = None => "by the file extension",
        /// Quality of images, 1 to 100, in lossy formats.
        quality: Option<u8> = None => "95 in `folder`, 85 in videos",
        /// Frames between key frames of a video; larger values give smaller files and slower random access.
        key_frames: Option<u32> = None => "10",
        /// Rows per second of the copy: in its record, its time stamps, its videos.
        ///
        /// Needed where sources have different rates, or timestamps of another rate than their dataset says.
        fps: Option<f64> = None => "that of the sources",
        /// Size of the images: those of datasets of other programs are resized, those of recordings of this program rendered.
        ///
        /// Rendered images come from a replay of the episodes, in place of recorded ones. With `fit`, all are resized. JSON is
        /// `{"height": 64, "width": 64}`, or `"none"` for images as they are.
        image_size: Option<ImageChoice> = None => "64x64 where a recording without images is copied to videos, else none",
        /// How images are resized: stretched, cropped to their middle, or padded with black.
        ///
        /// Needed where `image_size` has another shape than they have.
        fit: Option<Fit> = None => "images are not resized",
        /// Values of visual factors, by name, with which images are rendered anew.
        ///
        /// The copy has them in its columns of factors, and is otherwise the same. Needs recordings of this program.
        set: Map<String, Json> = Map::new() => "as recorded",
        /// What becomes of the last row of an episode, which has no action: left out of the tables, or kept.
        ///
        /// Acts in `lerobot`, whose users train on every row of a table. A row that is left out is beside the tables, and read back.
        last_row: Option<LastRow> = None => "drop in `lerobot`",
        /// Replace an existing dataset.
        ///
        /// Without it, a dataset that holds the first episodes of this copy is continued, and anything else is refused.
        overwrite: bool = false,
    }
}

/// A copy that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct DatasetCopy {
    /// The file or folder.
    pub out: PathBuf,
    /// Episodes that it holds.
    pub episodes: usize,
    /// Those that were there before.
    pub resumed: usize,
    /// Rows that were copied now.
    pub rows: usize,
    /// How long that took, in seconds.
    pub wall_time_s: f64,
}

/// A dataset to be written: where, and by which setting its place is given.
#[derive(Clone, Copy)]
struct Target<'a> {
    setting: &'static str,
    path: &'a Path,
}

/// An error of datasets: an option that is wrong is a wrong request about that setting.
fn of_data(error: DataError) -> TaskError {
    match error {
        DataError::Option { option, reason } => Message::about_setting(option, reason).into(),
        error => error.into(),
    }
}

/// What the work was ended by, where the user ended it.
pub(super) fn ended(error: TaskError, report: &dyn Report) -> TaskError {
    if report.cancel().is_cancelled() { WorldError::Cancelled.into() } else { error }
}

/// A size of images as JSON.
fn size_json(ImageSize { height, width }: ImageSize) -> Json {
    json!({ "height": height, "width": width })
}

impl CopyOptions {
    /// Refuses what is out of bounds, before anything is opened.
    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        if let Some(format) = &self.format {
            swm_data::format::by_name(registry, format)?;
        }
        let refuse = |name: &str, value: Json, text: &str| -> Result<(), TaskError> {
            Err(Message::about(name, value, text).into())
        };
        if let Some(quality) = self.quality.filter(|quality| !(1..=100).contains(quality)) {
            return refuse("quality", json!(quality), "use 1 to 100");
        }
        if let Some(period) = self.key_frames.filter(|period| !(1..=MAX_KEY_FRAMES).contains(period)) {
            return refuse("key_frames", json!(period), "use 1 to 10000");
        }
        if let Some(rate) = self.fps.filter(|rate| !(rate.is_finite() && *rate > 0.0 && *rate <= MAX_RATE)) {
            // JSON has no NaN.
            return refuse(
                "fps",
                json!(rate.to_string()),
                "a rate is a number above 0 and at most 1e6, as 25",
            );
        }
        if let Some(ImageChoice(Some(ImageSize { height, width }))) = self.image_size {
            ImageSize::new(height, width).map_err(wrong)?;
        }
        if let (Some(fit), false) = (self.fit, self.set.is_empty()) {
            let text = "resizes images that are there, and `set` renders them anew";
            let fixes = vec![Fix::Leave("fit"), Fix::Leave("set")];
            return Err(Message::about("fit", fit.name(), text).fix(Fix::Any(fixes)).into());
        }
        match (self.fit, self.image_size) {
            (Some(fit), None | Some(ImageChoice(None))) => {
                let fixes = vec![Fix::set("image_size", size_json(RENDERED)), Fix::Leave("fit")];
                let message = Message::about("fit", fit.name(), "no image is resized");
                Err(message.fix(Fix::Any(fixes)).into())
            }
            _ => Ok(()),
        }
    }

    fn options(&self) -> WriteOptions {
        let mode = if self.overwrite { WriteMode::Overwrite } else { WriteMode::Append };
        let options = WriteOptions::default().mode(mode).frames_per_second(self.fps);
        options.quality(self.quality).key_frame_period(self.key_frames).last_row(self.last_row)
    }

    /// Opens a source of a copy to `to`, with the images that the copy shall have.
    fn open(
        &self,
        registry: &Registry,
        source: &Path,
        to: &Path,
        opening: &OpenOptions,
        report: &mut dyn Report,
    ) -> Result<Box<dyn Dataset>, TaskError> {
        let opened = apart(report, || open_dataset_with(registry, source, opening))?;
        let dataset = opened.map_err(|error| ended(error, report))?;
        for (column, reason) in &*dataset.info().skipped {
            report.note(&Message::new(format!(
                "the copy has no column `{column}` of {}: {reason}",
                source.display()
            )));
        }
        let size = match self.image_size {
            Some(ImageChoice(size)) => size,
            None if holds_images(dataset.as_ref()) || !self.is_of_videos(registry, to) => None,
            None if dataset.metadata().and_then(Metadata::known_env).is_none() => {
                let (source, to) = (source.display(), to.display());
                report.note(&Message::new(format!(
                    "{source} holds no images and does not say how it was recorded, so that none can be rendered: {to} holds none \
                     either"
                )));
                None
            }
            None => {
                let text = format!("{} holds no images; they are rendered at {RENDERED}", source.display());
                let another =
                    Fix::Set { setting: super::Assignment::name("image_size"), to: "for another size" };
                report.note(&Message::new(text).fix(another));
                Some(RENDERED)
            }
        };
        let look = look_of(dataset.as_ref(), registry, &self.set, report)?;
        let size = match size {
            None if !look.is_empty() => {
                Some(first_size(dataset.as_ref()).ok_or_else(|| self.set_without_images())?)
            }
            size => size,
        };
        match size {
            Some(size) if look.is_empty() && self.resizes(dataset.as_ref()) => {
                Ok(Box::new(Resized::new(dataset, size, self.fit).map_err(of_data)?))
            }
            Some(size) => {
                let options = RenderOptions::default().image(size).factors(look);
                let rendered = apart(report, move || Rendered::new(dataset, registry, &options))?;
                Ok(Box::new(rendered.map_err(wrong)?))
            }
            None => Ok(dataset),
        }
    }

    fn set_without_images(&self) -> TaskError {
        let text = "the copy would have no images, and only images can be rendered with other factors";
        Message::about("set", self.set.clone(), text).fix(Fix::set("image_size", size_json(RENDERED))).into()
    }

    /// Whether the copy is of a format that is of little use without images.
    fn is_of_videos(&self, registry: &Registry, to: &Path) -> bool {
        let extension = to.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let format = swm_data::format::by_name(registry, self.format.as_deref().unwrap_or(extension));
        format.is_ok_and(|format| format.images == StoredImages::Video)
    }

    /// Whether images are resized, and not rendered anew.
    fn resizes(&self, dataset: &dyn Dataset) -> bool {
        let is_own = dataset.metadata().is_some_and(|run| run.known_env().is_some() && run.source.is_none());
        self.fit.is_some() || !is_own && holds_images(dataset)
    }

    /// Refuses a copy whose rate is in doubt, before anything is written; with `fps`, notes that this decides.
    fn check_rate(
        &self,
        sources: &mut [Box<dyn Dataset>],
        pieces: &[Piece],
        report: &mut dyn Report,
    ) -> Result<(), TaskError> {
        let Some(doubt) = rate_doubt(sources, pieces) else { return Ok(()) };
        let text = doubt.to_string();
        match (self.fps, doubt.rate) {
            (Some(rate), _) => {
                report.note(&Message::about("fps", rate, format!("{text}; the copy has this rate")));
                Ok(())
            }
            (None, Some(rate)) => {
                // Whole numbers as people write them.
                let rate = if rate.fract() == 0.0 { json!(rate as u64) } else { json!(rate) };
                Err(Message::new(text)
                    .fix(Fix::set_to("fps", rate, "to take the rate of the timestamps"))
                    .into())
            }
            (None, None) => Err(Message::new(text).fix(Fix::give("fps")).into()),
        }
    }

    /// Copies pieces of the sources.
    fn copy(
        &self,
        registry: &Registry,
        sources: &[Box<dyn Dataset>],
        pieces: &[Piece],
        to: Target<'_>,
        report: &mut dyn Report,
    ) -> Result<DatasetCopy, TaskError> {
        let (out, setting) = (to.path, to.setting);
        let is_source = |path: &Path| sources.iter().any(|source| source.path() == path);
        if sources.iter().any(|source| is_same(source.path(), out)) {
            let text = format!("{} is the dataset to read and the one to write", out.display());
            return Err(Message::new(text).fix(Fix::Change(setting)).into());
        }
        create_parent(out)?;
        let rows: usize = pieces.iter().map(|&(source, episode)| sources[source].episode_len(episode)).sum();
        let started = Instant::now();
        let name = out.display().to_string();
        let progress = report.begin(&Stage { name: &name, role: None, unit: "rows", total: rows as u64 })?;
        let cancel = report.cancel();
        let mut watched: Vec<Box<dyn Dataset>> = Vec::with_capacity(sources.len());
        for source in sources {
            watched.push(Box::new(Watched::new(source.share(), cancel.clone())));
        }
        let options = self.options();
        let how = (self.format.as_deref(), &options);
        let copied = apart(report, || {
            copy_in(registry, &mut watched, pieces, out, how, &mut |rows| progress.advance(rows as u64))
        })?;
        drop(progress);
        let copied = copied.map_err(|error| {
            let error = match error {
                DataError::Request { path, reason } if is_source(&path) => {
                    wrong(DataError::Request { path, reason })
                }
                DataError::Mismatch { path, reason } => {
                    let text = format!("{} exists and is another dataset: {reason}", path.display());
                    let replace = Fix::set_to("overwrite", true, "to replace it");
                    Message::new(text).fix(Fix::Any(vec![Fix::Change(setting), replace])).into()
                }
                error => of_data(error),
            };
            ended(error, report)
        })?;
        self.note(&copied, sources, out, report);
        let copy::Copied { resumed, episodes, rows, .. } = copied;
        let wall_time_s = started.elapsed().as_secs_f64();
        Ok(DatasetCopy { out: out.to_owned(), episodes: episodes + resumed, resumed, rows, wall_time_s })
    }

    /// Notes what was there before, and what was assumed.
    fn note(&self, copied: &copy::Copied, sources: &[Box<dyn Dataset>], out: &Path, report: &mut dyn Report) {
        let is_changed = self.quality.is_some() || self.key_frames.is_some() || self.fps.is_some();
        let to = out.display();
        if copied.resumed > 0 && copied.episodes == 0 && is_changed {
            let text = format!("{to} was complete, and keeps the rate and the quality of images that it has");
            report.note(&Message::new(text).fix(Fix::set_to("overwrite", true, "to write it anew")));
        } else if copied.resumed > 0 {
            let plural = if copied.resumed == 1 { "" } else { "s" };
            report.info(&Message::new(format!("{to}: {} episode{plural} there already", copied.resumed)));
        }
        if let (Some(rate), Some(source)) = (copied.assumed_rate, sources.first()) {
            let source = source.path().display();
            let text = format!(
                "{source} does not say how many rows it has per second, and {to} needs a rate: {rate} is assumed"
            );
            let settings = vec![super::Assignment::name("fps"), super::Assignment::of("overwrite", true)];
            let fix = Fix::SetAll { settings, instead_of: None, to: "for another one".to_owned() };
            report.note(&Message::new(text).fix(fix));
        }
    }
}

#[cfg(test)]
mod tests;
