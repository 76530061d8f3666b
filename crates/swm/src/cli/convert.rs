//! `swm convert`, `swm merge` and `swm split`: copies of datasets, in any format.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::{Value as Json, json};
use swm_core::{ImageSize, Metadata, Registry};
use swm_data::adapt::{Fit, Resized, fill_factors, split_episodes};
use swm_data::format::StoredImages;
use swm_data::tools::alike::check_recordings;
use swm_data::tools::copy::{Copied, Piece, all, copy_in};
use swm_data::tools::part_folder::datasets_in;
use swm_data::tools::parts::{arrange, beside_parts};
use swm_data::{DataError, Dataset, OpenOptions, WriteMode, WriteOptions};

use super::args::ImageArg;
use super::opening::OpenArgs;
use super::output::{counted, create_parent};
use super::threads::ThreadsArg;
use super::{Failure, Output, images, inputs, interrupt, looks, usage};

/// The size of images where a recording without images is copied to a format that is for them.
const RENDERED: ImageSize = ImageSize { height: 64, width: 64 };

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
    /// Quality of images, 1 to 100, in lossy formats (`folder`: default 95; `video`, `lerobot`: 85).
    #[arg(long, value_name = "Q", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Frames between key frames of a video; larger values give smaller files and slower random access. Default: 10.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    key_frames: Option<u32>,
    /// Rows per second that the copy says: in its record, its time stamps, its videos. Default: as many as in the environment's time,
    /// in `lerobot` rounded to a whole number; videos of `video` play 25 frames per second. Needed where sources have different rates, or timestamps of another rate than
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
    /// Render images with this value of a visual factor, `NAME=VALUE`, such as `background.color=black`; may be repeated. The copy has
    /// that factor in its column, and is otherwise the same. Needs a recording of this program.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Replace an existing dataset. Without it, a dataset that holds the first episodes of this copy is continued, and anything else
    /// is refused.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    pub(super) threads: ThreadsArg,
}

impl TargetArgs {
    fn options(&self) -> WriteOptions {
        let mode = if self.overwrite { WriteMode::Overwrite } else { WriteMode::Append };
        let options = WriteOptions::default().mode(mode).frames_per_second(self.fps);
        options.quality(self.quality).key_frame_period(self.key_frames)
    }

    /// Refuses a format that there is not, before anything is opened.
    fn check(&self, registry: &Registry) -> Result<(), Failure> {
        if let Some(format) = &self.format {
            swm_data::format::by_name(registry, format)?;
        }
        Ok(())
    }

    /// Opens a source of a copy to `to`, with the images that the copy shall have.
    fn open(
        &self,
        registry: &Registry,
        source: &Path,
        to: &Path,
        how: &OpenOptions,
        output: &Output,
    ) -> Result<Box<dyn Dataset>, Failure> {
        let dataset = inputs::open_with(registry, source, how)?;
        for (column, reason) in &*dataset.info().skipped {
            output.note(format!("note: the copy has no column `{column}` of {}: {reason}", source.display()));
        }
        let is_of_images = || {
            let extension = to.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
            let format = swm_data::format::by_name(registry, self.format.as_deref().unwrap_or(extension));
            format.is_ok_and(|format| format.images == StoredImages::Video)
        };
        let size = match self.image_size {
            Some(size) => size.0,
            None if images::holds_images(dataset.as_ref()) || !is_of_images() => None,
            None if dataset.metadata().and_then(Metadata::known_env).is_none() => {
                let (source, to) = (source.display(), to.display());
                output.note(format!(
                    "note: {source} holds no images and does not say how it was recorded, so that none can be rendered: {to} \
                     holds none either"
                ));
                None
            }
            None => {
                output.note(images::note(source, RENDERED, images::BY_DEFAULT));
                Some(RENDERED)
            }
        };
        let look = looks::values(dataset.as_ref(), registry, ("--set", &self.set), output)?;
        let size = match (size, self.set.first()) {
            (None, Some(set)) => match images::size(dataset.as_ref()) {
                Some(size) => Some(size),
                None => {
                    let reason = "the copy would have no images, and factors that change more than images cannot be set in a copy";
                    return Err(usage(format!("--set {set}: {reason}; give --image-size 64x64")));
                }
            },
            (size, _) => size,
        };
        match size {
            Some(_) if self.fit.is_some() && !look.is_empty() => Err(usage(
                "--set renders images anew, and --fit resizes those that are there; leave one of them out",
            )),
            Some(size) if !look.is_empty() => images::rendered(dataset, registry, size, look),
            Some(size) if self.resizes(dataset.as_ref()) => {
                Ok(Box::new(Resized::new(dataset, size, self.fit)?))
            }
            Some(size) => images::rendered(dataset, registry, size, look),
            None if self.fit.is_some() => {
                Err(usage("--fit: no image is resized; give --image-size 64x64, or leave it out"))
            }
            None => Ok(dataset),
        }
    }

    /// Whether images are resized, and not rendered anew.
    fn resizes(&self, dataset: &dyn Dataset) -> bool {
        let is_own = dataset.metadata().is_some_and(|run| run.known_env().is_some() && run.source.is_none());
        self.fit.is_some() || !is_own && images::holds_images(dataset)
    }

    /// Copies, with a bar.
    fn copy(
        &self,
        registry: &Registry,
        sources: &mut [Box<dyn Dataset>],
        pieces: &[Piece],
        to: &Path,
        output: &Output,
    ) -> Result<Json, Failure> {
        inputs::check_target(sources, to)?;
        create_parent(to)?;
        let rows: usize = pieces.iter().map(|&(source, episode)| sources[source].episode_len(episode)).sum();
        let started = Instant::now();
        let bar = output.bar(rows as u64, "rows");
        bar.set_message(to.display().to_string());
        let mut watch = |rows: usize| bar.inc(rows as u64);
        let out = to.display().to_string();
        // Copied episodes survive a kill, so nothing has to be ended by hand.
        let is_continued = if self.overwrite { " without --overwrite" } else { "" };
        let how = format!("{}{is_continued}", interrupt::REPEAT);
        interrupt::watch_resumable(move || format!("copied episodes are safe in {out}"), how);
        let how = (self.format.as_deref(), &self.options());
        let copied = copy_in(registry, sources, pieces, to, how, &mut watch);
        bar.finish_and_clear();
        let is_source = |path: &Path| sources.iter().any(|source| source.path() == path);
        let Copied { resumed, episodes, rows, assumed_rate, .. } = copied.map_err(|error| match error {
            DataError::Request { path, reason } if is_source(&path) => {
                usage(DataError::Request { path, reason })
            }
            DataError::Mismatch { path, reason } => usage(format!(
                "{} exists and is another dataset: {reason}; write to another place, or replace it by --overwrite",
                path.display()
            )),
            error => error.into(),
        })?;
        let is_changed = self.quality.is_some() || self.key_frames.is_some() || self.fps.is_some();
        if resumed > 0 && episodes == 0 && is_changed {
            output.note(format!(
                "note: {} was complete, and keeps the rate and the quality of images that it has; --overwrite writes it anew",
                to.display()
            ));
        } else if resumed > 0 {
            output.note(format!("{}: {} there already", to.display(), counted(resumed, "episode")));
        }
        if let Some(rate) = assumed_rate {
            let (source, to) = (sources[0].path().display(), to.display());
            output.note(format!(
                "note: {source} does not say how many rows it has per second, and {to} needs a rate: {rate} is assumed; --fps RATE \
                 --overwrite gives the right one"
            ));
        }
        let seconds = started.elapsed().as_secs_f64();
        Ok(json!({
            "out": to,
            "episodes": episodes + resumed,
            "resumed": resumed,
            "rows": rows,
            "rows_per_second": rows as f64 / seconds,
            "wall_time_s": seconds,
        }))
    }
}

/// One line for people.
fn line(result: &Json) -> String {
    let number = |key: &str| result[key].as_f64().unwrap_or_default();
    let out = result["out"].as_str().unwrap_or_default();
    if result["rows"] == 0 {
        return format!("{out} holds all {}; nothing to copy", counted(number("episodes"), "episode"));
    }
    format!(
        "wrote {out} ({}, {} copied, {:.0} rows/s)",
        counted(number("episodes"), "episode"),
        counted(number("rows"), "row"),
        number("rows_per_second"),
    )
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
    pub(super) to: TargetArgs,
}

impl Convert {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        self.to.check(registry)?;
        let how = self.opening.options()?;
        let mut sources = vec![self.to.open(registry, &self.source, &self.target, &how, output)?];
        let pieces = all(&sources);
        inputs::check_rate(&mut sources, &pieces, self.to.fps, output)?;
        let result = self.to.copy(registry, &mut sources, &pieces, &self.target, output)?;
        output.result(&result, || line(&result))
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
    pub(super) to: TargetArgs,
}

impl Merge {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        self.to.check(registry)?;
        let mut paths = Vec::with_capacity(self.sources.len());
        for source in &self.sources {
            inputs::check_exists(source)?;
            let parts = datasets_in(registry, source)?;
            paths.extend(if parts.is_empty() { vec![source.clone()] } else { parts });
        }
        if paths == self.sources && paths.len() == 1 {
            return Err(usage("one dataset was given; name two or more, or a folder of parts"));
        }
        inputs::check_distinct(&paths)?;
        let how = self.opening.options()?;
        let mut sources = Vec::with_capacity(paths.len());
        for source in &paths {
            sources.push(self.to.open(registry, source, &self.out, &how, output)?);
        }
        check_recordings(&sources, &all(&sources)).map_err(usage)?;
        images::check_alike(&sources, &self.command())?;
        for other in beside_parts(&sources) {
            output.note(format!(
                "note: {} is no part of the recording that the other datasets are parts of; it is joined at its place in the list",
                other.display()
            ));
        }
        let sources = if self.partial { sources } else { arrange(sources).map_err(usage)? };
        let mut sources = fill_factors(sources, registry)?;
        let pieces = all(&sources);
        inputs::check_rate(&mut sources, &pieces, self.to.fps, output)?;
        let result = self.to.copy(registry, &mut sources, &pieces, &self.out, output)?;
        output.result(&result, || line(&result))
    }
}

impl Merge {
    /// The command that was called, as far as it says what is joined.
    fn command(&self) -> String {
        let sources: Vec<String> = self.sources.iter().map(|source| source.display().to_string()).collect();
        format!("swm merge {} --out {}", sources.join(" "), self.out.display())
    }
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
    #[arg(long, value_name = "NAME=FRACTION", value_delimiter = ',', default_value = "train=0.9,val=0.1")]
    parts: Vec<String>,
    /// Seed of the division.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The files or folders to write, with `{}` for the name of the part.
    #[arg(long, short)]
    out: String,
    #[command(flatten)]
    opening: OpenArgs,
    #[command(flatten)]
    pub(super) to: TargetArgs,
}

impl Split {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Unit::Episode = self.by;
        self.to.check(registry)?;
        let (names, fractions) = parts(&self.parts)?;
        if !self.out.contains("{}") {
            return Err(usage(format!(
                "--out {}: write `{{}}` where the name of the part shall stand",
                self.out
            )));
        }
        let how = self.opening.options()?;
        let mut sources = vec![self.to.open(registry, &self.source, Path::new(&self.out), &how, output)?];
        let divided = split_episodes(sources[0].num_episodes(), &fractions, self.seed)
            .map_err(|error| usage(format!("--parts {}: {error}", self.parts.join(","))))?;
        let sum: f64 = fractions.iter().sum();
        if (sum - 1.0).abs() > 1e-9 {
            let shares = names
                .iter()
                .zip(&fractions)
                .map(|(name, part)| format!("{name} {:.1} %", 100.0 * part / sum));
            output.note(format!(
                "note: --parts sum to {sum}; the parts are {}",
                shares.collect::<Vec<_>>().join(", ")
            ));
        }
        if let Some((name, _)) = names.iter().zip(&divided).find(|(_, episodes)| episodes.is_empty()) {
            let count = sources[0].num_episodes();
            return Err(usage(format!("--parts: `{name}` would get none of the {count} episodes")));
        }
        let pieces = all(&sources);
        inputs::check_rate(&mut sources, &pieces, self.to.fps, output)?;
        let mut results = Vec::new();
        for (name, episodes) in names.iter().zip(divided) {
            let to = PathBuf::from(self.out.replace("{}", name));
            let pieces: Vec<Piece> = episodes.into_iter().map(|episode| (0, episode)).collect();
            results.push(self.to.copy(registry, &mut sources, &pieces, &to, output)?);
        }
        output.result(&results, || results.iter().map(line).collect::<Vec<_>>().join("\n"))
    }
}

/// `train=0.9` … as names and fractions.
fn parts(texts: &[String]) -> Result<(Vec<String>, Vec<f64>), Failure> {
    let (mut names, mut fractions) = (Vec::new(), Vec::new());
    for text in texts {
        let wrong = |why: &str| usage(format!("--parts {text}: {why}"));
        let (name, fraction) = text.split_once('=').ok_or_else(|| wrong("write NAME=FRACTION"))?;
        let fraction: f64 = fraction.trim().parse().map_err(|_| wrong("the fraction is no number"))?;
        let name = name.trim();
        if name.is_empty() || name.contains(['/', '\\']) || names.iter().any(|there| there == name) {
            return Err(wrong("each part needs a name of its own, without slashes"));
        }
        names.push(name.to_owned());
        fractions.push(fraction);
    }
    Ok((names, fractions))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_have_names_and_fractions() {
        let read = |texts: &[&str]| parts(&texts.iter().map(|&text| text.to_owned()).collect::<Vec<_>>());
        let (names, fractions) = read(&["train=0.9", " val = .1"]).unwrap();
        assert_eq!((names, fractions), (vec!["train".to_owned(), "val".to_owned()], vec![0.9, 0.1]));
        for wrong in [&["train"][..], &["a=x"], &["a=1", "a=2"], &["../a=1"]] {
            assert!(read(wrong).is_err(), "{wrong:?}");
        }
    }
}
