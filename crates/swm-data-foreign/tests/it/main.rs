//! Datasets of other programs as a user sees them: what their own packages wrote, what differs from it, damage, and what is not read.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

#[cfg(feature = "video")]
mod aloha;
#[cfg(feature = "lerobot")]
mod codecs;
#[cfg(feature = "video")]
mod dreamer;
#[cfg(feature = "video")]
mod field;
#[cfg(feature = "video")]
mod hdf5;
#[cfg(feature = "video")]
mod lance;
mod layouts;
#[cfg(feature = "video")]
mod partial;
#[cfg(feature = "video")]
mod published;
#[cfg(feature = "video")]
mod refused;
#[cfg(all(feature = "remote", feature = "video"))]
mod remote;
#[cfg(feature = "video")]
mod rlds;
#[cfg(feature = "video")]
mod varied;
#[cfg(feature = "video")]
mod vd4rl;
#[cfg(feature = "video")]
mod zarr;

use std::path::Path;
use std::sync::LazyLock;

use swm_core::Registry;
#[cfg(feature = "video")]
use swm_data::testing::copied;
#[cfg(feature = "video")]
use swm_data::testing::mutations::{mutate_for, play_in};
use swm_data::{DataError, Dataset, open_in};

/// The formats, and the layouts of this crate.
fn registry() -> &'static Registry {
    static REGISTRY: LazyLock<Registry> = LazyLock::new(|| {
        let registry = Registry::new().with(swm_data::FORMATS).with(swm_data_foreign::LAYOUTS);
        #[cfg(feature = "lerobot")]
        let registry = registry.with(swm_data_lerobot::FORMATS);
        registry
    });
    &REGISTRY
}

fn open(path: &Path) -> Result<Box<dyn Dataset>, DataError> {
    open_in(registry(), path)
}

/// Damages the files of a dataset, of which everything is read.
#[cfg(feature = "video")]
fn mutate(name: &str, path: &Path) {
    mutate_for(name, path, &mut |path| play_in(registry(), path));
}
