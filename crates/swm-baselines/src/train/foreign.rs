//! Checkpoints of others, as far as runs must be distinguished from them: by the names of files, and a version. `swm-checkpoints` reads them.

use std::fs::{self, File};
use std::path::Path;

use serde_json::Value as Json;
use swm_weights::ENDINGS;

use super::folder::RunFolder;
use crate::error::BaselineError;

/// The longest `config.json` of others that is read, in bytes.
pub const LONGEST_CONFIG: u64 = 1 << 20;

/// Configs of trainings that Hydra wrote.
pub const YAML_CONFIGS: [&str; 2] = ["hydra.yaml", "config.yaml"];

/// Whether a folder holds a checkpoint of others: a config that names a class, or weights beside no run.
pub fn is_foreign(path: &Path) -> bool {
    if path.is_file() {
        return path
            .extension()
            .and_then(|ending| ending.to_str())
            .is_some_and(|ending| ENDINGS.contains(&ending));
    }
    let Some(bytes) = read(&path.join("config.json")) else {
        return YAML_CONFIGS.iter().any(|name| path.join(name).is_file());
    };
    serde_json::from_slice::<Json>(&bytes).is_ok_and(|config| config.get("version").is_none())
}

/// Refuses a checkpoint of others where a run of this program is wanted.
pub(crate) fn refuse_foreign(run: &RunFolder) -> Result<(), BaselineError> {
    if !is_foreign(run.path()) {
        return Ok(());
    }
    let reason = "it is a checkpoint of others, not a run of this program; import it first (`swm import`), and use the run";
    Err(run.wrong(reason))
}

fn read(config: &Path) -> Option<Vec<u8>> {
    let len = File::open(config).and_then(|file| file.metadata()).ok()?.len();
    (len <= LONGEST_CONFIG).then(|| fs::read(config).ok())?
}
