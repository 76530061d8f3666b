//! How a dataset of another program was read, as copies of it keep it: the row of rewards, and the names of columns.

use serde_json::json;
use swm_core::dataset::Metadata;

use crate::open_options::OpenOptions;

/// The member of a source's record that has the rows of rewards, and its value for [`RewardsAt::Actions`].
const REWARDS: &str = "rewards";
const ACTION: &str = "action";

/// What a user has to know of rewards beside their actions.
pub const REWARDS_NOTE: &str = "`reward` of a row is that of the action taken from it; recordings of this program have it in the row that it led to";

/// The row of a reward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RewardsAt {
    /// That of the action which earned it, as other programs have it.
    Actions,
    /// That which the action led to, as recordings of this program have it.
    Arrivals,
}

impl RewardsAt {
    /// Of what a run of a dataset, or of a copy of one, was read from.
    pub fn of(run: &Metadata) -> Self {
        match run.source.as_ref().map(|source| &source[REWARDS]) {
            Some(place) if place == ACTION => Self::Actions,
            _ => Self::Arrivals,
        }
    }
}

/// The record of how a dataset was read, which copies of it keep. `env` and `fps` are what the files say.
pub fn source_record(
    format: &str,
    options: &OpenOptions,
    mapping: &[(String, String)],
    env: Option<&str>,
    fps: Option<f64>,
    rewards: Option<RewardsAt>,
) -> Metadata {
    let mapping: serde_json::Map<_, _> = mapping.iter().map(|(new, old)| (new.clone(), json!(old))).collect();
    let mut metadata = Metadata::unknown();
    if let Some(env) = options.env.as_deref().or(env) {
        env.clone_into(&mut metadata.env);
    }
    metadata.settings = options.env_options.clone();
    metadata.rows_per_second = options.fps.or(fps);
    // A folder of one machine says nothing about the data.
    let options = OpenOptions { storage: None, ..options.clone() };
    let mut source = json!({ "format": format, "columns": mapping, "options": options });
    if rewards == Some(RewardsAt::Actions) {
        source[REWARDS] = ACTION.into();
    }
    metadata.source = Some(source);
    metadata
}
