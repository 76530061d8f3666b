//! LeRobot folders, as pyarrow and PyAV write them and as we do: values, images, damage; and the tests that every format must pass, from
//! the sources of those of `swm-data`.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

#[path = "../../../swm-data/tests/it/append.rs"]
mod append;
mod cameras;
mod checks;
mod codecs;
mod crash;
#[path = "../../../swm-data/tests/it/exits.rs"]
mod exits;
mod foreign;
#[cfg(unix)]
#[path = "../../../swm-data/tests/it/hostile_places.rs"]
mod hostile_places;
#[cfg(unix)]
#[path = "../../../swm-data/tests/it/hostile_writes.rs"]
mod hostile_writes;
mod images;
mod last_rows;
#[path = "../../../swm-data/tests/it/loader_cache.rs"]
mod loader_cache;
#[path = "../../../swm-data/tests/it/loader_sharing.rs"]
mod loader_sharing;
#[path = "../../../swm-data/tests/it/mutations.rs"]
mod mutations;
mod options;
#[cfg(target_os = "linux")]
#[path = "../../../swm-data/tests/it/power_loss.rs"]
mod power_loss;
#[path = "../../../swm-data-foreign/tests/it/published.rs"]
mod published;
mod rates;
mod recording;
mod remote;
mod rows;
#[path = "../../../swm-data/tests/it/streams.rs"]
mod streams;
mod support;
mod tasks;
#[path = "../../../swm-data/tests/it/texts.rs"]
mod texts;
#[path = "../../../swm-data/tests/it/tools.rs"]
mod tools;
#[path = "../../../swm-data/tests/it/types.rs"]
mod types;

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use swm_core::Registry;
use swm_data::format::Opened;
use swm_data::testing::copied;
use swm_data::testing::mutations::{mutate_for, play_in, seed_in};
use swm_data::tools::copy::{Copied, Piece, copy_in};
use swm_data::{DataError, Dataset, DatasetWriter, OpenOptions, WriteMode, WriteOptions, create_in, open_in};
use swm_data_lerobot::FORMATS;

/// All formats: tests compare this one with others.
fn registry() -> &'static Registry {
    static REGISTRY: LazyLock<Registry> =
        LazyLock::new(|| Registry::new().with(swm_data::FORMATS).with(FORMATS));
    &REGISTRY
}

fn open(path: &Path) -> Opened<dyn Dataset> {
    open_in(registry(), path)
}

fn open_with(registry: &Registry, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
    swm_data::open_with(registry, path, options)
}

fn create(path: &Path, mode: WriteMode, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_in(registry(), path, &mode.into(), format)
}

fn create_with(path: &Path, options: &WriteOptions, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_in(registry(), path, options, format)
}

fn copy(
    sources: &mut [Box<dyn Dataset>],
    pieces: &[Piece],
    to: &Path,
    how: (Option<&str>, &WriteOptions),
    watch: &mut dyn FnMut(usize),
) -> Result<Copied, DataError> {
    copy_in(registry(), sources, pieces, to, how, watch)
}

fn seed(path: &Path) {
    seed_in(registry(), path);
}

fn play(path: &Path) -> bool {
    play_in(registry(), path)
}

fn mutate(name: &str, path: &Path) {
    mutate_for(name, path, &mut |path| play_in(registry(), path));
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets").join(name)
}
