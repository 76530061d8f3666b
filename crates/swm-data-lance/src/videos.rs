//! The table of videos beside a table of rows, `name_videos.lance`: a row per episode and column of images, with the
//! bytes of an MP4 file as a blob, which is read only where it is asked for.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::Int32Type;
use arrow_array::{Array, ArrayRef, Int32Array, LargeBinaryArray, StringArray};
use arrow_schema::{DataType, Field as ArrowField, Schema as ArrowSchema};
use lance_core::datatypes::Schema;

use crate::arrays::file;
use crate::committed::{self, file_name};
use crate::data_file::{DataReader, DataWriter, Rows};
use crate::manifest::EPISODE;
use crate::table::Table;
use swm_data::error::{FormatError, Result, invalid, missing};

/// The column that a video shows.
const KEY: &str = "video_key";
const BYTES: &str = "video_bytes";
/// What marks blobs, in Lance.
const BLOB: &str = "lance-encoding:blob";

/// The folder of the videos of a table.
pub(crate) fn folder(table: &Path) -> PathBuf {
    let extension = table.extension().unwrap_or_default().to_string_lossy();
    let name = table.file_stem().unwrap_or_default().to_string_lossy();
    let dot = if extension.is_empty() { "" } else { "." };
    table.with_file_name(format!("{name}_videos{dot}{extension}"))
}

/// The columns of such a table.
pub(crate) fn schema() -> Result<Schema> {
    let marked = HashMap::from([(BLOB.to_owned(), "true".to_owned())]);
    let fields = vec![
        ArrowField::new(EPISODE, DataType::Int32, true),
        ArrowField::new(KEY, DataType::Utf8, true),
        ArrowField::new(BYTES, DataType::LargeBinary, true).with_metadata(marked),
    ];
    Schema::try_from(&ArrowSchema::new(fields)).map_err(FormatError::other)
}

/// Appends the videos of an episode, by column.
pub(crate) fn append(table: &mut Table, episode: i32, videos: &[(String, Vec<u8>)]) -> Result<()> {
    let mut file = DataWriter::create(table, &file_name(episode as usize))?;
    let columns: Vec<ArrayRef> = vec![
        Arc::new(Int32Array::from(vec![episode; videos.len()])),
        Arc::new(StringArray::from_iter_values(videos.iter().map(|(key, _)| key))),
        Arc::new(LargeBinaryArray::from_iter_values(videos.iter().map(|(_, bytes)| bytes))),
    ];
    file.append(columns)?;
    let fragment = file.finish(table, &[])?;
    table.commit(fragment)
}

/// Videos that are read.
#[derive(Debug)]
pub(crate) struct Videos {
    reader: DataReader,
    bytes: i32,
    /// By episode and column: the row.
    rows: BTreeMap<(i32, String), usize>,
}

impl Videos {
    pub(crate) fn open(folder: &Path) -> Result<Self> {
        let reader = DataReader::new(committed::open(folder)?)?;
        let id = |name: &str, fits: fn(&DataType) -> bool| {
            let field = reader.table().schema().field(name).filter(|field| fits(&field.data_type()));
            field
                .map(|field| field.id)
                .ok_or_else(|| invalid(format!("its videos have no usable column `{name}`")))
        };
        let episodes = id(EPISODE, |stored| *stored == DataType::Int32)?;
        let keys = id(KEY, |stored| *stored == DataType::Utf8)?;
        let bytes = id(BYTES, |stored| matches!(stored, DataType::Binary | DataType::LargeBinary))?;
        let episodes: Vec<i32> = reader
            .read_all(episodes)?
            .iter()
            .flat_map(|array| array.as_primitive::<Int32Type>().values().to_vec())
            .collect();
        let keys = reader.read_all(keys)?;
        let keys =
            keys.iter().flat_map(|array| array.as_string::<i32>().iter().map(Option::unwrap_or_default));
        let rows = episodes.into_iter().zip(keys.map(str::to_owned)).enumerate();
        let rows = rows.map(|(row, place)| (place, row)).collect();
        Ok(Self { reader, bytes, rows })
    }

    /// The columns that have videos.
    pub(crate) fn keys(&self) -> Vec<String> {
        let mut keys: Vec<String> = self.rows.keys().map(|(_, key)| key.clone()).collect();
        keys.sort();
        keys.dedup();
        keys
    }

    /// The video of an episode.
    pub(crate) fn read(&self, episode: i32, key: &str) -> Result<Vec<u8>> {
        let row = self.rows.get(&(episode, key.to_owned()));
        let &row = row.ok_or_else(|| missing(format!("episode {episode} has no video of `{key}`")))?;
        let mut video = Vec::new();
        self.reader.read(self.bytes, Rows { first: row, count: 1, stride: 1 }, &mut |array| {
            video = file(array.as_ref() as &dyn Array, 0)?.to_vec();
            Ok(())
        })?;
        Ok(video)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn videos_lie_beside_their_table() {
        assert_eq!(folder(Path::new("a/pusht.lance")), Path::new("a/pusht_videos.lance"));
        assert_eq!(folder(Path::new("pusht.lance-video")), Path::new("pusht_videos.lance-video"));
    }
}
