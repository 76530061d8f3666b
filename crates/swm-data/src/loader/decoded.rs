//! Images that are decoded once: a file of plain bytes per column and size, from which clips are read by position.
//!
//! A file holds a header and the images of all rows, end to end. It is written as `NAME.part` under a writer's lock and renamed when it is
//! whole, so that a kill leaves nothing that is read. The header has a digest of the state of the dataset: its files with their lengths and
//! times, and what it was opened as. A file of another state is made again.

mod state;
#[cfg(test)]
mod tests;

use std::fmt;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use swm_core::evaluate::sha256;
use swm_core::{Dtype, Field, FieldKind, Schema, SliceMut};

use super::images::{Convert, Darkroom};
use super::options::CacheOptions;
use super::plan::Plan;
use super::{lock, wrong};
use crate::cache_folder::cache_folder;
use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;
use crate::files;
use crate::formats::disk::{new_file, open_regular, read_exact_at, write_all_at};
use crate::lock::{WriterLock, beside};
use crate::remote::is_remote;

/// Bytes before the first image.
const HEADER: usize = 4096;
/// Decoded bytes that a thread writes at once.
const PIECE_BYTES: usize = 8 << 20;
/// Between two looks at a file that another process writes.
const PAUSE: Duration = Duration::from_millis(50);

/// A file of decoded images.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CachedImages {
    /// The column.
    pub column: String,
    /// The file.
    pub path: PathBuf,
    /// Images in it.
    pub rows: usize,
    /// Its bytes.
    pub bytes: u64,
    /// How long this loader took to decode and write it; `None`: it was there.
    pub seconds: Option<f64>,
}

impl fmt::Display for CachedImages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { column, path, rows, bytes, seconds } = self;
        let megabytes = *bytes as f64 / 1e6;
        match seconds {
            Some(seconds) => write!(
                f,
                "decoded {rows} images of column `{column}` in {seconds:.1} s to {} ({megabytes:.1} MB); later loaders read this \
                 file, and it can be removed at any time",
                path.display()
            ),
            None => write!(
                f,
                "column `{column}` is read from {} ({rows} images, {megabytes:.1} MB)",
                path.display()
            ),
        }
    }
}

/// A dataset some of whose images are read from files that hold them decoded.
struct Decoded {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
    /// By column.
    files: Arc<[Option<Kept>]>,
    /// By episode, its first row.
    first: Arc<[usize]>,
}

struct Kept {
    path: PathBuf,
    file: File,
}

/// A column that is to be decoded.
struct Target {
    column: usize,
    convert: Convert,
    /// The name of its file.
    name: String,
    header: Vec<u8>,
    /// Bytes of an image.
    dim: usize,
    rows: usize,
}

impl Target {
    fn bytes(&self) -> u64 {
        HEADER as u64 + self.dim as u64 * self.rows as u64
    }

    /// The file of this column in a folder, if it is whole and of the present state of the dataset.
    fn open(&self, folder: &Path) -> Option<Kept> {
        let path = folder.join(&self.name);
        let file = open_regular(&path).ok()?;
        let mut header = vec![0; HEADER];
        let is_whole = file.metadata().ok()?.len() == self.bytes();
        let is_ours = is_whole && read_exact_at(&file, &mut header, 0).is_ok() && header == self.header;
        is_ours.then_some(Kept { path, file })
    }
}

/// The dataset with the images of a plan decoded, and the files that they are in.
pub(super) fn cached(
    dataset: Box<dyn Dataset>,
    plan: &Plan,
    options: &CacheOptions,
    threads: usize,
) -> Result<(Box<dyn Dataset>, Vec<CachedImages>), DataError> {
    let Some(origin) = dataset.origin() else {
        let reason = "its images are in memory, or rendered when they are read, and nothing is decoded; leave it out, or convert the \
                      dataset (`swm convert`) and load the copy";
        return wrong("cache", reason);
    };
    let state = state::state(dataset.info(), &origin)?;
    let targets = targets(dataset.as_ref(), plan, &origin, &state);
    let folders =
        folders(dataset.path(), options, cache_folder(|name| std::env::var(name).ok(), std::env::consts::OS));
    let found: Vec<Option<Kept>> =
        targets.iter().map(|target| folders.iter().find_map(|folder| target.open(folder))).collect();
    let missing: Vec<&Target> =
        targets.iter().zip(&found).filter(|(_, found)| found.is_none()).map(|(target, _)| target).collect();
    let needed: u64 = missing.iter().map(|target| target.bytes()).sum();
    if needed > options.limit {
        let columns: Vec<String> = missing
            .iter()
            .map(|target| {
                let [height, width] = target.convert.wanted;
                let name = &dataset.info().field(target.column).name;
                format!("`{name}`: {} images of {height} x {width}", target.rows)
            })
            .collect();
        let reason = format!(
            "decoded images need {needed} bytes ({}), more than the limit of {}; allow {needed} or more, choose smaller images or \
             fewer columns, or load without the cache",
            columns.join(", "),
            options.limit
        );
        return wrong("cache_limit", reason);
    }
    let mut info = dataset.info().clone();
    let mut fields = info.schema.fields().to_vec();
    let mut files: Vec<Option<Kept>> = fields.iter().map(|_| None).collect();
    let mut reports = Vec::new();
    for (target, found) in targets.iter().zip(found) {
        let column = fields[target.column].name.clone();
        let (kept, seconds) = match found {
            Some(kept) => (kept, None),
            None => make(dataset.as_ref(), target, &folders, &origin, &state, threads)?,
        };
        let (path, rows, bytes) = (kept.path.clone(), target.rows, target.bytes());
        reports.push(CachedImages { column, path, rows, bytes, seconds });
        let [height, width] = target.convert.wanted;
        let field = &mut fields[target.column];
        *field = Field { shape: vec![height, width, target.convert.channels], ..field.clone() };
        files[target.column] = Some(kept);
    }
    info.schema = Schema::new(fields).map_err(|error| DataError::damaged(dataset.path(), error))?;
    let first = starts(&info.lengths).into();
    Ok((Box::new(Decoded { inner: dataset, info, files: files.into(), first }), reports))
}

/// By episode, its first row.
fn starts(lengths: &[usize]) -> Vec<usize> {
    let before = |end: &mut usize, len: &usize| Some(std::mem::replace(end, *end + len));
    lengths.iter().scan(0, before).collect()
}

/// The columns of images that clips read, one per step.
fn targets(dataset: &dyn Dataset, plan: &Plan, origin: &Origin, state: &str) -> Vec<Target> {
    let info = dataset.info();
    let rows = info.lengths.iter().sum();
    let mut targets: Vec<Target> = Vec::new();
    for window in &plan.windows {
        let field = info.field(window.column);
        let &[height, width, channels] = &field.shape[..] else { continue };
        let is_known = targets.iter().any(|target| target.column == window.column);
        if field.dtype != Dtype::U8 || field.kind != FieldKind::Step || field.dim() == 0 || is_known {
            continue;
        }
        let stored = [height, width];
        let wanted = window.convert.map_or(stored, |convert| convert.wanted);
        let convert = Convert { stored, channels, wanted, channels_first: false };
        let [height, width] = wanted;
        let view =
            format!("{} {:?} {wanted:?} {:?} {}", field.name, field.shape, info.opening, origin.choice);
        let plain: String =
            field.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        let name = format!("{plain}-{height}x{width}-{}.frames", &sha256(view.as_bytes())[..12]);
        let dim = height * width * channels;
        let mut header = format!(
            "decoded images, version 1\nview {}\nstate {state}\n{rows} images of {height} x {width} x {channels} bytes\n",
            sha256(view.as_bytes())
        )
        .into_bytes();
        header.resize(HEADER, 0);
        targets.push(Target { column: window.column, convert, name, header, dim, rows });
    }
    targets
}

/// Where files of decoded images may be, the preferred folder first.
fn folders(dataset: &Path, options: &CacheOptions, caches: Option<PathBuf>) -> Vec<PathBuf> {
    if let Some(folder) = &options.folder {
        return vec![folder.clone()];
    }
    let near = (!is_remote(dataset)).then(|| beside(dataset, ".decoded"));
    let absolute = std::path::absolute(dataset).unwrap_or_else(|_| dataset.to_owned());
    let name = dataset.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let digest = sha256(absolute.as_os_str().as_encoded_bytes());
    let far = caches.map(|caches| caches.join("decoded").join(format!("{name}-{}", &digest[..12])));
    near.into_iter().chain(far).collect()
}

/// Makes the file of a column in the first folder that can be written to, or waits for the process that makes it.
fn make(
    dataset: &dyn Dataset,
    target: &Target,
    folders: &[PathBuf],
    origin: &Origin,
    state: &str,
    threads: usize,
) -> Result<(Kept, Option<f64>), DataError> {
    let mut watched = dataset.share();
    let mut failed = None;
    for folder in folders {
        let path = folder.join(&target.name);
        loop {
            let locked = fs::create_dir_all(folder)
                .map_err(|error| DataError::io(folder, "create", error))
                .and_then(|()| WriterLock::take(&path));
            let _lock = match locked {
                Ok(lock) => lock,
                Err(DataError::Busy { .. }) => {
                    // Ends, too, where reading is interrupted.
                    watched.dress(None)?;
                    thread::sleep(PAUSE);
                    continue;
                }
                Err(error) => {
                    failed.get_or_insert(error);
                    break;
                }
            };
            if let Some(kept) = target.open(folder) {
                return Ok((kept, None));
            }
            let began = Instant::now();
            let part = beside(&path, ".part");
            let written = write(dataset, target, &part, threads).and_then(|()| {
                match state::state(dataset.info(), origin)? == *state {
                    true => files::settle(&part, &path).map_err(|error| DataError::io(&path, "write", error)),
                    false => wrong(
                        "cache",
                        "the dataset was changed while its images were decoded; wait until it is written",
                    ),
                }
            });
            if let Err(error) = written {
                // Of a full disk, or of an interruption.
                let _ = fs::remove_file(&part);
                return Err(error);
            }
            let kept = target.open(folder).ok_or_else(|| {
                DataError::io(
                    &path,
                    "read",
                    io::Error::other("it was replaced while it was opened; try again"),
                )
            })?;
            return Ok((kept, Some(began.elapsed().as_secs_f64())));
        }
    }
    let none = || DataError::Loader {
        setting: "cache",
        reason: "no variable names a folder for decoded images; set SWM_HOME".to_owned(),
    };
    Err(failed.unwrap_or_else(none))
}

/// Decodes all images of a column into a new file, and brings it to the disk.
fn write(dataset: &dyn Dataset, target: &Target, path: &Path, threads: usize) -> Result<(), DataError> {
    let failed = |error| DataError::io(path, "write", error);
    let file = new_file(path).map_err(failed)?;
    file.set_len(target.bytes()).and_then(|()| write_all_at(&file, &target.header, 0)).map_err(failed)?;
    let per_piece = (PIECE_BYTES / target.dim).max(1);
    let lengths = dataset.info().lengths.clone();
    let pieces: Vec<(usize, Steps, usize)> = starts(&lengths)
        .into_iter()
        .zip(&*lengths)
        .enumerate()
        .flat_map(|(episode, (begin, &len))| {
            (0..len).step_by(per_piece).map(move |first| {
                let steps = Steps { first, count: per_piece.min(len - first), stride: 1 };
                (episode, steps, begin + first)
            })
        })
        .collect();
    let (next, ended, error) = (AtomicUsize::new(0), AtomicBool::new(false), Mutex::new(None));
    let work = |mut dataset: Box<dyn Dataset>| {
        let (mut images, mut darkroom) = (Vec::new(), Darkroom::default());
        while !ended.load(Ordering::Relaxed) {
            let Some(&(episode, steps, row)) = pieces.get(next.fetch_add(1, Ordering::Relaxed)) else {
                return;
            };
            images.resize(steps.count * target.dim, 0);
            let mut read =
                |out: &mut [u8]| dataset.read_column(target.column, episode, steps, SliceMut::U8(out));
            let decoded = match target.convert.is_needed() {
                true => target.convert.run(&mut darkroom, &mut images, read),
                false => read(&mut images),
            };
            let at = HEADER as u64 + row as u64 * target.dim as u64;
            let written = decoded.and_then(|()| write_all_at(&file, &images, at).map_err(failed));
            if let Err(first) = written {
                ended.store(true, Ordering::Relaxed);
                lock(&error).get_or_insert(first);
            }
        }
    };
    thread::scope(|scope| {
        for _ in 0..threads.min(pieces.len()) {
            let (dataset, work) = (dataset.share(), &work);
            scope.spawn(move || work(dataset));
        }
    });
    let error = lock(&error).take();
    match error {
        Some(error) => Err(error),
        None => file.sync_all().map_err(failed),
    }
}

impl Dataset for Decoded {
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
        let kept = self.files.get(column).and_then(Option::as_ref);
        let (Kept { path, file }, out) = match (kept, out) {
            (Some(kept), SliceMut::U8(out)) => (kept, out),
            (_, out) => return self.inner.rows(column, episode, steps, out),
        };
        let dim = self.info.field(column).dim();
        let rows = if steps.stride == 1 { steps.count } else { 1 };
        for (at, out) in out.chunks_mut((rows * dim).max(1)).enumerate() {
            let row = self.first[episode] + steps.first + at * steps.stride;
            let place = HEADER as u64 + row as u64 * dim as u64;
            read_exact_at(file, out, place).map_err(|error| DataError::io(path, "read", error))?;
        }
        Ok(())
    }

    fn share(&self) -> Box<dyn Dataset> {
        let (info, files, first) = (self.info.clone(), self.files.clone(), self.first.clone());
        Box::new(Self { inner: self.inner.share(), info, files, first })
    }

    crate::adapt::inner::of_inner!(looks, checks);
}
