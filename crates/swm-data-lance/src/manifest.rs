//! What a table of ours states beyond Lance, under one key of its metadata: the columns as they were recorded and
//! the runs that recorded them; and what a column is called in the table.

use std::collections::HashMap;

use arrow_schema::{DataType, Field as ArrowField, Schema as ArrowSchema};
use lance_core::datatypes::Schema;
use serde::{Deserialize, Serialize};
use swm_core::{Field, Metadata};
use swm_data::error::{At as _, FormatError, Result, invalid, unsupported};
use swm_data::video;

use crate::arrays::stored_type;

/// The key.
const KEY: &str = "swm";
const VERSION: u32 = 1;
/// A row above this size is taken for damage.
const MAX_ROW_BYTES: usize = 1 << 30;

/// The episode of a row, in the reference's tables.
pub(crate) const EPISODE: &str = "episode_idx";
/// Its row in the episode.
pub(crate) const STEP: &str = "step_idx";

/// A table of ours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Manifest {
    version: u32,
    /// Of videos.
    pub(crate) frames_per_second: f64,
    /// As recorded, in order, without `ep_idx`.
    pub(crate) columns: Vec<Field>,
    /// Metadata of each run, with the first episode that it recorded; in that order.
    pub(crate) runs: Vec<(u64, Metadata)>,
}

impl Manifest {
    pub(crate) fn new(columns: Vec<Field>, frames_per_second: f64) -> Self {
        Self { version: VERSION, frames_per_second, columns, runs: Vec::new() }
    }

    /// Reads it; `None` in tables of other programs.
    pub(crate) fn read(about: &HashMap<String, String>) -> Result<Option<Self>> {
        let Some(text) = about.get(KEY) else { return Ok(None) };
        let manifest: Self = serde_json::from_str(text).at("its record")?;
        if manifest.version != VERSION {
            return Err(unsupported(format!(
                "its record has version {}, this program knows {VERSION}",
                manifest.version
            )));
        }
        for Field { name, shape, .. } in &manifest.columns {
            let bytes = shape.iter().try_fold(8usize, |bytes, &size| bytes.checked_mul(size));
            if bytes.is_none_or(|bytes| bytes == 0 || bytes > MAX_ROW_BYTES) {
                return Err(invalid(format!("a row of column `{name}` has the shape {shape:?}")));
            }
        }
        Ok(Some(manifest))
    }

    /// As metadata of the table.
    pub(crate) fn about(&self) -> Result<HashMap<String, String>> {
        let text = serde_json::to_string(self)?;
        Ok(HashMap::from([(KEY.to_owned(), text)]))
    }

    /// What the columns are called in the table. Dots mean something else there; what would be called alike gets a line.
    pub(crate) fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for field in &self.columns {
            let mut name = field.name.replace('.', "_");
            while [EPISODE, STEP].contains(&name.as_str()) || names.contains(&name) {
                name.push('_');
            }
            names.push(name);
        }
        names
    }

    /// The columns of the table; those that are `videos` are not in it.
    pub(crate) fn schema(&self, videos: bool) -> Result<Schema> {
        let mut fields = vec![
            ArrowField::new(EPISODE, DataType::Int32, true),
            ArrowField::new(STEP, DataType::Int32, true),
        ];
        for (field, name) in self.columns.iter().zip(self.names()) {
            if !(videos && video::takes(field)) {
                fields.push(ArrowField::new(name, stored_type(field), true));
            }
        }
        Schema::try_from(&ArrowSchema::new(fields)).map_err(FormatError::other)
    }
}

#[cfg(test)]
mod tests {
    use swm_core::Dtype;

    use super::*;

    #[test]
    fn names_are_distinct_and_without_dots() {
        let fields = ["a.b", "a_b", "step_idx", "episode_idx", "pixels"]
            .map(|name| Field::step(name, Dtype::F64, &[2]));
        let manifest = Manifest::new(fields.to_vec(), 25.0);
        assert_eq!(manifest.names(), ["a_b", "a_b_", "step_idx_", "episode_idx_", "pixels"]);
        let about = manifest.about().unwrap();
        assert_eq!(Manifest::read(&about).unwrap().unwrap(), manifest);
    }
}
