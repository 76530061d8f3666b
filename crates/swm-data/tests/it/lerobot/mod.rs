//! LeRobot folders, as pyarrow and PyAV write them and as we do: values, images, damage.

mod cameras;
mod checks;
mod foreign;
mod images;
mod last_rows;
mod options;
mod rates;
mod recording;
mod rows;
mod tasks;

use std::path::{Path, PathBuf};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets").join(name)
}
