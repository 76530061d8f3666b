//! `swm convert`, `swm merge` and `swm split`: copies of datasets, in any format.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value as Json, json};
use swm_core::Registry;
use swm_data::LastRow;
use swm_data::adapt::Fit;
use swm_tasks::request::{self, CopyOptions, DatasetCopy, ImageChoice, Parts, Request as _};

use super::args::ImageArg;
use super::opening::OpenArgs;
use super::output::counted;
use super::reporter::Reporter;
use super::scenario::set;
use super::threads::ThreadsArg;
use super::{Failure, Output, interrupt};

/// A number of rows per second.
fn rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate: &f64| rate.is_finite() && *rate > 0.0 && *rate <= 1e6);
    rate.ok_or_else(|| "a rate is a number above 0 and at most 1e6, as 25".to_owned())
}

/// How a copy is written.
#[derive(Args, Clone)]
pub(super) struct TargetArgs {
    /// The format; default: by the file extension (`swm convert --help` lists them).
    #[arg(long)]
    format: Option<String>,
    /// Quality of images, 1 to 100, in lossy formats. Default: 95 in `folder`, 85 in `video` and `lerobot`.
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Frames between key frames of a video; larger values give smaller files and slower random access. Default: 10.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    key_frames: Option<u32>,
    /// Rows per second that the copy says: in its record, its time stamps, its videos. Default: as many as in the environment's time,
    /// in `lerobot` rounded to a whole number. Videos of `video` play 25 frames per second. Needed where sources have different rates, or timestamps of another rate than
    /// their dataset says.
    #[arg(long, value_name = "RATE", value_parser = rate)]
    fps: Option<f64>,
    /// Images of this size, HEIGHTxWIDTH: those of datasets of other programs, and with --fit all, are resized; those of recordings of
    /// this program are rendered by replaying the episodes, in place of recorded ones. `none`: as they are.
    /// Default: 64x64 where a recording without images is copied to `video` or `lerobot`, else none.
    #[arg(long)]
    image_size: Option<ImageArg>,
    /// Resize images, by area: `stretch` them, `crop` their middle, or `pad` them with black. Needed where --image-size has another
    /// shape than theirs.
    #[arg(long, value_name = "HOW", requires = "image_size")]
    fit: Option<Fit>,
    /// What becomes of the last row of an episode, which has no action, in `lerobot`: `drop` it from the tables that LeRobot reads (it is
    /// beside them, and read back here), or `keep` it there. Default: drop.
    #[arg(long, value_name = "HOW")]
    last_row: Option<LastRow>,
    /// Render images with this value of a visual factor, `NAME=VALUE`, such as `background.color=black`; may be repeated. The copy has
    /// that factor in its column, and is otherwise the same. Needs a recording of this program.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Replace an existing dataset. Without it, a dataset that holds the first episodes of this copy is continued, and anything else
    /// is refused.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl TargetArgs {
    fn options(&self, output: &Output) -> Result<CopyOptions, Failure> {
        Ok(CopyOptions {
            format: self.format.clone(),
            quality: self.quality,
            key_frames: self.key_frames,
            fps: self.fps,
            image_size: self.image_size.map(|size| ImageChoice(size.0)),
            fit: self.fit,
            set: set(&self.set, output)?,
            last_row: self.last_row,
            overwrite: self.overwrite,
        })
    }

    fn report<'a>(&self, output: &'a Output) -> Reporter<'a> {
        report(output, if self.overwrite { " without --overwrite" } else { "" })
    }
}

/// The reports of copies: a bar for each, and what is safe when it is interrupted. Copied episodes survive a kill, so nothing has to be
/// ended by hand. `changed`: in what the command that continues it differs.
fn report<'a>(output: &'a Output, changed: &'static str) -> Reporter<'a> {
    Reporter::of_stages(output, move |out| {
        let safe = format!("copied episodes are safe in {out}");
        interrupt::watch_resumable(move || safe.clone(), format!("{}{changed}", interrupt::REPEAT))
    })
}

/// A copy as JSON.
fn result(copy: &DatasetCopy) -> Json {
    let DatasetCopy { out, episodes, resumed, rows, wall_time_s, .. } = copy;
    json!({
        "out": out,
        "episodes": episodes,
        "resumed": resumed,
        "rows": rows,
        "rows_per_second": *rows as f64 / wall_time_s,
        "wall_time_s": wall_time_s,
    })
}

/// One line for people.
fn line(copy: &DatasetCopy) -> String {
    let (out, episodes) = (copy.out.display(), counted(copy.episodes, "episode"));
    if copy.rows == 0 {
        return format!("{out} holds all {episodes}; nothing to copy");
    }
    let rate = copy.rows as f64 / copy.wall_time_s;
    format!("wrote {out} ({episodes}, {} copied, {rate:.0} rows/s)", counted(copy.rows, "row"))
}

/// Copy a dataset into another format.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm convert pusht.h5 pusht.video                 (H.264 videos: smaller, lossy)
  swm convert pusht.h5 pusht.video --quality 95 --key-frames 30
  swm convert from_the_reference.h5 pusht.folder
  swm convert small.h5 pusht.video --image-size 96x96    (images of a recording without images are rendered)
  swm convert small.h5 dark.h5 --image-size 64x64 --set background.color=black    (the same states in another look)
  swm convert robomimic.hdf5 small.h5 --camera agentview --image-size 64x64 --fit crop
  swm convert pusht.video again.h5 --overwrite

The source's format is detected by its content, the target's by its extension or --format:
  hdf5    .h5, .hdf5   one file, exact, fast at random; the format to train from
  folder  .folder      numpy arrays and JPEG images
  video   .video       numpy arrays and H.264 videos
  mcap    .mcap        one log file that opens in Foxglove, exact
  lerobot .lerobot     Parquet tables and H.264 videos that LeRobot opens (where it is built in)

Episodes are copied in pieces, so memory use does not depend on their length. After an interruption, the same command continues.")]
pub(super) struct Convert {
    /// The dataset to copy.
    source: PathBuf,
    /// The file or folder to write.
    target: PathBuf,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    to: TargetArgs,
}

impl Convert {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = request::Convert {
            opening: self.opening.options()?,
            to: self.to.options(output)?,
            source: self.source,
            target: self.target,
        };
        let copy = request.run(registry, &mut self.to.report(output))?;
        output.result(&result(&copy), || line(&copy))
    }
}

/// Join datasets with the same columns into one.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm merge monday.h5 tuesday.h5 --out week.h5
  swm merge expert.h5 weak.video --out both.h5
  swm merge part.*.h5 --out whole.h5    (parts of `swm collect --shard`; or the folder that holds them)

Episodes come in the order of the sources, those of parts in the order of the parts. A missing, repeated or incomplete part, or one \
of another recording, is refused. The sources may be of different formats, but must have the same columns, and \
be recordings of the same environment under the same settings. A factor of variation that only some of them varied is filled in \
for the others, with its constant value. After an interruption, the same command continues.")]
pub(super) struct Merge {
    /// The datasets to join: two or more, or a folder of parts.
    #[arg(required = true)]
    sources: Vec<PathBuf>,
    /// The file or folder to write.
    #[arg(long, short)]
    out: PathBuf,
    /// Join parts of divided recordings as they are: in the given order, whether or not others are missing.
    #[arg(long)]
    partial: bool,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    to: TargetArgs,
}

impl Merge {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = request::Merge {
            opening: self.opening.options()?,
            to: self.to.options(output)?,
            sources: self.sources,
            out: self.out,
            partial: self.partial,
        };
        let copy = request.run(registry, &mut self.to.report(output))?;
        output.result(&result(&copy), || line(&copy))
    }
}

/// Joins the parts of a recording that was divided, or copies the only one.
pub(super) fn join(
    sources: Vec<PathBuf>,
    out: PathBuf,
    registry: &Registry,
    output: &Output,
) -> Result<(), Failure> {
    let report = &mut report(output, "");
    let copy = match <[PathBuf; 1]>::try_from(sources) {
        Ok([source]) => {
            request::Convert { source, target: out, ..request::Convert::default() }.run(registry, report)?
        }
        Err(sources) => request::Merge { sources, out, ..request::Merge::default() }.run(registry, report)?,
    };
    output.result(&result(&copy), || line(&copy))
}

/// What is kept together.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Unit {
    /// All rows of an episode.
    Episode,
}

/// Divide a dataset at random into parts: training, validation.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm split pusht.h5 --by episode --parts train=0.9,val=0.1 --out 'pusht_{}.h5'
  swm split pusht.h5 --parts train=8,val=1,test=1 --seed 7 --out '{}.video'
  swm split small.h5 --image-size 64x64 --out 'images_{}.h5'   (renders a recording without images)

`{}` in --out becomes the part's name. Fractions need not sum to 1. Parts are made of whole episodes: clips of one episode \
overlap, so a split by clip would show the training data to the test. The parts depend on --seed and the number of \
episodes alone, and are those of the loader's `split_episodes`.")]
pub(super) struct Split {
    /// The dataset to divide.
    source: PathBuf,
    /// What is kept together.
    #[arg(long, value_enum, default_value = "episode")]
    by: Unit,
    /// Names and fractions of the parts.
    #[arg(long, value_name = "NAME=FRACTION,…", default_value_t = Parts::default())]
    parts: Parts,
    /// Seed of the division.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The files or folders to write, with `{}` for the name of the part.
    #[arg(long, short)]
    out: String,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    to: TargetArgs,
}

impl Split {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Unit::Episode = self.by;
        let request = request::Split {
            opening: self.opening.options()?,
            to: self.to.options(output)?,
            source: self.source,
            parts: self.parts,
            seed: self.seed,
            out: self.out,
        };
        let copies = request.run(registry, &mut self.to.report(output))?;
        let results: Vec<Json> = copies.iter().map(result).collect();
        output.result(&results, || copies.iter().map(line).collect::<Vec<_>>().join("\n"))
    }
}
