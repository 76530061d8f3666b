//! Recording into a folder. After a kill at any moment, every committed episode is there: its
//! values and images are written first, its record in the index last, and the index alone tells which episodes exist.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crc32fast::Hasher;
use rayon::prelude::*;
use swm_core::{Batch, Dtype, Field, Schema, Slice};
use swm_files::is_plain_name;

use super::image_writer::ImageWriter;
use super::images::Store;
use super::layout::{self, EP_LEN, EP_OFFSET, Entry, IndexWriter, Manifest};
use super::reader::{FolderDataset, Known};
use crate::dataset::{Dataset, WriteOptions};
use crate::error::{At as _, DataError, Result, wrong_type};
use crate::formats::npz::GrowingArray;
use crate::recording::{self, Backend, EP_IDX, Existing, Session, SessionStart, StepIndex, check_fit};

/// How folders are recorded.
pub(super) struct FolderBackend {
    pub(super) format: &'static str,
    pub(super) store: Store,
}

/// The files of a folder that is being recorded.
pub(super) struct FolderSession {
    columns: Vec<Target>,
    ep_len: GrowingArray,
    ep_offset: GrowingArray,
    index: IndexWriter,
    /// The file of the description.
    manifest: PathBuf,
    /// Rows of all committed episodes.
    rows: usize,
}

/// One column of the manifest.
struct Target {
    field: Field,
    /// Its position in the schema; `None` for `ep_idx`, which is filled here.
    source: Option<usize>,
    files: Files,
}

enum Files {
    /// With the checksum of the open episode's values.
    Array(Box<GrowingArray>, Hasher),
    Images(Box<ImageWriter>),
}

impl Backend for FolderBackend {
    type Session = FolderSession;

    fn name(&self) -> &'static str {
        self.format
    }

    fn is_folder(&self) -> bool {
        true
    }

    fn is_new(&self, path: &Path) -> Result<bool, DataError> {
        if !path.exists() || layout::is_unbegun(path) {
            return Ok(true);
        }
        let mut entries = fs::read_dir(path).map_err(|source| DataError::io(path, "open", source))?;
        Ok(entries.next().is_none())
    }

    fn is_dataset(&self, path: &Path) -> bool {
        super::is_dataset(path) && super::has_videos(path) != (self.store == Store::Jpeg)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        Ok(Box::new(FolderDataset::open(path, self.format, self.store)?))
    }

    fn refuses(&self, name: &str) -> Option<&'static str> {
        if name.split('.').next().is_some_and(|start| [EP_LEN, EP_OFFSET].contains(&start)) {
            return Some("the name is reserved for the index of episodes");
        }
        (!is_plain_name(name)).then_some("no empty name, no `/`, `\\` or `:`")
    }

    fn remove(&self, path: &Path) -> Result<(), DataError> {
        let dataset = FolderDataset::open(path, self.format, self.store)?;
        let names: Vec<String> = dataset.schema().fields().iter().map(|field| field.name.clone()).collect();
        drop(dataset);
        layout::clear(path, &names)
    }

    fn start(&self, start: &SessionStart<'_>) -> Result<FolderSession, DataError> {
        let &SessionStart { path, fields, metadata, .. } = start;
        let mut columns = fields.to_vec();
        columns.push(Field::step(EP_IDX, Dtype::I32, &[]));
        let mut manifest = Manifest::new(self.format, columns);
        let mut known = Known::default();
        if start.existing == Existing::Continued {
            let old = FolderDataset::open(path, self.format, self.store)?;
            let there = old.manifest().ok_or_else(|| recording::foreign(path))?;
            let stored: Vec<Field> =
                there.columns.iter().filter(|field| field.name != EP_IDX).cloned().collect();
            let first = there.runs.first().map_or(metadata, |(_, first)| first);
            check_fit(path, &stored, first, fields, metadata)?;
            manifest = there.clone();
            known = old.known();
        } else if start.existing == Existing::Replaced {
            self.remove(path)?;
        }
        fs::create_dir_all(path).map_err(|source| DataError::io(path, "create", source))?;
        let runs = recording::with_run(&manifest.runs, start.episodes, metadata);
        let changed = runs != manifest.runs;
        manifest.runs = runs;
        let recording =
            FolderSession::open(path, self.store, &manifest, start.schema, &known, start.options)?;
        // Last: with it, the folder is a dataset.
        if changed {
            manifest.write(path)?;
        }
        Ok(recording)
    }
}

impl Session for FolderSession {
    fn append(&mut self, at: StepIndex, batch: &Batch) -> Result<()> {
        let ep_idx = vec![at.episode; batch.rows()];
        // Compression is most of the work, and columns do not know of each other.
        self.columns.par_iter_mut().try_for_each(|target| {
            let values = target.source.map_or(Slice::I32(&ep_idx), |column| batch.column(column));
            let written = match (&mut target.files, values) {
                (Files::Array(array, checksum), values) => {
                    array.append(batch.rows(), values).map(|more| checksum.combine(&more))
                }
                (Files::Images(images), Slice::U8(pixels)) => images.append(at, pixels),
                (Files::Images(_), values) => {
                    Err(wrong_type(format!("images cannot hold {}", values.dtype())))
                }
            };
            written.at(format_args!("column `{}`", target.field.name))
        })
    }

    /// Columns, the reference's index, ours.
    fn commit(&mut self, end: StepIndex) -> Result<()> {
        let finish = |target: &mut Target| match &mut target.files {
            Files::Array(_, checksum) => Ok(std::mem::take(checksum).finalize()),
            Files::Images(images) => images.finish().at(format_args!("column `{}`", target.field.name)),
        };
        let checksums = self.columns.iter_mut().map(finish).collect::<Result<_>>()?;
        self.ep_offset.append(1, Slice::I64(&[self.rows as i64]))?;
        self.ep_len.append(1, Slice::I32(&[end.step as i32]))?;
        self.index.push(&Entry { rows: end.step as u32, checksums })?;
        self.rows += end.step;
        Ok(())
    }

    /// Columns, the reference's index, ours, as they were committed.
    fn sync(&mut self) -> Result<()> {
        for target in &mut self.columns {
            match &mut target.files {
                Files::Array(array, _) => array.sync(),
                Files::Images(images) => images.sync(),
            }
            .at(format_args!("column `{}`", target.field.name))?;
        }
        self.ep_offset.sync()?;
        self.ep_len.sync()?;
        self.index.sync()?;
        Ok(swm_files::sync(std::slice::from_ref(&self.manifest))?)
    }

    fn close(self) -> Result<()> {
        Ok(())
    }
}

impl FolderSession {
    /// Opens the files of a folder with the episodes that are known; their records are restored where the index lacks
    /// them, and what lies behind them is removed.
    pub(super) fn open(
        path: &Path,
        store: Store,
        manifest: &Manifest,
        schema: &Arc<Schema>,
        Known { entries, indexed }: &Known,
        options: &WriteOptions,
    ) -> Result<Self, DataError> {
        let episodes = entries.len();
        let rows = entries.iter().map(|entry| entry.rows as usize).sum();
        let mut index = IndexWriter::open(path, manifest.columns.len(), *indexed)?;
        for entry in &entries[*indexed..] {
            index.push(entry).map_err(|error| DataError::record(path, error))?;
        }
        let array = |field: &Field, rows: usize| {
            let file = layout::array(path, &field.name);
            match rows {
                0 => GrowingArray::create(&file, field).map_err(|error| DataError::record(&file, error)),
                rows => GrowingArray::reopen(&file, field, rows)
                    .and_then(|mut array| array.finish_rows(0).map(|()| array))
                    .map_err(|error| DataError::damaged(&file, error)),
            }
        };
        let mut columns = Vec::new();
        for field in &manifest.columns {
            let files = if store.takes(field) {
                let folder = path.join(&field.name);
                let made = fs::create_dir_all(&folder).and_then(|()| store.forget(&folder, episodes as u64));
                made.map_err(|source| DataError::io(&folder, "create", source))?;
                Files::Images(Box::new(ImageWriter::new(store, folder, field, options)))
            } else {
                Files::Array(Box::new(array(field, rows)?), Hasher::new())
            };
            let source = if field.name == EP_IDX { None } else { schema.index(&field.name) };
            columns.push(Target { field: field.clone(), source, files });
        }
        let mut ep_len = array(&Field::step(EP_LEN, Dtype::I32, &[]), 0)?;
        let mut ep_offset = array(&Field::step(EP_OFFSET, Dtype::I64, &[]), 0)?;
        let lengths: Vec<i32> = entries.iter().map(|entry| entry.rows as i32).collect();
        let offsets: Vec<i64> = entries
            .iter()
            .scan(0, |first, entry| {
                let offset = *first;
                *first += i64::from(entry.rows);
                Some(offset)
            })
            .collect();
        let failed = |error| DataError::record(path, error);
        ep_len.append(episodes, Slice::I32(&lengths)).map_err(failed)?;
        ep_offset.append(episodes, Slice::I64(&offsets)).map_err(failed)?;
        Ok(Self { columns, ep_len, ep_offset, index, manifest: path.join(layout::MANIFEST), rows })
    }
}
