//! Datasets that lie elsewhere: `https://HOST/PATH` (`http://` of this machine alone), `s3://BUCKET/KEY` of any store that speaks S3, and
//! `hf://datasets/USER/REPO[@REVISION]/PATH` of the Hugging Face Hub. Such an address stands wherever a dataset is read.
//!
//! Formats that read by position (`.npz`, MCAP, Zarr) fetch the blocks that are read, which are kept on disk; others are fetched as a
//! whole. Both are keyed by the version of the object (its `ETag`, or the commit), and a version that changes while it is read is an
//! error. Nothing is fetched but what an address names.
//!
//! | variable | what it says |
//! |---|---|
//! | `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN` | who asks; without them requests are not signed, as public buckets take them |
//! | `AWS_ENDPOINT_URL_S3`, `AWS_ENDPOINT_URL` | the address of another store than Amazon's |
//! | `AWS_REGION`, `AWS_DEFAULT_REGION` | its region; default: `us-east-1` |
//! | `HF_TOKEN`, `HF_ENDPOINT` | who asks the Hub, and where it is; default: `https://huggingface.co` |
//! | `SSL_CERT_FILE` | certificates to trust, in PEM; default: those of Mozilla |
//! | `SWM_CACHE`, `SWM_CACHE_GB` | where fetched data is kept, and the most that blocks and that whole copies take; default: `SWM_HOME/cache`, else the system's folder of caches, and 20 GB |

use std::path::Path;

use swm_core::dataset::DataError;

#[cfg(feature = "remote")]
mod address;
#[cfg(feature = "remote")]
mod blocks;
#[cfg(feature = "remote")]
mod client;
#[cfg(feature = "remote")]
mod copies;
#[cfg(feature = "remote")]
mod copy;
#[cfg(feature = "remote")]
mod error;
#[cfg(feature = "remote")]
mod fetch;
#[cfg(feature = "remote")]
mod folder;
#[cfg(feature = "remote")]
mod found;
#[cfg(feature = "remote")]
mod hub;
#[cfg(feature = "remote")]
mod list;
#[cfg(feature = "remote")]
mod object;
#[cfg(feature = "remote")]
mod s3;
#[cfg(feature = "remote")]
mod settings;
#[cfg(feature = "remote")]
mod sign;
#[cfg(any(feature = "testing", all(test, feature = "remote")))]
pub mod testing;
#[cfg(all(test, feature = "remote"))]
mod tests;

#[cfg(feature = "remote")]
pub use copies::Used;
#[cfg(feature = "remote")]
pub use copy::{Event, watch};
#[cfg(feature = "remote")]
pub use error::{RemoteError, RemoteErrorKind};
#[cfg(feature = "remote")]
pub use fetch::{Fetched, fetch};
#[cfg(feature = "remote")]
pub use folder::Folder;
#[cfg(feature = "remote")]
pub use found::{Found, Remote, digest, folder, side_file};
#[cfg(feature = "remote")]
pub use object::Object;

/// The schemes of addresses.
const SCHEMES: [&str; 4] = ["https", "http", "s3", "hf"];

/// Whether a path is the address of a dataset that lies elsewhere. One slash behind the scheme counts as two, which is what is left of
/// them in paths of Python.
#[must_use]
pub fn is_remote(path: &Path) -> bool {
    let text = path.as_os_str().to_string_lossy();
    SCHEMES.iter().any(|scheme| text.strip_prefix(scheme).is_some_and(|rest| rest.starts_with(":/")))
}

/// The present time: of the last use of what is kept, and of signatures.
#[cfg(feature = "remote")]
#[expect(clippy::disallowed_methods, reason = "no result holds it")]
fn now() -> std::time::SystemTime {
    std::time::SystemTime::now()
}

/// The error of a build without this.
#[must_use]
pub fn not_built_in(path: &Path) -> DataError {
    let reason =
        "datasets that lie elsewhere are not built in; build with the feature `remote`, or download it";
    DataError::request(path, reason)
}

/// In place of the digest of a version, where this is not built in.
///
/// # Errors
///
/// It is not built in.
#[cfg(not(feature = "remote"))]
pub fn digest(path: &Path) -> Result<String, DataError> {
    Err(not_built_in(path))
}
