//! Opening a dataset that lies elsewhere.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Registry, SliceMut};

use super::address::Address;
use super::error::RemoteError;
use super::found::{Found, Remote, opened};
use crate::dataset::{Dataset, DatasetInfo, EncodedRows, Steps};
use crate::error::DataError;
use crate::foreign;
use crate::format::{self, Opened};
use crate::open_options::OpenOptions;

/// What MCAP files and zip archives begin with.
const MCAP: &[u8] = b"\x89MCAP0\r\n";
const ZIP: &[u8] = b"PK\x03\x04";

/// Opens a dataset that lies elsewhere, as the variables of this process set it.
pub(crate) fn open(registry: &Registry, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
    let remote = Remote::global().map_err(|error| error.while_trying("open"))?;
    open_from(&remote, registry, path, options)
}

pub(super) fn open_from(
    remote: &Arc<Remote>,
    registry: &Registry,
    path: &Path,
    options: &OpenOptions,
) -> Opened<dyn Dataset> {
    let failed = |error: RemoteError| error.while_trying("open");
    let address = Address::of(path).map_err(failed)?;
    let name = address.name();
    let path = PathBuf::from(&name);
    let found = match opened(&path) {
        Some(found) => found,
        None => remote.find(&address).map_err(failed)?,
    };
    found.remember(&path);
    let (inner, copy) = match by_position(registry, &path, &found, options) {
        Some(opened) => (opened.map_err(|error| RemoteError::or_damage(error, "read"))?, None),
        None => {
            let copy = found.cached(&name, address.file_name()).map_err(failed)?;
            (format::open_with(registry, &copy, options)?, Some(copy))
        }
    };
    let mut info = inner.info().clone();
    let note = match &copy {
        Some(copy) => format!("it was fetched as a whole, {} bytes, to {}", found.bytes(), copy.display()),
        None => "it is read by position: what is read is fetched in blocks, and kept in the cache".to_owned(),
    };
    info.notes = info.notes.iter().cloned().chain([note]).collect();
    info.path = Arc::from(path);
    Ok(Box::new(Elsewhere { inner, info, found }))
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
                start if start.starts_with(ZIP) => foreign::open(path, options)?,
                _ => return None,
            }
        }
        Found::Folder(_) => foreign::open(path, options)?,
    };
    Some(opened.and_then(|dataset| {
        format::check_rows_of(dataset.as_ref(), || Ok(found.bytes()))?;
        Ok(dataset)
    }))
}

/// Where statistics of a dataset that lies elsewhere are kept: in the cache.
pub(crate) fn side_file(path: &Path, suffix: &str) -> Option<PathBuf> {
    let found = opened(path)?;
    let settings = match &found {
        Found::Object(object) => &object.remote.client.settings,
        Found::Folder(folder) => &folder.remote.client.settings,
    };
    let folder = settings.cache.as_ref()?.join("beside");
    std::fs::create_dir_all(&folder).ok()?;
    Some(folder.join(format!("{}{suffix}", found.key()?)))
}

/// A dataset that lies elsewhere. A failure of the network is no damage of it.
struct Elsewhere {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
    found: Found,
}

fn read<T>(result: Result<T, DataError>) -> Result<T, DataError> {
    result.map_err(|error| RemoteError::or_damage(error, "read"))
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
        read(self.inner.rows(column, episode, steps, out))
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { inner: self.inner.share(), info: self.info.clone(), found: self.found.clone() })
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        read(self.inner.check_episode(episode))
    }

    fn check_whole(&mut self) -> Result<(), DataError> {
        read(self.inner.check_whole())
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
        read(self.inner.encoded_rows(column, episode, rows, out))
    }
}
