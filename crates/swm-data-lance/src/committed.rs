//! Episodes that are committed by their files, before a manifest lists them. A manifest lists all files, so one per episode would
//! grow with the square of their number: while a recording goes on, the next one is due when a sixty-fourth of what it would list
//! is new. Until then the file itself commits its episode: it appears whole, under the name that comes next.
//!
//! Other programs see those episodes once the recording ends, is continued or repaired. Which manifest files may follow says a
//! mark in it; another program's next version is not that, so what it removed stays removed.

use std::path::Path;
use std::sync::Arc;

use lance_core::cache::LanceCache;
use lance_encoding::decoder::DecoderPlugins;
use lance_file::reader::{FileReader, FileReaderOptions};
use lance_io::scheduler::{ScanScheduler, SchedulerConfig};
use lance_io::utils::CachedFileSize;
use lance_table::format::Fragment;

use crate::data_file::fragment_of;
use crate::table::{DATA, Table, wait};
use swm_data::error::{At as _, FormatError, Result};

/// For files of which only the end is read.
const AHEAD_BYTES: u64 = 1 << 20;

/// The file of an episode, in both tables.
pub(crate) fn file_name(episode: usize) -> String {
    format!("episode-{episode:06}.lance")
}

/// Whether the files of a table are those that we recorded, one per episode, none missing.
pub(crate) fn is_recorded(fragments: &[Fragment]) -> bool {
    let named = |(episode, fragment): (usize, &Fragment)| matches!(&fragment.files[..], [file] if file.path == file_name(episode));
    fragments.iter().enumerate().all(named)
}

/// Opens the newest version of a table, and adds what was committed after it.
pub(crate) fn open(folder: &Path) -> Result<Table> {
    let mut table = Table::open(folder)?;
    if !table.is_being_recorded() || !is_recorded(table.fragments()) {
        return Ok(table);
    }
    loop {
        let name = file_name(table.fragments().len());
        if !folder.join(DATA).join(&name).is_file() {
            return Ok(table);
        }
        let rows = rows_of(&table, &name).at(format_args!("its file {name}, which no manifest lists yet"))?;
        let fragment = fragment_of(&table, name, rows, None);
        table.push(fragment);
    }
}

/// The number of rows in a file.
fn rows_of(table: &Table, name: &str) -> Result<usize> {
    let path = table.path(&format!("{DATA}/{name}"));
    let cache = LanceCache::with_capacity(0);
    let reader = wait(async {
        let scheduler = ScanScheduler::new(table.store.clone(), SchedulerConfig::new(AHEAD_BYTES));
        let file = scheduler.open_file(&path, &CachedFileSize::unknown()).await?;
        let plugins = Arc::<DecoderPlugins>::default();
        FileReader::try_open(file, None, plugins, &cache, FileReaderOptions::default()).await
    })?;
    usize::try_from(reader.num_rows()).map_err(FormatError::other)
}
