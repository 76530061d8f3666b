//! Recording into a table: a file of rows per episode. After a kill at any moment, every committed episode is there: its
//! videos are in their table first, then its rows in a file, which commits it (see `committed`).

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{ArrayRef, Int32Array};
use crc32fast::Hasher;
use rayon::prelude::*;
use swm_core::{Batch, Field, Schema, Slice};
use swm_data::error::{At as _, FormatError, Result, invalid, missing, wrong_type};
use swm_data::recording::{self, Backend, Existing, Session, SessionStart, StepIndex};
use swm_data::video::{FRAMES_PER_SECOND, VideoWriter, encoding, takes};
use swm_data::{DataError, Dataset};
use swm_files::WriterLock;
use swm_media::jpeg;
use swm_media::mp4::Mp4Options;

use crate::arrays::{files_to_array, is_image, sum_up, to_array};
use crate::committed::{self, file_name};
use crate::data_file::DataWriter;
use crate::manifest::Manifest;
use crate::reader::{CHECKSUMS, LanceDataset};
use crate::table::{DATA, Table};
use crate::videos;

/// The name of the format with images in the rows.
pub(crate) const IMAGES: &str = "lance";
/// The name of the format with videos beside the rows.
pub(crate) const VIDEOS: &str = "lance-video";
/// Quality of JPEG files if none is asked for.
const JPEG_QUALITY: u8 = 95;

/// How tables are recorded.
pub(crate) struct LanceBackend {
    pub(crate) has_videos: bool,
}

/// A table that is being recorded.
pub(crate) struct LanceSession {
    table: Table,
    /// The table of videos, if images are.
    videos: Option<Table>,
    schema: Arc<Schema>,
    manifest: Manifest,
    quality: u8,
    encoding: Mp4Options,
    open: Option<OpenEpisode>,
}

/// The files of the episode that has not ended.
struct OpenEpisode {
    rows: DataWriter,
    /// By column of the table, without the two that say where a row belongs.
    checksums: Vec<Hasher>,
    videos: Vec<(Field, VideoWriter)>,
    /// By column of images: the last one and its file, which an equal one has too.
    last: HashMap<String, (Vec<u8>, Arc<[u8]>)>,
}

impl Backend for LanceBackend {
    type Session = LanceSession;

    fn name(&self) -> &'static str {
        if self.has_videos { VIDEOS } else { IMAGES }
    }

    fn is_folder(&self) -> bool {
        true
    }

    /// Also what a recording leaves that was killed before it began.
    fn is_new(&self, path: &Path) -> Result<bool, DataError> {
        if Table::exists(path) {
            return Ok(false);
        }
        let mut entries = fs::read_dir(path).into_iter().flatten().flatten();
        Ok(entries.all(|entry| [DATA, "_versions"].iter().any(|own| entry.file_name() == *own)))
    }

    fn is_dataset(&self, path: &Path) -> bool {
        Table::exists(path)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        Ok(Box::new(LanceDataset::open(path, self.name())?))
    }

    fn refuses(&self, name: &str) -> Option<&'static str> {
        name.is_empty().then_some("no empty name")
    }

    fn remove(&self, path: &Path) -> Result<(), DataError> {
        let beside = videos::folder(path);
        let removed = Table::remove(path).and_then(|()| Table::remove(&beside));
        // Where it holds nothing else.
        let _ = fs::remove_dir(beside);
        removed.map_err(|source| DataError::io(path, "remove", source))
    }

    fn start(&self, start: &SessionStart<'_>) -> Result<LanceSession, DataError> {
        let &SessionStart { path, options, fields, metadata, .. } = start;
        let failed = |source| DataError::io(path, "clear", source);
        let damaged = |error| DataError::damaged(path, error);
        let rate = options.frames_per_second.unwrap_or(FRAMES_PER_SECOND);
        let mut manifest = Manifest::new(fields.to_vec(), rate);
        let beside = videos::folder(path);
        if start.existing == Existing::Replaced {
            Table::remove(path).map_err(failed)?;
        }
        if start.existing != Existing::Continued {
            // Videos without a table are no dataset.
            Table::remove(&beside).map_err(failed)?;
        }
        let table = match start.existing {
            Existing::Continued => {
                if Table::exists(&beside) != self.has_videos {
                    let format = if self.has_videos { IMAGES } else { VIDEOS };
                    let reason = format!("it is of the format `{format}`; add to it in that format");
                    return Err(DataError::mismatch(path, reason));
                }
                let table = committed::open(path).map_err(damaged)?;
                if table.has_deletions() {
                    let reason = "another program has deleted rows of it; continue a copy (`swm convert`)";
                    return Err(DataError::mismatch(path, reason));
                }
                let there = Manifest::read(table.about()).map_err(damaged)?;
                let there = there.ok_or_else(|| recording::foreign(path))?;
                let first = there.runs.first().map_or(metadata, |(_, first)| first);
                recording::check_fit(path, &there.columns, first, fields, metadata)?;
                manifest = there;
                Some(table)
            }
            Existing::None | Existing::Replaced => None,
        };
        manifest.runs = recording::with_run(&manifest.runs, start.episodes, metadata);
        let open = || {
            // Where nothing is recorded, their table stays empty: Lance cannot tell files without rows from unknown ones.
            let recorded = if manifest.columns.iter().any(takes) { start.episodes } else { 0 };
            let videos = self.has_videos.then(|| open_videos(&beside, recorded)).transpose()?;
            let table = match table {
                Some(mut table) => {
                    table.resume(table.fragments().len(), Some(manifest.about()?))?;
                    table
                }
                // Last: with it, the folder is a dataset.
                None => Table::create(path, manifest.schema(self.has_videos)?, manifest.about()?)?,
            };
            forget(&table)?;
            Ok((table, videos))
        };
        let (table, videos) = open().map_err(|error: FormatError| DataError::record(path, error))?;
        let encoding = Mp4Options { frames_per_second: manifest.frames_per_second, ..encoding(options) };
        let quality = options.quality.unwrap_or(JPEG_QUALITY);
        Ok(LanceSession {
            table,
            videos,
            schema: start.schema.clone(),
            manifest,
            quality,
            encoding,
            open: None,
        })
    }
}

/// The table of videos with those of the first episodes, made if it is not there.
fn open_videos(folder: &Path, episodes: u64) -> Result<Table> {
    if !Table::exists(folder) {
        return Table::create(folder, videos::schema()?, HashMap::new());
    }
    let mut table = committed::open(folder)?;
    let (videos, episodes) = (table.fragments().len(), episodes as usize);
    if videos < episodes {
        return Err(invalid(format!("it has videos of {videos} of {episodes} episodes")));
    }
    table.resume(episodes, None)?;
    forget(&table)?;
    Ok(table)
}

/// Removes what an interrupted recording left.
fn forget(table: &Table) -> Result<()> {
    let remove = |file: PathBuf| fs::remove_file(&file).at(file.display());
    table.leftovers().into_iter().try_for_each(remove)
}

impl Session for LanceSession {
    fn append(&mut self, at: StepIndex, batch: &Batch) -> Result<()> {
        let mut open = match self.open.take() {
            Some(open) => open,
            None => self.begin(at.episode)?,
        };
        let (first, rows) = (at.step as i32, batch.rows() as i32);
        let mut arrays: Vec<ArrayRef> = vec![
            Arc::new(Int32Array::from(vec![at.episode; batch.rows()])),
            Arc::new(Int32Array::from_iter_values(first..first + rows)),
        ];
        for field in self.stored() {
            let values = values_of(&self.schema, batch, field)?;
            let array = match values {
                Slice::U8(pixels) if is_image(field) => open.images(field, pixels, self.quality),
                values => to_array(field, values),
            };
            arrays.push(array.at(format_args!("column `{}`", field.name))?);
        }
        open.checksums.iter_mut().zip(&arrays[2..]).for_each(|(checksum, array)| sum_up(checksum, array));
        // Encoding is most of the work, and videos do not know of each other.
        let schema = &self.schema;
        let videos =
            open.videos.par_iter_mut().map(|(field, video)| match values_of(schema, batch, field)? {
                Slice::U8(pixels) => video.append(pixels).at(format_args!("column `{}`", field.name)),
                values => {
                    Err(wrong_type(format!("column `{}`: images cannot hold {}", field.name, values.dtype())))
                }
            });
        videos.collect::<Result<()>>()?;
        open.rows.append(arrays)?;
        self.open = Some(open);
        Ok(())
    }

    fn commit(&mut self, end: StepIndex) -> Result<()> {
        let OpenEpisode { rows, checksums, videos, .. } =
            self.open.take().ok_or(missing("an episode without rows"))?;
        if let Some(table) = self.videos.as_mut().filter(|_| !videos.is_empty()) {
            let finished = videos.into_iter().map(|(field, video)| {
                let bytes = video.finish().at(format_args!("column `{}`", field.name))?;
                Ok((field.name, bytes))
            });
            videos::append(table, end.episode, &finished.collect::<Result<Vec<_>>>()?)?;
        }
        let checksums: Vec<u32> = checksums.into_iter().map(Hasher::finalize).collect();
        let checksums = serde_json::to_string(&checksums)?;
        let fragment = rows.finish(&self.table, &[(CHECKSUMS, checksums)])?;
        self.table.commit(fragment)
    }

    /// Videos first: rows commit an episode.
    fn sync(&mut self) -> Result<()> {
        self.videos.as_mut().map_or(Ok(()), Table::sync)?;
        self.table.sync()
    }

    fn close(mut self) -> Result<()> {
        self.videos.as_mut().map_or(Ok(()), Table::close)?;
        self.table.close()
    }
}

impl LanceSession {
    /// The columns of the table, in its order.
    fn stored(&self) -> impl Iterator<Item = &Field> {
        self.manifest.columns.iter().filter(|field| self.videos.is_none() || !takes(field))
    }

    fn begin(&self, episode: i32) -> Result<OpenEpisode> {
        let videos = self.manifest.columns.iter().filter(|field| self.videos.is_some() && takes(field));
        let videos = videos.map(|field| Ok((field.clone(), VideoWriter::new(field, &self.encoding)?)));
        Ok(OpenEpisode {
            rows: DataWriter::create(&self.table, &file_name(episode as usize))?,
            checksums: self.stored().map(|_| Hasher::new()).collect(),
            videos: videos.collect::<Result<_>>()?,
            last: HashMap::new(),
        })
    }
}

fn values_of<'a>(schema: &Schema, batch: &'a Batch, field: &Field) -> Result<Slice<'a>> {
    let column =
        schema.index(&field.name).ok_or_else(|| missing(format!("column `{}` is missing", field.name)))?;
    Ok(batch.column(column))
}

impl OpenEpisode {
    /// The files of rows of images. Equal ones in a row are encoded once: a goal costs one file's work.
    fn images(&mut self, field: &Field, pixels: &[u8], quality: u8) -> Result<ArrayRef> {
        let &[height, width, channels] = &field.shape[..] else { return Err(wrong_type("no images")) };
        let frames: Vec<&[u8]> = pixels.chunks_exact(field.dim()).collect();
        let last = self.last.get(&field.name);
        let encode = |index: usize| -> Result<Option<Arc<[u8]>>> {
            let same = match index {
                0 => last.is_some_and(|(pixels, _)| pixels == frames[0]),
                index => frames[index] == frames[index - 1],
            };
            if same {
                return Ok(None);
            }
            let file = jpeg::encode(height, width, channels, frames[index], quality);
            Ok(Some(file?.into()))
        };
        let encoded: Vec<Option<Arc<[u8]>>> =
            (0..frames.len()).into_par_iter().map(encode).collect::<Result<_, _>>()?;
        let mut file: Arc<[u8]> = last.map(|(_, file)| file.clone()).unwrap_or_default();
        let files = encoded.into_iter().map(|new| {
            file = new.unwrap_or_else(|| file.clone());
            file.clone()
        });
        let files: Vec<Arc<[u8]>> = files.collect();
        if let Some(frame) = frames.last() {
            self.last.insert(field.name.clone(), (frame.to_vec(), file));
        }
        Ok(files_to_array(files.iter().map(|file| &file[..])))
    }
}

/// Says what is to be done about an interrupted recording; does it if `apply`.
pub(crate) fn repair(path: &Path, format: &'static str, apply: bool) -> Result<Vec<String>, DataError> {
    let _lock = WriterLock::take(path)?;
    let dataset = LanceDataset::open(path, format)?;
    if !dataset.is_ours() {
        return Ok(Vec::new());
    }
    let episodes = dataset.num_episodes();
    drop(dataset);
    let damaged = |error| DataError::damaged(path, error);
    let mut steps = Vec::new();
    // As when they are recorded: videos first.
    for folder in [videos::folder(path), path.to_owned()].into_iter().filter(|folder| Table::exists(folder)) {
        let mut table = committed::open(&folder).map_err(damaged)?;
        if table.is_being_recorded() {
            steps.push(format!("list all {episodes} episodes in a manifest of `{}`", folder.display()));
        }
        // A video may have been committed whose rows were not.
        let extra = table.fragments().len().saturating_sub(episodes);
        let count = table.leftovers().len() + extra;
        if count > 0 {
            steps.push(format!("remove {count} files of an unfinished episode from `{}`", folder.display()));
        }
        if apply && table.is_being_recorded() {
            table.resume(episodes, None).and_then(|()| table.close()).map_err(damaged)?;
        }
        if apply {
            forget(&table).map_err(damaged)?;
        }
    }
    Ok(steps)
}
