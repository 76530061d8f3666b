//! Open datasets: shared by requests, opened again when they have grown.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use swm_core::{Dtype, Registry};
use swm_data::{Dataset, DatasetInfo, OpenOptions, Rendered};

use super::query::Summaries;
use crate::error::Refusal;
use crate::roots::Roots;

/// Datasets that stay open; the one that was asked for longest ago goes first.
const MAX_OPEN: usize = 12;
/// A dataset that is being recorded is looked at so often.
const CHECK_PERIOD: Duration = Duration::from_millis(500);

/// The open datasets.
pub(crate) struct Store {
    registry: Registry,
    open: Mutex<VecDeque<Arc<Opened>>>,
}

/// One open dataset.
pub(crate) struct Opened {
    path: PathBuf,
    opening: OpenOptions,
    stamp: Vec<(PathBuf, u64, Option<SystemTime>)>,
    checked: Mutex<Instant>,
    info: DatasetInfo,
    dataset: Mutex<Box<dyn Dataset>>,
    /// The last renderer, with what it renders: making one costs an environment.
    pub rendered: Mutex<Option<(String, Rendered)>>,
    pub summaries: Mutex<Summaries>,
}

impl Store {
    pub(crate) fn new(registry: Registry) -> Self {
        Self { registry, open: Mutex::default() }
    }

    /// The dataset at a path, as it is now, opened with these options.
    ///
    /// # Errors
    ///
    /// What is there is no dataset, is damaged, or has links out of the roots; or an option is wrong, or missing.
    pub(crate) fn open(
        &self,
        roots: &Roots,
        path: &Path,
        opening: &OpenOptions,
    ) -> Result<Arc<Opened>, Refusal> {
        let is_it = |opened: &Opened| opened.path == path && opened.opening == *opening;
        let known = self.list().iter().find(|opened| is_it(opened)).cloned();
        if let Some(opened) = known
            && opened.is_current()
        {
            return Ok(opened);
        }
        let stamp = stamp(path);
        roots.check_links(path)?;
        let dataset = swm_data::open_with(&self.registry, path, opening)?;
        let opened = Arc::new(Opened {
            path: path.to_owned(),
            opening: opening.clone(),
            stamp,
            checked: Mutex::new(Instant::now()),
            info: dataset.info().clone(),
            dataset: Mutex::new(dataset),
            rendered: Mutex::default(),
            summaries: Mutex::default(),
        });
        let mut list = self.list();
        list.retain(|other| !is_it(other));
        list.push_back(Arc::clone(&opened));
        if list.len() > MAX_OPEN {
            list.pop_front();
        }
        Ok(opened)
    }

    fn list(&self) -> MutexGuard<'_, VecDeque<Arc<Opened>>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Opened {
    pub(super) fn info(&self) -> &DatasetInfo {
        &self.info
    }

    /// For one request at a time: readers keep buffers.
    pub(super) fn dataset(&self) -> MutexGuard<'_, Box<dyn Dataset>> {
        self.dataset.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_current(&self) -> bool {
        let mut checked = self.checked.lock().unwrap_or_else(PoisonError::into_inner);
        if checked.elapsed() < CHECK_PERIOD {
            return true;
        }
        *checked = Instant::now();
        self.stamp == stamp(&self.path)
    }

    /// The columns that hold images, the one of the observation first.
    pub(super) fn image_columns(&self) -> Vec<&str> {
        let fields = self.info.schema.fields().iter();
        let images =
            fields.filter(|field| field.dtype == Dtype::U8 && matches!(field.shape[..], [_, _, 1 | 3]));
        let mut names: Vec<&str> = images.map(|field| field.name.as_str()).collect();
        names.sort_by_key(|&name| name != swm_core::env::PIXELS);
        names
    }

    /// Whether images can be rendered from what was recorded.
    pub(super) fn can_render(&self) -> bool {
        self.info.runs.first().is_some_and(|(_, run)| !run.env.is_empty())
    }
}

/// Sizes and times of a file, or of the files of a folder: what changes when a dataset grows.
fn stamp(path: &Path) -> Vec<(PathBuf, u64, Option<SystemTime>)> {
    let one = |path: PathBuf| {
        let there = fs::metadata(&path).ok();
        let modified = there.as_ref().and_then(|there| there.modified().ok());
        (path, there.map_or(0, |there| there.len()), modified)
    };
    let mut all = vec![one(path.to_owned())];
    let entries = fs::read_dir(path).into_iter().flatten().flatten();
    all.extend(entries.take(1000).map(|entry| one(entry.path())));
    all.sort();
    all
}
