//! Training: from a dataset to a folder with checkpoints, as long as it takes and however often it is interrupted.
//!
//! | file | duty |
//! |---|---|
//! | `session` | a training run: begin here |
//! | `fit`, `settings` | the loop |
//! | `data`, `clips`, `scale` | clips, splits, statistics |
//! | `looks` | images that are rendered otherwise than they were recorded |
//! | `latents` | clips whose images are encoded once |
//! | `folder`, `checkpoints`, `run` | files that survive a kill, and what they say |
//! | `foreign` | what is no run, but a checkpoint of others |
//! | `diagnosis` | what a model is worth, measured while it trains |
//! | `metrics`, `events` | metrics and their files |
//!
//! Networks, losses and optimizers are not known here: they are behind [`Baseline`](crate::Baseline).

mod checkpoints;
mod clips;
mod data;
mod diagnosis;
mod events;
mod fit;
mod folder;
mod foreign;
mod latents;
mod looks;
mod metrics;
mod run;
mod scale;
mod session;
mod settings;
mod sums;
#[cfg(test)]
mod tests;
mod world;

pub use checkpoints::Checkpoint;
pub use data::{
    ACTION, DataConfig, PROPRIO, PhaseClips, Split, TrainData, data_dims, validation_episodes, with_images,
};
pub use diagnosis::Diagnosis;
pub use events::EventWriter;
pub use fit::{End, State, fit};
pub use folder::{RunFolder, RunLock};
pub(crate) use foreign::refuse_foreign;
pub use foreign::{LONGEST_CONFIG, YAML_CONFIGS, is_foreign};
pub use looks::ImageLooks;
pub use metrics::{JsonLines, MetricSink, Part, Record, TensorBoard};
pub(crate) use run::descriptions;
pub use run::{Imported, Origin, RUN_VERSION, RunConfig, TrainedModel, Which, step_of};
pub use scale::Scale;
pub use session::{NewRun, PreparedRun, Training};
pub use settings::FitSettings;
pub(crate) use sums::{Sums, values};
