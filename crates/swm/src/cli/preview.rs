//! `swm preview`: images of a dataset's episodes, as a sheet or a video.

use std::path::PathBuf;
use std::sync::LazyLock;

use clap::Args;
use swm_core::{Cancel, Registry};
use swm_tasks::request::{self, Request as _};

use super::args::ImageArg;
use super::opening::OpenArgs;
use super::output::counted;
use super::reporter::Reporter;
use super::threads::ThreadsArg;
use super::{Failure, Output};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<request::Preview> = LazyLock::new(request::Preview::default);

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
    #[arg(long, default_value = DEFAULT.column.as_str())]
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
        let request = request::Preview {
            dataset: self.file,
            episodes: self.episodes,
            column: self.column,
            frames: self.frames,
            image_size: self.image_size.and_then(|size| size.0),
            opening: self.opening.options()?,
            threads: self.threads.count(),
            out: self.out,
        };
        let made = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        output.result(&made, || {
            let (episodes, frames) = (counted(made.episodes.len(), "episode"), counted(made.frames, "frame"));
            let about = if made.fewest == made.frames { "" } else { "up to " };
            format!("wrote {} ({episodes}, {about}{frames} each)", made.out.display())
        })
    }
}
