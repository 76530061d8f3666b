//! What the command line does and this crate cannot: it is handed in by whoever serves, so that the page and the commands are one.

use std::fmt::Debug;
use std::path::Path;

use serde_json::Value as Json;
use swm_core::Registry;
use swm_core::error::BoxError;

/// What the page asks the command line for; the command `swm ui` hands in all of it. Errors are shown on the page.
pub trait Commands: Debug + Send + Sync {
    /// What `swm jobs DIR --json` prints.
    ///
    /// # Errors
    ///
    /// The folder holds no job, or one that cannot be read.
    fn job(&self, registry: &Registry, dir: &Path) -> Result<Json, BoxError>;
}
