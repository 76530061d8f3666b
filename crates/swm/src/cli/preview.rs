//! `swm preview`: images of a dataset's episodes, as a sheet or a video.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use swm_core::env::PIXELS;
use swm_core::{Dtype, FieldKind, ImageSize, Metadata, Registry, SliceMut};
use swm_data::{Dataset, RenderOptions, Rendered, Steps};
use swm_media::{Clip, Format, contact_sheet, framed, png};
use swm_tasks::request::{create_parent, holds_images, open_dataset_with};

use super::args::ImageArg;
use super::opening::OpenArgs;
use super::output::counted;
use super::replay::selection;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};

/// The column of goal images.
const GOAL: &str = "goal";
/// White space between the tiles, in pixels.
const GAP: usize = 2;
/// Size of images that are rendered because the recording holds none.
const RENDERED: ImageSize = ImageSize { height: 128, width: 128 };

/// Show episodes of a dataset as a sheet of images or a video.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm preview pusht.h5 --episodes 0..16 --out grid.mp4     (16 episodes side by side, playing)
  swm preview pusht.h5 --episodes 0..8 --frames 12 --out sheet.png
  swm preview pusht.h5 --column goal --out goals.png

A sheet (.png) has one row per episode: the goal in an orange frame, where the dataset holds its image, then --frames images \
from the first to the last. A video (.mp4, .gif) plays the \
episodes in a grid; those that end early show their last frame. A column that holds one image per episode, such as `goal`, \
is shown once. Images of a recording without images are rendered by \
replaying the episodes.")]
pub(super) struct Preview {
    /// The dataset.
    file: PathBuf,
    /// Episodes to show: `5`, `0..16` or `0,3,7`. Default: the first 16.
    #[arg(long)]
    episodes: Option<String>,
    /// The column of images.
    #[arg(long, default_value = PIXELS)]
    column: String,
    /// Images per episode. Default: 8 for a sheet, at most 300 for a video.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Render images of this size, HEIGHTxWIDTH, in place of recorded ones. Default: 128x128 where the recording holds no images.
    #[arg(long)]
    image_size: Option<ImageArg>,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    threads: ThreadsArg,
    /// The file to write: .png, .mp4 or .gif. One that exists is replaced.
    #[arg(long, short)]
    out: PathBuf,
}

impl Preview {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let format = Format::from_path(&self.out).map_err(usage)?;
        let mut dataset = open_dataset_with(registry, &self.file, &self.opening.options()?)?;
        let missing = dataset.schema().index(&self.column).is_none() && !holds_images(dataset.as_ref());
        let size = match self.image_size {
            Some(size) => size.0,
            None if missing && dataset.metadata().and_then(Metadata::known_env).is_some() => {
                let (file, ImageSize { height, width }) = (self.file.display(), RENDERED);
                output.note(format!(
                    "note: {file} holds no images; they are rendered at {height}x{width} (--image-size changes that)"
                ));
                Some(RENDERED)
            }
            None => None,
        };
        if let Some(size) = size {
            let options = RenderOptions::default().image(size);
            dataset = Box::new(Rendered::new(dataset, registry, &options).map_err(usage)?);
        }
        if size.is_none() && missing {
            return Err(usage(format!(
                "{} holds no images, and does not say how they could be rendered; `swm inspect` lists its columns",
                self.file.display()
            )));
        }
        let column = dataset.schema().require(&self.column).map_err(usage)?;
        let field = dataset.schema().fields()[column].clone();
        let (&[height, width, channels @ (1 | 3)], Dtype::U8) = (&field.shape[..], field.dtype) else {
            let (name, shape) = (&self.column, &field.shape);
            return Err(usage(format!("column `{name}` holds no images, but {} {shape:?}", field.dtype)));
        };
        let count = dataset.num_episodes();
        let episodes = match &self.episodes {
            None => (0..count.min(16)).collect(),
            text => selection(text.as_deref(), count)?,
        };
        if episodes.is_empty() {
            return Err(format!("{} holds no episode", self.file.display()).into());
        }
        let per_episode = match self.frames {
            // Every row of an episode holds the same image.
            _ if field.kind == FieldKind::Episode => 1,
            Some(frames) => frames as usize,
            None if format == Format::Png => 8,
            None => 300,
        };
        let bar = output.bar(episodes.len() as u64, "episodes");
        let goal = dataset.schema().index(GOAL).filter(|&goal| {
            let goal = &dataset.schema().fields()[goal];
            format == Format::Png
                && self.column == PIXELS
                && goal.shape == field.shape
                && goal.dtype == field.dtype
        });
        let mut shots = Vec::with_capacity(episodes.len());
        let mut goals = Vec::new();
        for &episode in &episodes {
            let shape = [height, width, channels];
            shots.push(episode_images(dataset.as_mut(), column, episode, per_episode, shape)?);
            if let Some(goal) = goal {
                let images = episode_images(dataset.as_mut(), goal, episode, 1, shape)?;
                goals.extend(images.first().map(|image| framed(image, width)));
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        create_parent(&self.out)?;
        if format == Format::Png {
            let mut rows: Vec<Vec<&[u8]>> =
                shots.iter().map(|shots| shots.iter().map(Vec::as_slice).collect()).collect();
            for (row, goal) in rows.iter_mut().zip(&goals) {
                row.insert(0, goal);
            }
            let (height, width, pixels) = contact_sheet(&rows, height, width, GAP)?;
            png::write(&self.out, height, width, &pixels)?;
        } else {
            video(&shots, height, width)?.save(&self.out)?;
        }
        let lengths = shots.iter().map(Vec::len);
        let (fewest, most) = (lengths.clone().min().unwrap_or(0), lengths.max().unwrap_or(0));
        let result = json!({"out": self.out, "episodes": episodes, "frames": most});
        output.result(&result, || {
            let (episodes, frames) = (counted(episodes.len(), "episode"), counted(most, "frame"));
            let about = if fewest == most { "" } else { "up to " };
            format!("wrote {} ({episodes}, {about}{frames} each)", self.out.display())
        })
    }
}

/// Up to `count` images of an episode, evenly spread from its first to its last, each `[H, W, 3]`.
fn episode_images(
    dataset: &mut dyn Dataset,
    column: usize,
    episode: usize,
    count: usize,
    [height, width, channels]: [usize; 3],
) -> Result<Vec<Vec<u8>>, Failure> {
    let rows = dataset.episode_len(episode);
    let count = count.min(rows);
    let mut found = Vec::with_capacity(count);
    for at in 0..count {
        let row = if count > 1 { at * (rows - 1) / (count - 1) } else { 0 };
        let mut image = vec![0; height * width * channels];
        let steps = Steps { first: row, count: 1, stride: 1 };
        dataset.read_column(column, episode, steps, SliceMut::U8(&mut image))?;
        found.push(if channels == 1 { image.iter().flat_map(|&gray| [gray; 3]).collect() } else { image });
    }
    Ok(found)
}

/// All episodes in a grid, as wide as it is high; the last image of an episode stays.
fn video(shots: &[Vec<Vec<u8>>], height: usize, width: usize) -> Result<Clip, Failure> {
    let columns = (1..).find(|n| n * n >= shots.len()).unwrap_or(1);
    let length = shots.iter().map(Vec::len).max().unwrap_or(0);
    let mut clip: Option<Clip> = None;
    for at in 0..length {
        let tiles: Vec<&[u8]> =
            shots.iter().map(|shots| shots.get(at).or(shots.last()).map_or(&[][..], Vec::as_slice)).collect();
        let rows: Vec<Vec<&[u8]>> = tiles.chunks(columns).map(<[&[u8]]>::to_vec).collect();
        let (height, width, pixels) = contact_sheet(&rows, height, width, GAP)?;
        clip.get_or_insert_with(|| Clip::new(height, width, 10.0)).push(&pixels)?;
    }
    clip.ok_or_else(|| "the episodes have no rows".into())
}
