//! Images of a dataset's episodes: as a sheet, or as a video in which they play side by side.

use std::path::{Path, PathBuf};

use serde::Serialize;
use swm_core::env::PIXELS;
use swm_core::{Dtype, FieldKind, ImageSize, Metadata, Registry, SliceMut};
use swm_data::adapt::Watched;
use swm_data::{Dataset, OpenOptions, RenderOptions, Rendered, Steps};
use swm_media::sheet::contact_sheet_on;
use swm_media::{Clip, Format, framed, png};

use super::copies::{check_exists, ended};
use super::selection::selection;
use super::{
    Assignment, Fix, Message, Report, Request, Stage, TaskError, apart, create_parent, holds_images,
    must_be_given, open_dataset_with, wrong,
};
use crate::threads::{self, within};

/// The column of goal images.
const GOAL: &str = "goal";
/// White space between the tiles, in pixels.
const GAP: usize = 2;
/// What is between frames: no usual background.
const GRAY: [u8; 3] = [128; 3];
/// Size of images that are rendered because the recording holds none.
const RENDERED: ImageSize = ImageSize { height: 128, width: 128 };
/// Episodes that are shown where none are chosen.
const EPISODES: usize = 16;
/// Images per episode, at most.
const MAX_FRAMES: u32 = 10_000;
/// Images per episode of a sheet and of a video, where none are chosen.
const SHEET_FRAMES: usize = 8;
const VIDEO_FRAMES: usize = 300;

swm_core::settings! {
    /// Show episodes of a dataset as a sheet of images or a video.
    pub struct Preview {
        /// The dataset.
        dataset: PathBuf = PathBuf::new() => "must be given",
        /// Episodes to show: `5`, `0..16` or `0,3,7`.
        episodes: Option<String> = None => "the first 16",
        /// The column of images.
        column: String = PIXELS.to_owned() => "pixels",
        /// Images per episode.
        frames: Option<u32> = None => "8 for a sheet, at most 300 for a video",
        /// Render images of this size in place of recorded ones.
        image_size: Option<ImageSize> = None => "128x128 where the recording holds no images",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// The file to write: .png, .mp4 or .gif. One that exists is replaced.
        out: PathBuf = PathBuf::new() => "must be given",
    }
}

/// Images that were written.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct PreviewMade {
    /// Their file.
    pub out: PathBuf,
    /// The episodes that are shown.
    pub episodes: Vec<usize>,
    /// Images of the longest one.
    pub frames: usize,
    /// Images of the shortest one.
    #[serde(skip)]
    pub fewest: usize,
}

impl Request for Preview {
    const NAME: &'static str = "preview";
    type Outcome = PreviewMade;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        let is_missing = |path: &PathBuf| path.as_os_str().is_empty();
        must_be_given(&[("dataset", is_missing(&self.dataset)), ("out", is_missing(&self.out))])?;
        if let Some(frames) = self.frames.filter(|frames| !(1..=MAX_FRAMES).contains(frames)) {
            return Err(Message::about("frames", frames, format!("use 1 to {MAX_FRAMES}")).into());
        }
        threads::check(self.threads)?;
        Format::from_path(&self.out).map_err(wrong)?;
        self.opening.check().map_err(wrong)?;
        check_exists(&self.dataset)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<PreviewMade, TaskError> {
        self.check(registry)?;
        let mut dataset = apart(report, || self.open(registry))??;
        if let Some(size) = self.size(dataset.as_ref(), report)? {
            let options = RenderOptions::default().image(size);
            dataset = Box::new(Rendered::new(dataset, registry, &options).map_err(wrong)?);
        }
        let mut dataset = Watched::new(dataset, report.cancel());
        let format = Format::from_path(&self.out).map_err(wrong)?;
        let shown = Shown::of(&dataset, &self.column, format)?;
        let count = dataset.num_episodes();
        let episodes = match &self.episodes {
            None if count > 0 => (0..count.min(EPISODES)).collect(),
            text => selection(text.as_deref(), count)?,
        };
        let most = match self.frames {
            // Every row of an episode holds the same image.
            _ if shown.is_constant => 1,
            Some(frames) => frames as usize,
            None if format == Format::Png => SHEET_FRAMES,
            None => VIDEO_FRAMES,
        };
        let name = self.dataset.display().to_string();
        let total = episodes.len() as u64;
        let progress = report.begin(&Stage { name: &name, role: None, unit: "episodes", total })?;
        let (mut shots, mut goals) = (Vec::with_capacity(episodes.len()), Vec::new());
        let read = || {
            for &episode in &episodes {
                shots.push(shown.images(&mut dataset, shown.column, episode, most)?);
                if let Some(goal) = shown.goal {
                    let images = shown.images(&mut dataset, goal, episode, 1)?;
                    goals.extend(images.first().map(|image| framed(image, shown.width)));
                }
                progress.done(None);
            }
            Ok::<_, TaskError>(())
        };
        apart(report, || within(self.threads, read))??.map_err(|error| ended(error, report))?;
        drop(progress);
        create_parent(&self.out)?;
        if format == Format::Png {
            shown.sheet(&shots, &goals, &self.out)?;
        } else {
            shown.video(&shots)?.save(&self.out)?;
        }
        let lengths = || shots.iter().map(Vec::len);
        let (fewest, frames) = (lengths().min().unwrap_or(0), lengths().max().unwrap_or(0));
        Ok(PreviewMade { out: self.out.clone(), episodes, frames, fewest })
    }
}

impl Preview {
    fn open(&self, registry: &Registry) -> Result<Box<dyn Dataset>, TaskError> {
        open_dataset_with(registry, &self.dataset, &self.opening)
    }

    /// The size at which images are rendered; `None`: they are recorded.
    fn size(&self, dataset: &dyn Dataset, report: &mut dyn Report) -> Result<Option<ImageSize>, TaskError> {
        let is_missing = dataset.schema().index(&self.column).is_none() && !holds_images(dataset);
        let file = self.dataset.display();
        match self.image_size {
            Some(size) => Ok(Some(size)),
            None if is_missing && dataset.metadata().and_then(Metadata::known_env).is_some() => {
                let ImageSize { height, width } = RENDERED;
                let text = format!("{file} holds no images; they are rendered at {height}x{width}");
                let fix = Fix::Set { setting: Assignment::name("image_size"), to: "for another size" };
                report.note(&Message::new(text).fix(fix));
                Ok(Some(RENDERED))
            }
            None if is_missing => {
                let columns: Vec<&str> =
                    dataset.schema().fields().iter().map(|field| field.name.as_str()).collect();
                Err(wrong(format!(
                    "{file} holds no images, and names no environment that could render them; its columns: {}",
                    columns.join(", ")
                )))
            }
            None => Ok(None),
        }
    }
}

/// The images that are shown, `[H, W, C]` each.
struct Shown {
    column: usize,
    /// The column of goals, of which sheets show one per episode.
    goal: Option<usize>,
    height: usize,
    width: usize,
    channels: usize,
    /// Whether an episode has one image.
    is_constant: bool,
}

impl Shown {
    fn of(dataset: &dyn Dataset, name: &str, format: Format) -> Result<Self, TaskError> {
        let schema = dataset.schema();
        let column = schema.require(name).map_err(wrong)?;
        let field = &schema.fields()[column];
        let (&[height, width, channels @ (1 | 3)], Dtype::U8) = (&field.shape[..], field.dtype) else {
            let text = format!("it holds no images, but {} {:?}", field.dtype, field.shape);
            return Err(Message::about("column", name, text).into());
        };
        let goal = schema.index(GOAL).filter(|&goal| {
            let goal = &schema.fields()[goal];
            format == Format::Png && name == PIXELS && goal.shape == field.shape && goal.dtype == field.dtype
        });
        let is_constant = field.kind == FieldKind::Episode;
        Ok(Self { column, goal, height, width, channels, is_constant })
    }

    /// Up to `count` images of an episode, evenly spread from its first to its last, each `[H, W, 3]`.
    fn images(
        &self,
        dataset: &mut dyn Dataset,
        column: usize,
        episode: usize,
        count: usize,
    ) -> Result<Vec<Vec<u8>>, TaskError> {
        let rows = dataset.episode_len(episode);
        let count = count.min(rows);
        let mut found = Vec::with_capacity(count);
        for at in 0..count {
            let row = if count > 1 { at * (rows - 1) / (count - 1) } else { 0 };
            let mut image = vec![0; self.height * self.width * self.channels];
            let steps = Steps { first: row, count: 1, stride: 1 };
            dataset.read_column(column, episode, steps, SliceMut::U8(&mut image))?;
            let is_gray = self.channels == 1;
            found.push(if is_gray { image.iter().flat_map(|&gray| [gray; 3]).collect() } else { image });
        }
        Ok(found)
    }

    /// A row per episode, its goal first.
    fn sheet(&self, shots: &[Vec<Vec<u8>>], goals: &[Vec<u8>], out: &Path) -> Result<(), TaskError> {
        let mut rows: Vec<Vec<&[u8]>> =
            shots.iter().map(|shots| shots.iter().map(Vec::as_slice).collect()).collect();
        for (row, goal) in rows.iter_mut().zip(goals) {
            row.insert(0, goal);
        }
        let (height, width, pixels) = contact_sheet_on(GRAY, &rows, self.height, self.width, GAP)?;
        Ok(png::write(out, height, width, &pixels)?)
    }

    /// All episodes in a grid, as wide as it is high; the last image of an episode stays.
    fn video(&self, shots: &[Vec<Vec<u8>>]) -> Result<Clip, TaskError> {
        let columns = (1..).find(|n| n * n >= shots.len()).unwrap_or(1);
        let length = shots.iter().map(Vec::len).max().unwrap_or(0);
        let mut clip: Option<Clip> = None;
        for at in 0..length {
            let tiles: Vec<&[u8]> = shots
                .iter()
                .map(|shots| shots.get(at).or(shots.last()).map_or(&[][..], Vec::as_slice))
                .collect();
            let rows: Vec<Vec<&[u8]>> = tiles.chunks(columns).map(<[&[u8]]>::to_vec).collect();
            let (height, width, pixels) = contact_sheet_on(GRAY, &rows, self.height, self.width, GAP)?;
            clip.get_or_insert_with(|| Clip::new(height, width, 10.0)).push(&pixels)?;
        }
        clip.ok_or_else(|| "the episodes have no rows".into())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value as Json, json};
    use swm_core::testing::TOY;

    use super::super::Record;
    use super::*;

    fn registry() -> Registry {
        Registry::new().with(&[TOY]).with(swm_data::FORMATS)
    }

    fn ask(given: &Json, notes: &mut Vec<Message>) -> Result<PreviewMade, TaskError> {
        Preview::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry(), notes))
    }

    fn recorded(out: PathBuf, image_size: Option<ImageSize>) -> PathBuf {
        let (env, episodes) = (TOY.id.to_owned(), Some(3));
        let record =
            Record { env, episodes, max_steps: 4, image_size, out: out.clone(), ..Record::default() };
        record.run(&registry(), &mut ()).unwrap();
        out
    }

    #[test]
    fn a_sheet_and_a_video_show_the_chosen_episodes() {
        let folder = tempfile::tempdir().unwrap();
        let size = ImageSize { height: 16, width: 24 };
        let seen = recorded(folder.path().join("seen.h5"), Some(size));
        let mut notes = Vec::new();
        let sheet = json!({ "dataset": seen, "frames": 2, "out": folder.path().join("new/a.png") });
        let made = ask(&sheet, &mut notes).unwrap();
        assert_eq!((made.episodes, made.frames, made.out.is_file()), (vec![0, 1, 2], 2, true));
        let video = json!({ "dataset": seen, "episodes": "1..", "out": folder.path().join("b.gif") });
        let made = ask(&video, &mut notes).unwrap();
        assert!(made.episodes == [1, 2] && made.out.is_file() && notes.is_empty(), "{notes:?}");

        let blind = recorded(folder.path().join("blind.h5"), None);
        let out = folder.path().join("c.png");
        let made = ask(&json!({ "dataset": blind, "episodes": "0", "out": out }), &mut notes).unwrap();
        assert!(made.episodes == [0] && notes[0].to_string().contains("give image_size for another size"));
        // The height in the head of the file.
        let height = u32::from_be_bytes(std::fs::read(&out).unwrap()[20..24].try_into().unwrap());
        assert!(height as usize >= RENDERED.height, "{height}");
    }

    #[test]
    fn every_refusal_names_the_setting_and_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let seen = recorded(folder.path().join("seen.h5"), Some(ImageSize { height: 16, width: 16 }));
        let out = folder.path().join("a.png");
        let plain = folder.path().join("plain.h5");
        swm_data::testing::record(&plain, swm_data::WriteMode::Error, 0..1).unwrap();
        for (given, text) in [
            (json!({ "out": out }), "dataset: must be given"),
            (json!({ "dataset": seen }), "out: must be given"),
            (json!({ "dataset": seen, "out": folder.path().join("a.bmp") }), "a.bmp"),
            (json!({ "dataset": seen, "out": out, "frames": 0 }), "frames=0: use 1 to 10000"),
            (json!({ "dataset": seen, "out": out, "episodes": "7" }), "there is no episode 7"),
            (json!({ "dataset": seen, "out": out, "column": "action" }), "column=action: it holds no images"),
            (json!({ "dataset": seen, "out": out, "column": "pixel" }), "did you mean `pixels`?"),
        ] {
            match ask(&given, &mut Vec::new()) {
                Err(error @ TaskError::Request(_)) => {
                    assert!(error.to_string().contains(text), "{text}: {error}");
                }
                other => panic!("{given}: {other:?}"),
            }
        }
        assert!(!out.exists());
    }
}
