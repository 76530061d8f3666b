//! Datasets: recording whole episodes, reading rows of them, and starting episodes from recorded rows. File formats are
//! absent: other crates implement [`EpisodeSink`] and [`Dataset`].

mod encoded;
mod error;
mod metadata;
mod queue;
mod reader;
mod record;
mod restore;
mod sink;

pub use crate::checkpoint::{CHECKPOINT, Checkpoints};
pub use encoded::{EncodedBatch, EncodedRow, EncodedRows, RowEncoder};
pub use error::{DataError, NotBuiltIn};
pub use metadata::{METADATA_VERSION, Metadata, RecordingPart};
pub use reader::{Dataset, DatasetInfo, Origin, Steps};
pub use record::DatasetRecorder;
pub use restore::{read_known, read_step, recorded_goal, recorded_state, whole_episode};
pub use sink::EpisodeSink;
