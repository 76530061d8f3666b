//! Opening a dataset that lies elsewhere.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Registry, SliceMut};
use swm_files::remote::{Found, Remote, RemoteError, Used};

use crate::adapt::inner::of_inner;
use crate::dataset::{Dataset, DatasetInfo, EncodedRows, Steps};
use crate::error::DataError;
use crate::format::{self, Opened};
use crate::open_options::OpenOptions;

#[cfg(test)]
mod tests;

/// What MCAP files and zip archives begin with.
const MCAP: &[u8] = b"\x89MCAP0\r\n";
const ZIP: &[u8] = b"PK\x03\x04";

/// Opens a dataset that lies elsewhere, as the variables of this process set it.
pub(crate) fn open(registry: &Registry, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
    let remote = Remote::global().map_err(|error| error.while_trying("open"))?;
    open_from(&remote, registry, path, options)
}

pub(crate) fn open_from(
    remote: &Arc<Remote>,
    registry: &Registry,
    path: &Path,
    options: &OpenOptions,
) -> Opened<dyn Dataset> {
    let failed = |error: RemoteError| error.while_trying("open");
    let (path, found) = remote.open(path).map_err(failed)?;
    let (inner, copy) = match by_position(registry, &path, &found, options) {
        Some(opened) => (opened.map_err(|error| RemoteError::or_damage(error, "read"))?, None),
        None => {
            let (copy, used) = found.cached(&path).map_err(failed)?;
            let inner = format::open_with(registry, &copy, options);
            (inner.map_err(|error| of_address(error, &copy, &path))?, Some((copy, Arc::new(used))))
        }
    };
    let mut info = inner.info().clone();
    let note = match &copy {
        Some((copy, _)) => {
            format!("it was fetched as a whole, {} bytes, to {}", found.bytes(), copy.display())
        }
        None => "it is read by position: what is read is fetched in blocks, and kept in the cache".to_owned(),
    };
    info.notes = info.notes.iter().cloned().chain([note]).collect();
    info.path = Arc::from(path);
    Ok(Box::new(Elsewhere { inner, info, found, copy }))
}

/// An error of a copy names the address.
fn of_address(mut error: DataError, copy: &Path, address: &Path) -> DataError {
    if let DataError::Io { path, .. }
    | DataError::NotADataset { path, .. }
    | DataError::Damaged { path, .. }
    | DataError::Unsupported { path, .. }
    | DataError::Request { path, .. } = &mut error
        && let Ok(below) = path.strip_prefix(copy)
    {
        *path = match below.as_os_str().is_empty() {
            true => address.to_owned(),
            false => address.join(below),
        };
    }
    error
}

/// Opens what its format reads by position; `None`: it is to be fetched as a whole.
fn by_position(
    registry: &Registry,
    path: &Path,
    found: &Found,
    options: &OpenOptions,
) -> Option<Opened<dyn Dataset>> {
    let opened = match found {
        Found::Object(object) => {
            let mut start = [0; 8];
            let is_long = object.length() >= 8 && object.is_by_position();
            if !is_long || object.read_exact_at(&mut start, 0).is_err() {
                return None;
            }
            match start {
                start if start == MCAP => {
                    registry.find::<format::Format>("mcap").ok()?.open_with(path, options)
                }
                start if start.starts_with(ZIP) => format::open_layout(registry, path, options)?,
                _ => return None,
            }
        }
        Found::Folder(_) => format::open_layout(registry, path, options)?,
    };
    Some(opened.and_then(|dataset| {
        format::check_rows_of(dataset.as_ref(), || Ok(found.bytes()))?;
        Ok(dataset)
    }))
}

/// A dataset that lies elsewhere. A failure of the network is no damage of it.
struct Elsewhere {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
    found: Found,
    /// The copy that it is read from, which stays meanwhile.
    copy: Option<(PathBuf, Arc<Used>)>,
}

impl Elsewhere {
    fn named<T>(&self, result: Result<T, DataError>) -> Result<T, DataError> {
        result.map_err(|error| match &self.copy {
            Some((copy, _)) => of_address(error, copy, &self.info.path),
            None => RemoteError::or_damage(error, "read"),
        })
    }
}

impl Dataset for Elsewhere {
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
        let read = self.inner.rows(column, episode, steps, out);
        self.named(read)
    }

    of_inner!(looks, origin);

    fn share(&self) -> Box<dyn Dataset> {
        let (info, found, copy) = (self.info.clone(), self.found.clone(), self.copy.clone());
        Box::new(Self { inner: self.inner.share(), info, found, copy })
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let read = self.inner.check_episode(episode);
        self.named(read)
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        let read = self.inner.check_whole();
        self.named(read)
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        self.inner.encoding(column)
    }

    fn encoded_rows(
        &mut self,
        column: usize,
        episode: usize,
        rows: Range<usize>,
        out: &mut EncodedRows,
    ) -> Result<(), DataError> {
        let read = self.inner.encoded_rows(column, episode, rows, out);
        self.named(read)
    }
}
