//! Bundles: a result and all it takes to repeat it, in one folder.
//!
//! ```text
//! FOLDER/bundle.json      what it holds, and what it was made by
//! FOLDER/manifest.json    the task: starts, goals, budget, success test
//! FOLDER/receipt.json     the result; its models by their paths in the folder
//! FOLDER/model/…          the model's files, where the policy has one
//! FOLDER/MODEL_CARD.md    what the model is; the same
//! FOLDER/README.md        for people
//! FOLDER/SHA256SUMS       SHA-256 of every other file, as `sha256sum -c` reads it
//! ```

mod models;
mod open;
mod readme;
mod sums;
mod write;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::evaluation::Code;

pub use open::{Bundle, bundle_of, receipt_to_repeat};
pub use write::write_bundle;

/// The version of [`BundleInfo`] that is written and read.
pub const BUNDLE_VERSION: u32 = 1;

const INFO: &str = "bundle.json";
const MANIFEST: &str = "manifest.json";
const RECEIPT: &str = "receipt.json";
const README: &str = "README.md";
const CARD: &str = "MODEL_CARD.md";
const SUMS: &str = "SHA256SUMS";

/// What a bundle holds, and what it was made by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct BundleInfo {
    /// [`BUNDLE_VERSION`].
    pub bundle: u32,
    /// The environment's id.
    pub env: String,
    /// Hash of the manifest.
    pub manifest_hash: String,
    /// The policy, with models by their paths in the folder.
    pub policy: String,
    /// Whether the policy is an object of another program, which a receipt cannot make again.
    pub is_foreign: bool,
    /// The code that made the result.
    pub code: Code,
    /// The code that made the bundle.
    pub bundled_by: Code,
    /// SHA-256 of what the environment is made from, by name: libraries, models of robots.
    pub made_from: BTreeMap<String, String>,
    /// Arguments of policies that are paths in the folder.
    pub paths: Vec<String>,
    /// License of the model, by its SPDX identifier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub license: Option<String>,
    /// What somebody reported of the same policy on the same task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reported: Option<Reported>,
}

/// A published success rate that a result reproduces, or does not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reported {
    /// In percent.
    pub success_rate: f64,
    /// Where it is published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
}
