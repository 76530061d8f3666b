//! What a folder of ours states beyond LeRobot: `meta/swm.json`, the columns as they were recorded and the runs
//! that recorded them; and which feature of LeRobot a column becomes.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use swm_core::{Dtype, Field, Metadata};
use swm_data::error::{At as _, DataError, Result, invalid, unsupported};
use swm_data::recording::replace_json;
use swm_files::{is_plain_name, read_regular};
use swm_media::mp4;

/// Where it lies.
const MANIFEST: &str = "meta/swm.json";
const VERSION: u32 = 1;
/// Above this size it is taken for damage.
const MAX_BYTES: u64 = 64 << 20;
/// A row above this size is taken for damage.
const MAX_ROW_BYTES: usize = 1 << 30;

/// What names of cameras begin with.
const CAMERA: &str = "observation.images.";

/// The columns that every LeRobot table has, and that the writer fills itself.
pub(super) const OWN: [(&str, Dtype); 5] = [
    ("timestamp", Dtype::F32),
    ("frame_index", Dtype::I64),
    ("episode_index", Dtype::I64),
    ("index", Dtype::I64),
    ("task_index", Dtype::I64),
];

/// A rate of rows as LeRobot takes it: a whole number.
pub(super) fn whole(rate: f64) -> f64 {
    rate.round().max(1.0)
}

/// A folder of ours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    version: u32,
    pub(super) frames_per_second: f64,
    /// As recorded, in order, without `ep_idx`.
    pub(super) columns: Vec<Field>,
    /// Metadata of each run, with the first episode that it recorded; in that order.
    pub(super) runs: Vec<(u64, Metadata)>,
    /// Whether the column `task` is LeRobot's: texts in the list of tasks, and their numbers in the tables.
    #[serde(default, skip_serializing_if = "is_false")]
    pub(super) has_tasks: bool,
    /// Whether last rows without an action are beside the tables; see `last_row`.
    #[serde(default, skip_serializing_if = "is_false")]
    pub(super) drops_last_row: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_false(value: &bool) -> bool {
    !value
}

/// The column of the text of the task.
pub(super) const TASK: &str = "task";
/// The column without which there is no last row to leave out.
pub(super) const ACTION: &str = "action";

impl Manifest {
    pub(super) fn new(columns: Vec<Field>, frames_per_second: f64, drops_last_row: bool) -> Self {
        let is_task = |field: &Field| field.name == TASK && field.dtype == Dtype::Str && field.dim() == 1;
        let has_tasks = columns.iter().any(is_task);
        let has_action = columns.iter().any(|field| field.name == ACTION);
        let drops_last_row = drops_last_row && has_action;
        Self { version: VERSION, frames_per_second, columns, runs: Vec::new(), has_tasks, drops_last_row }
    }

    /// Whether a column is LeRobot's column of tasks, and none of the tables.
    pub(super) fn is_task(&self, column: &str) -> bool {
        self.has_tasks && column == TASK
    }

    /// Reads it; `None` in folders of other programs.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        let bytes = match fs::metadata(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Ok(metadata) if metadata.len() > MAX_BYTES => {
                return Err(invalid(format!("`{MANIFEST}` has {} bytes", metadata.len())));
            }
            _ => read_regular(&path)?,
        };
        let manifest: Self = serde_json::from_slice(&bytes).at(format_args!("`{MANIFEST}`"))?;
        if manifest.version != VERSION {
            let other = format!("its version is {}, this program knows {VERSION}", manifest.version);
            return Err(unsupported(other).at(format_args!("`{MANIFEST}`")));
        }
        for Field { name, shape, .. } in &manifest.columns {
            let bytes = shape.iter().try_fold(8usize, |bytes, &size| bytes.checked_mul(size));
            if !is_plain_name(name) || bytes.is_none_or(|bytes| bytes == 0 || bytes > MAX_ROW_BYTES) {
                return Err(invalid(format!("`{MANIFEST}`: column `{name}` of the shape {shape:?}")));
            }
        }
        Ok(Some(manifest))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), DataError> {
        replace_json(&folder.join(MANIFEST), self)
    }

    /// The columns that are videos, with the names of their features.
    pub(super) fn cameras(&self) -> impl Iterator<Item = (&Field, String)> {
        self.columns.iter().filter(|field| is_video(field)).map(|field| (field, self.feature(&field.name)))
    }

    /// The name of a column's feature. Policies of LeRobot look for `observation.state`, `observation.images.…` and `action`.
    pub(super) fn feature(&self, column: &str) -> String {
        let has = |name: &str| self.columns.iter().any(|field| field.name == name);
        let is_state = column == "proprio" || column == "state" && !has("proprio");
        match self.columns.iter().find(|field| field.name == column) {
            Some(field) if is_video(field) && !column.starts_with(CAMERA) => format!("{CAMERA}{column}"),
            Some(field) if is_state && field.dtype != Dtype::Str && !has("observation.state") => {
                "observation.state".to_owned()
            }
            _ => column.to_owned(),
        }
    }
}

/// Whether a column becomes videos: videos have even sides and three colors. Other images become lists of numbers.
pub(super) fn is_video(field: &Field) -> bool {
    let (Dtype::U8, &[height, width, 3]) = (field.dtype, &field.shape[..]) else { return false };
    let fits = |side: usize| side.is_multiple_of(2) && (mp4::SIDES[0]..=mp4::SIDES[1]).contains(&side);
    fits(height) && fits(width)
}

/// Whether a column is one that LeRobot prescribes, whose values follow from the place of the row.
pub(super) fn is_own(name: &str) -> bool {
    OWN.iter().any(|(own, _)| *own == name)
}
