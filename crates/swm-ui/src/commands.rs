//! Operations of the command line, injected when the server starts.

use std::fmt::Debug;
use std::path::Path;

use serde_json::Value as Json;
use swm_core::Registry;
use swm_core::error::BoxError;

/// Operations of the command line that the page needs; the command `swm ui` implements them. The page shows their errors.
pub trait Commands: Debug + Send + Sync {
    /// What `swm jobs DIR --json` prints.
    ///
    /// # Errors
    ///
    /// The folder holds no job, or one that cannot be read.
    fn job(&self, registry: &Registry, dir: &Path) -> Result<Json, BoxError>;
}
