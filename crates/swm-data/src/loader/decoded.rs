//! Images that are decoded once: a file of plain bytes per column and size, from which clips are read by position.
//!
//! A file holds a header and the images of all rows, end to end. It is written as `NAME.part` under a writer's lock and renamed when it is
//! whole, so that a kill leaves nothing that is read. Its name has a digest of the view (the column, its size, the [`Origin`]), its header
//! one of the state of the dataset: its files with their lengths and times, and its runs. A file of another state is made again.

mod state;
#[cfg(test)]
mod tests;

use std::fmt;
use std::fs::{self, File};
use std::ops::Range;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use swm_core::evaluate::sha256;
use swm_core::{Dtype, FieldKind, Schema, SliceMut};
use swm_files::remote::is_remote;
use swm_files::{WriterLock, beside, cache_folder, new_file, open_regular, read_exact_at, write_all_at};

use super::images::{Convert, Darkroom};
use super::options::CacheOptions;
use super::plan::Plan;
use super::wrong;
use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;

/// Bytes before the first image.
const HEADER: usize = 4096;
/// Bytes of images that a thread decodes at once.
const PIECE_BYTES: usize = 8 << 20;
/// Rows of an episode that a thread decodes one after the other, since videos are decoded from a key frame on.
const RUN: usize = 512;
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

    /// Images that a thread decodes at once.
    fn per_piece(&self) -> usize {
        let Convert { stored: [height, width], channels, .. } = self.convert;
        (PIECE_BYTES / self.dim.max(height * width * channels)).max(1)
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

/// A dataset, and where the files of its images may be.
struct Source<'a> {
    dataset: &'a dyn Dataset,
    origin: Origin,
    state: String,
    /// The preferred one first.
    folders: Vec<PathBuf>,
    threads: usize,
}

/// The dataset with the images of a plan decoded, and the files that they are in.
pub(super) fn cached(
    dataset: Box<dyn Dataset>,
    plan: &Plan,
    options: &CacheOptions,
    threads: usize,
) -> Result<(Box<dyn Dataset>, Vec<CachedImages>), DataError> {
    let images = images(dataset.info(), plan);
    if images.is_empty() {
        return Ok((dataset, Vec::new()));
    }
    let Some(origin) = dataset.origin() else {
        let reason = "its images are not those of files: they are in memory, or rendered when they are read; leave it out, or convert \
                      the dataset (`swm convert`) and load the copy";
        return wrong("cache", reason);
    };
    let state = state::state(dataset.info(), &origin)?;
    let caches = cache_folder(|name| std::env::var(name).ok(), std::env::consts::OS);
    let folders = folders(dataset.path(), options, caches);
    let source = Source { dataset: dataset.as_ref(), origin, state, folders, threads };
    let targets: Vec<Target> =
        images.into_iter().map(|(column, convert)| source.target(column, convert)).collect();
    let found: Vec<Option<Kept>> = targets.iter().map(|target| source.find(target)).collect();
    check_limit(dataset.info(), targets.iter().zip(&found), options.limit)?;
    let mut info = dataset.info().clone();
    let mut fields = info.schema.fields().to_vec();
    let mut files: Vec<Option<Kept>> = fields.iter().map(|_| None).collect();
    let mut reports = Vec::new();
    for (target, found) in targets.iter().zip(found) {
        let (kept, seconds) = match found {
            Some(kept) => (kept, None),
            None => source.make(target)?,
        };
        let field = &mut fields[target.column];
        field.shape = target.convert.shape();
        let (column, path, rows, bytes) =
            (field.name.clone(), kept.path.clone(), target.rows, target.bytes());
        reports.push(CachedImages { column, path, rows, bytes, seconds });
        files[target.column] = Some(kept);
    }
    info.schema = Schema::new(fields).map_err(|error| DataError::damaged(dataset.path(), error))?;
    let first = starts(&info.lengths).into();
    Ok((Box::new(Decoded { inner: dataset, info, files: files.into(), first }), reports))
}

/// The columns of images that clips read, one per step, with the size that they get.
fn images(info: &DatasetInfo, plan: &Plan) -> Vec<(usize, Convert)> {
    let mut images: Vec<(usize, Convert)> = Vec::new();
    for window in &plan.windows {
        let field = info.field(window.column);
        let &[height, width, channels] = &field.shape[..] else { continue };
        let is_known = images.iter().any(|(column, _)| *column == window.column);
        if field.dtype == Dtype::U8 && field.kind == FieldKind::Step && field.dim() > 0 && !is_known {
            let stored = [height, width];
            let wanted = window.convert.map_or(stored, |convert| convert.wanted);
            images.push((window.column, Convert { stored, channels, wanted, channels_first: false }));
        }
    }
    images
}

/// Refuses to write more than the limit.
fn check_limit<'a>(
    info: &DatasetInfo,
    targets: impl Iterator<Item = (&'a Target, &'a Option<Kept>)>,
    limit: u64,
) -> Result<(), DataError> {
    let missing: Vec<&Target> =
        targets.filter_map(|(target, found)| found.is_none().then_some(target)).collect();
    let needed: u64 = missing.iter().map(|target| target.bytes()).sum();
    if needed <= limit {
        return Ok(());
    }
    let describe = |target: &&Target| {
        let ([height, width], name) = (target.convert.wanted, &info.field(target.column).name);
        format!("`{name}`: {} images of {height} x {width}", target.rows)
    };
    let columns = missing.iter().map(describe).collect::<Vec<_>>().join(", ");
    let reason = format!(
        "decoded images need {needed} bytes ({columns}), more than the limit of {limit}; allow {needed} or more, choose smaller \
         images or fewer columns, or load without the cache"
    );
    wrong("cache_limit", reason)
}

/// By episode, its first row.
fn starts(lengths: &[usize]) -> Vec<usize> {
    let before = |end: &mut usize, len: &usize| Some(std::mem::replace(end, *end + len));
    lengths.iter().scan(0, before).collect()
}

/// A path or address that does not depend on the working folder.
fn absolute(path: &Path) -> PathBuf {
    let local = (!is_remote(path)).then(|| std::path::absolute(path).ok()).flatten();
    local.unwrap_or_else(|| path.to_owned())
}

/// Where files of decoded images may be, the preferred folder first.
fn folders(dataset: &Path, options: &CacheOptions, caches: Option<PathBuf>) -> Vec<PathBuf> {
    let name = dataset.file_name().unwrap_or_default().to_string_lossy();
    let digest = sha256(absolute(dataset).as_os_str().as_encoded_bytes());
    let own = format!("{name}-{}", &digest[..12]);
    if let Some(folder) = &options.folder {
        return vec![folder.join(own)];
    }
    let near = (!is_remote(dataset)).then(|| beside(dataset, ".decoded"));
    near.into_iter().chain(caches.map(|caches| caches.join("decoded").join(own))).collect()
}

impl Source<'_> {
    fn target(&self, column: usize, convert: Convert) -> Target {
        let (info, Origin { paths, choice, .. }) = (self.dataset.info(), &self.origin);
        let (field, Convert { wanted: [height, width], channels, .. }) = (info.field(column), convert);
        // The dataset itself may be moved with its files; what it is joined to is other files elsewhere.
        let joined: Vec<_> = paths.iter().skip(1).map(|path| absolute(path)).collect();
        let view = format!("{} {:?} {height} {width} {choice} {joined:?}", field.name, field.shape);
        let view = sha256(view.as_bytes());
        let plain: String =
            field.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
        let rows = info.lengths.iter().sum();
        let header = format!(
            "decoded images, version 1\nview {view}\nstate {}\n{rows} images of {height} x {width} x {channels} bytes\n",
            self.state
        );
        let mut header = header.into_bytes();
        header.resize(HEADER, 0);
        let name = format!("{plain}-{height}x{width}-{}.frames", &view[..12]);
        Target { column, convert, name, header, dim: height * width * channels, rows }
    }

    fn find(&self, target: &Target) -> Option<Kept> {
        let kept = self.folders.iter().find_map(|folder| target.open(folder))?;
        // A process that was killed after its file was in place left its lock; one that lives still has it, and removes it.
        if beside(&kept.path, ".lock").exists() {
            drop(WriterLock::take(&kept.path));
        }
        Some(kept)
    }

    /// Makes the file of a column in the first folder that can be written to, or waits for the process that makes it; the seconds that
    /// making took.
    fn make(&self, target: &Target) -> Result<(Kept, Option<f64>), DataError> {
        let mut failed = None;
        for folder in &self.folders {
            let path = folder.join(&target.name);
            let _lock = match self.lock(folder, &path) {
                Ok(lock) => lock,
                Err(error) => {
                    failed.get_or_insert(error);
                    continue;
                }
            };
            if let Some(kept) = target.open(folder) {
                return Ok((kept, None));
            }
            let (began, part) = (Instant::now(), beside(&path, ".part"));
            let settled = self.write(target, &part).and_then(|file| {
                if state::state(self.dataset.info(), &self.origin)? != self.state {
                    let reason = "the dataset was changed while its images were decoded; wait until it is written, and open it again";
                    return wrong("cache", reason);
                }
                swm_files::settle(&part, &path).map_err(|error| DataError::io(&path, "write", error))?;
                Ok(file)
            });
            // Of a full disk, or of an interruption, nothing is left.
            let file = settled.inspect_err(|_| drop(fs::remove_file(&part)))?;
            return Ok((Kept { path, file }, Some(began.elapsed().as_secs_f64())));
        }
        let reason = "no variable names a folder for decoded images; set SWM_HOME";
        failed.map_or_else(|| wrong("cache", reason), Err)
    }

    /// Waits for the lock of a file in a folder.
    fn lock(&self, folder: &Path, path: &Path) -> Result<WriterLock, DataError> {
        fs::create_dir_all(folder).map_err(|error| DataError::io(folder, "create", error))?;
        let mut watched = self.dataset.share();
        loop {
            match WriterLock::take(path) {
                // Ends, too, where reading is interrupted.
                Err(DataError::Busy { .. }) => watched.dress(None)?,
                taken => return taken,
            }
            thread::sleep(PAUSE);
        }
    }

    /// Decodes all images of a column into a new file, and brings it to the disk.
    fn write(&self, target: &Target, path: &Path) -> Result<File, DataError> {
        let failed = |error| DataError::io(path, "write", error);
        let file = new_file(path).map_err(failed)?;
        let lengths = &self.dataset.info().lengths;
        let episodes = starts(lengths).into_iter().zip(&**lengths).enumerate();
        let runs: Vec<(usize, usize, Range<usize>)> = episodes
            .flat_map(|(episode, (begin, &len))| {
                (0..len).step_by(RUN).map(move |first| (episode, begin, first..len.min(first + RUN)))
            })
            .collect();
        let next = AtomicUsize::new(0);
        let work = |mut dataset: Box<dyn Dataset>| -> Result<(), DataError> {
            let (mut images, mut darkroom) = (Vec::new(), Darkroom::default());
            while let Some((episode, begin, rows)) = runs.get(next.fetch_add(1, Ordering::Relaxed)) {
                for first in rows.clone().step_by(target.per_piece()) {
                    let steps = Steps { first, count: target.per_piece().min(rows.end - first), stride: 1 };
                    images.resize(steps.count * target.dim, 0);
                    let mut read = |out: &mut [u8]| {
                        dataset.read_column(target.column, *episode, steps, SliceMut::U8(out))
                    };
                    match target.convert.is_needed() {
                        true => target.convert.run(&mut darkroom, &mut images, read),
                        false => read(&mut images),
                    }?;
                    let at = HEADER as u64 + (begin + first) as u64 * target.dim as u64;
                    write_all_at(&file, &images, at).map_err(failed)?;
                }
            }
            Ok(())
        };
        // The first error ends all threads.
        let work = &|dataset| work(dataset).inspect_err(|_| next.store(runs.len(), Ordering::Relaxed));
        thread::scope(|scope| {
            let threads: Vec<_> = (0..self.threads.min(runs.len()))
                .map(|_| self.dataset.share())
                .map(|dataset| scope.spawn(move || work(dataset)))
                .collect();
            let ended: Vec<_> = threads.into_iter().map(thread::ScopedJoinHandle::join).collect();
            ended.into_iter().try_for_each(|ended| ended.unwrap_or_else(|panic| resume_unwind(panic)))
        })?;
        // Last, so that no file without all of its images has one.
        write_all_at(&file, &target.header, 0).and_then(|()| file.sync_all()).map_err(failed)?;
        Ok(file)
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

    crate::adapt::inner::of_inner!(looks, origin, checks);
}
