//! Opening a table for reading: ours by its description, those of other programs by the types of their columns.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use arrow_array::Array as _;
use arrow_array::cast::AsArray as _;
use arrow_array::types::Int32Type;
use arrow_schema::DataType;
use crc32fast::Hasher;
use swm_core::{Dtype, Field, Schema, SliceMut};
use swm_data::dataset::{CHANGED, DatasetInfo, Origin};
use swm_data::episodes::{Blocks, StepNumbers, TableEpisodes};
use swm_data::error::{At as _, FormatError, Result, invalid, missing, unsupported, wrong_type};
use swm_data::recording::EP_IDX;
use swm_data::video::{self, VideoReader};
use swm_data::{DataError, Dataset, Steps};
use swm_media::jpeg;

use crate::arrays::{file, from_array, infer, stored_type, sum_up};
use crate::committed::{self, is_recorded};
use crate::data_file::{DataReader, Rows};
use crate::manifest::{EPISODE, Manifest, STEP};
use crate::table::Table;
use crate::videos::{self, Videos};

/// The description of a file of ours: the checksums of its columns.
pub(crate) const CHECKSUMS: &str = "swm.crc32";

/// An open table.
#[derive(Debug)]
pub(crate) struct LanceDataset {
    shared: Arc<Shared>,
    /// By column: the video that was read last.
    open: BTreeMap<usize, (usize, VideoReader)>,
}

#[derive(Debug)]
struct Shared {
    info: DatasetInfo,
    columns: Vec<Source>,
    /// Rows of the table.
    episodes: Vec<Range<usize>>,
    /// As the table numbers them.
    numbers: Vec<i32>,
    reader: DataReader,
    videos: Option<Videos>,
    ours: Option<Manifest>,
}

/// Where the values of a column come from.
#[derive(Clone, Debug)]
enum Source {
    /// The field of the table with this id.
    Rows(i32),
    Video(String),
    /// The number of the episode.
    Episode,
}

impl LanceDataset {
    pub(crate) fn open(path: &Path, format: &'static str) -> Result<Self, DataError> {
        let shared = Shared::open(path, format).map_err(|error| DataError::damaged(path, error))?;
        Ok(Self { shared: Arc::new(shared), open: BTreeMap::new() })
    }

    /// Whether this program recorded it.
    pub(crate) fn is_ours(&self) -> bool {
        self.shared.ours.is_some()
    }

    fn video(&mut self, column: usize, episode: usize, key: &str) -> Result<&mut VideoReader> {
        if self.open.get(&column).is_none_or(|(there, _)| *there != episode) {
            self.open.remove(&column);
            let video = self.shared.video(episode, key)?;
            self.open.insert(column, (episode, video));
        }
        self.open.get_mut(&column).map(|(_, video)| video).ok_or(missing("no video"))
    }
}

impl Shared {
    fn open(path: &Path, format: &'static str) -> Result<Self> {
        let table = committed::open(path)?;
        let beside = videos::folder(path);
        let videos = Table::exists(&beside).then(|| Videos::open(&beside)).transpose()?;
        let ours = Manifest::read(table.about())?;
        let reader = DataReader::new(table)?;
        let Found { episodes, numbers, note } = Found::of(&reader, ours.is_some())?;
        if videos.is_some() && (note.is_some() || reader.table().has_deletions()) {
            return Err(unsupported(
                "rows of it are missing, and its videos count the rows that were recorded; write the table anew from its source",
            ));
        }
        let lengths = episodes.iter().map(Range::len).collect();
        let mut info = DatasetInfo::new(path, format, Arc::new(Schema::default()), lengths);
        info.runs = ours.as_ref().map(|ours| ours.runs.clone().into()).unwrap_or_default();
        info.has_checksums = ours.is_some();
        info.notes = note.into_iter().collect();
        let mut shared = Self { info, columns: Vec::new(), episodes, numbers, reader, videos, ours };
        let mut fields = match &shared.ours {
            Some(ours) => shared.own_columns(ours)?,
            None => shared.foreign_columns()?,
        };
        fields.push((Field::step(EP_IDX, Dtype::I32, &[]), Source::Episode));
        let (fields, columns): (Vec<Field>, Vec<Source>) = fields.into_iter().unzip();
        shared.info.schema = Schema::new(fields)?;
        shared.columns = columns;
        Ok(shared)
    }

    fn own_columns(&self, ours: &Manifest) -> Result<Vec<(Field, Source)>> {
        let mut columns = Vec::new();
        for (field, name) in ours.columns.iter().zip(ours.names()) {
            let source = match self.reader.table().schema().field(&name) {
                Some(stored) if stored.data_type() == stored_type(field) => Source::Rows(stored.id),
                Some(stored) => {
                    return Err(wrong_type(format!("its column `{name}` holds {}", stored.data_type())));
                }
                None if self.videos.is_some() && video::takes(field) => Source::Video(field.name.clone()),
                None => return Err(missing(format!("it has no column `{name}`"))),
            };
            columns.push((field.clone(), source));
        }
        Ok(columns)
    }

    fn foreign_columns(&mut self) -> Result<Vec<(Field, Source)>> {
        let (mut columns, mut skipped) = (Vec::new(), Vec::new());
        for stored in &self.reader.table().schema().fields {
            let (name, id) = (stored.name.as_str(), stored.id);
            let found = match stored.data_type() {
                _ if name == EPISODE || name == EP_IDX => continue,
                DataType::Binary | DataType::LargeBinary => {
                    self.image(id).map(|shape| (Dtype::U8, shape.to_vec()))
                }
                stored => infer(&stored),
            };
            match found {
                Ok((dtype, shape)) => columns.push((Field::step(name, dtype, &shape), Source::Rows(id))),
                Err(error) => skipped.push((name.to_owned(), error.to_string())),
            }
        }
        let keys = self.videos.as_ref().map(Videos::keys).unwrap_or_default();
        for key in keys {
            let (height, width) = self.video(0, &key)?.size();
            columns.push((Field::step(&key, Dtype::U8, &[height, width, 3]), Source::Video(key)));
        }
        self.info.skipped = skipped.into();
        Ok(columns)
    }

    /// The shape of the images in a column of files.
    fn image(&self, id: i32) -> Result<[usize; 3]> {
        let mut shape = Err(missing("it is empty"));
        if self.reader.rows() > 0 {
            self.reader.read(id, Rows { first: 0, count: 1, stride: 1 }, &mut |array| {
                shape = file(array, 0).and_then(|file| Ok(jpeg::shape(file)?));
                Ok(())
            })?;
        }
        shape.at("its files are not JPEG")
    }

    fn video(&self, episode: usize, key: &str) -> Result<VideoReader> {
        let videos = self.videos.as_ref().ok_or(missing("there are no videos"))?;
        let &number = self.numbers.get(episode).ok_or(missing("there are no episodes"))?;
        VideoReader::new(videos.read(number, key)?)
    }
}

/// The episodes of a table.
struct Found {
    /// Their rows.
    episodes: Vec<Range<usize>>,
    /// Their numbers in the table.
    numbers: Vec<i32>,
    /// What a user has to know of them.
    note: Option<String>,
}

impl Found {
    fn of(reader: &DataReader, is_ours: bool) -> Result<Self> {
        let table = reader.table();
        // As we recorded it, and nobody has put its files together or deleted rows since.
        if is_ours && is_recorded(table.fragments()) && !table.has_deletions() {
            let numbers = (0..table.fragments().len() as i32).collect();
            return Ok(Self { episodes: reader.fragments().collect(), numbers, note: None });
        }
        let int32 = |name| table.schema().field(name).filter(|field| field.data_type() == DataType::Int32);
        let field = int32(EPISODE).ok_or_else(|| {
            missing(format!("it has no column `{EPISODE}` of int32, which says what an episode is"))
        })?;
        let mut found =
            TableEpisodes::of([EPISODE, STEP], &|take| integers(reader, field.id, EPISODE, take))?;
        let steps = int32(STEP).map(|field| {
            let id = field.id;
            move |take: &mut dyn FnMut(&[i64]) -> Result<()>| integers(reader, id, STEP, take)
        });
        let behind = reader.behind_deleted();
        let counted =
            StepNumbers::of(&found.lengths, behind, steps.as_ref().map(|steps| steps as Blocks<'_>))?;
        let note = found.divide(&counted.gaps);
        let mut first = 0;
        let range = |&length: &usize| {
            first += length;
            first - length..first
        };
        let episodes = found.lengths.iter().map(range).collect();
        let number = |number: i64| i32::try_from(number).map_err(FormatError::other);
        let numbers = found.numbers.into_iter().map(number).collect::<Result<_>>()?;
        Ok(Self { episodes, numbers, note })
    }
}

/// The values of a column of int32, batch by batch.
fn integers(
    reader: &DataReader,
    id: i32,
    name: &str,
    take: &mut dyn FnMut(&[i64]) -> Result<()>,
) -> Result<()> {
    reader.read(id, Rows { first: 0, count: reader.rows(), stride: 1 }, &mut |array| {
        if array.null_count() > 0 {
            return Err(missing(format!("some values of `{name}` are missing")));
        }
        let values = array.as_primitive::<Int32Type>().values();
        take(&values.iter().map(|&value| value.into()).collect::<Vec<i64>>())
    })
}

impl Dataset for LanceDataset {
    fn info(&self) -> &DatasetInfo {
        &self.shared.info
    }

    fn origin(&self) -> Option<Origin> {
        Some(Origin::of(&self.shared.info))
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        if steps.count == 0 {
            return Ok(());
        }
        let shared = self.shared.clone();
        let field = shared.info.field(column);
        let read = match (&shared.columns[column], out) {
            (Source::Episode, SliceMut::I32(out)) => {
                out.fill(episode as i32);
                Ok(())
            }
            (Source::Video(key), SliceMut::U8(out)) => {
                let &[height, width, channels] = &field.shape[..] else { return Ok(()) };
                let video = self.video(column, episode, key);
                video.and_then(|video| video.read([height, width, channels], steps, out))
            }
            (Source::Rows(id), out) => {
                let first = shared.episodes[episode].start + steps.first;
                let rows = Rows { first, count: steps.count, stride: steps.stride };
                let mut rest = Some(out);
                shared.reader.read(*id, rows, &mut |array| {
                    let Some(all) = rest.take().filter(|rest| rest.len() >= array.len() * field.dim()) else {
                        return Err(invalid("more rows than were asked for"));
                    };
                    let (here, after) = all.split_at(array.len() * field.dim());
                    rest = Some(after);
                    from_array(array, field, here)
                })
            }
            _ => Err(wrong_type("it holds another type")),
        };
        read.map_err(|error| shared.info.damaged(column, episode, error))
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(Self { shared: self.shared.clone(), open: BTreeMap::new() })
    }

    fn check_episode(&mut self, episode: usize) -> Result<(), DataError> {
        let shared = self.shared.clone();
        let Some(rows) = shared.episodes.get(episode) else { return Ok(()) };
        let stored = shared.columns.iter().filter_map(|source| match source {
            Source::Rows(id) => Some(*id),
            Source::Video(_) | Source::Episode => None,
        });
        let check = || {
            // Files that another program has put together, or deleted rows of, have other checksums: none.
            let is_own_file = shared.reader.fragments().nth(episode).as_ref() == Some(rows)
                && shared.reader.table().fragments()[episode].deletion_file.is_none();
            let ids: Vec<i32> = stored.collect();
            let (true, Some(&first)) = (is_own_file && self.is_ours(), ids.first()) else { return Ok(()) };
            let about = shared.reader.about(episode, first)?;
            let Some(text) = about.get(CHECKSUMS) else { return Ok(()) };
            let checksums: Vec<u32> = serde_json::from_str(text)?;
            for (&id, expected) in ids.iter().zip(checksums) {
                let mut found = Hasher::new();
                let all = Rows { first: rows.start, count: rows.len(), stride: 1 };
                shared.reader.read(id, all, &mut |array| {
                    sum_up(&mut found, array);
                    Ok(())
                })?;
                if found.finalize() != expected {
                    return Err(invalid(CHANGED));
                }
            }
            Ok(())
        };
        check().map_err(|error: FormatError| shared.info.damaged_episode(episode, error))
    }
}

#[cfg(test)]
mod tests {
    use swm_core::Registry;
    use swm_data::WriteMode;
    use swm_data::testing::{contents_in, episode, record_in, rows_of, schema};

    use super::*;
    use crate::LANCE;

    /// Rows by their numbers, in one list and in one that is so long that it is stored as a bitmap.
    #[test]
    fn deleted_rows_divide_episodes_and_such_a_table_is_not_continued() {
        let registry = Registry::new().with(crate::FORMATS);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.lance");
        record_in(&registry, &path, WriteMode::Error, 0..3).unwrap();
        let mut table = committed::open(&path).unwrap();
        table.delete(0, [0, 3].into_iter()).unwrap();
        table.delete(1, 0..1).unwrap();
        table.delete(2, (0..300).filter(|row| row % 3 == 1)).unwrap();
        // Of 5 rows of episode 0, the rows 1, 2 and 4; of the 300 of episode 2, two of three.
        let mut left = vec![(0, vec![1, 2]), (0, vec![4]), (2, vec![0])];
        left.extend((2_usize..300).step_by(3).map(|row| (2, (row..(row + 2).min(300)).collect())));
        let mut dataset = LanceDataset::open(&path, LANCE.name).unwrap();
        let lengths: Vec<usize> = (0..dataset.num_episodes()).map(|at| dataset.episode_len(at)).collect();
        assert_eq!(lengths, left.iter().map(|(_, rows)| rows.len()).collect::<Vec<_>>());
        assert!(
            dataset.info().notes[0].contains("rows are missing amid its 2 episodes"),
            "{:?}",
            dataset.info().notes
        );
        let column = dataset.schema().index("state").unwrap();
        for (at, (read, (original, rows))) in contents_in(&registry, &path).iter().zip(&left).enumerate() {
            let original = episode(&schema(), *original, rows_of(*original));
            let (read, original) = (read.get::<f64>("state").unwrap(), original.get::<f64>("state").unwrap());
            let expected: Vec<f64> =
                rows.iter().flat_map(|&row: &usize| original[row * 7..][..7].to_vec()).collect();
            assert_eq!(read, expected);
            let mut last = vec![0.0; 7];
            let steps = Steps { first: rows.len() - 1, count: 1, stride: 1 };
            dataset.read_column(column, at, steps, SliceMut::F64(&mut last)).unwrap();
            assert_eq!(last, expected[expected.len() - 7..]);
            dataset.check_episode(at).unwrap();
        }
        let mut writer = LANCE.create(&path, &WriteMode::Append.into()).unwrap();
        let message = writer.begin(&schema(), &swm_data::testing::metadata()).unwrap_err().to_string();
        assert!(message.contains("deleted rows"), "{message}");
    }
}
