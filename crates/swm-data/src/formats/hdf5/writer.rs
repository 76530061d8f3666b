//! Recording. After a kill at any moment, every episode that was committed is in the file: its columns
//! reach the disk first, then the episode's offset, then its length, and a reader counts an episode only when it has
//! both. (Against the end of the process, that is; the loss of power is the file system's affair.)

use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Batch, Field, Metadata, Schema, Slice};

use super::FORMAT;
use super::create::{self, EndOfData};
use super::encoding::{Encoder, LastRow, StoredForm};
use super::handles::{Handles, library_error};
use super::layout::{EP_LEN, EP_OFFSET};
use super::library;
use super::reader::Hdf5Dataset;
use crate::dataset::{Dataset, EncodedBatch, EncodedRows, RowEncoder};
use crate::error::{At as _, DataError, FormatError, Result, unsupported};
use crate::recording::{self, Backend, EP_IDX, Existing, Session, SessionStart, StepIndex};

/// How files of HDF5 are recorded.
pub(super) struct Hdf5Backend;

/// A file that is being recorded.
#[derive(Debug)]
pub(super) struct Hdf5Session {
    handles: Handles,
    path: PathBuf,
    schema: Arc<Schema>,
    /// The columns that are given (all but `ep_idx`), in the order of their datasets.
    given: Vec<Given>,
    /// Rows of all committed episodes.
    rows: usize,
    ep_idx: Vec<i32>,
}

/// A column that is given.
#[derive(Debug)]
struct Given {
    /// Its position in the schema.
    column: usize,
    /// Of its rows, if they are stored each on its own.
    encoder: Option<Encoder>,
    /// The last row that is to be written as it is stored.
    last: LastRow,
}

impl Backend for Hdf5Backend {
    type Session = Hdf5Session;

    fn name(&self) -> &'static str {
        FORMAT.name
    }

    fn is_folder(&self) -> bool {
        false
    }

    fn is_dataset(&self, path: &Path) -> bool {
        FORMAT.detect(path)
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        Ok(Box::new(Hdf5Dataset::open_locked(path)?))
    }

    fn refuses(&self, name: &str) -> Option<&'static str> {
        match name {
            EP_LEN | EP_OFFSET => Some("the name is reserved for the index of episodes"),
            "" | "." => Some("no empty name, not `.`"),
            name if name.contains(['/', '\0']) => Some("no empty name, no `/`"),
            _ => None,
        }
    }

    fn remove(&self, path: &Path) -> Result<(), DataError> {
        recording::remove_file(path)
    }

    fn start(&self, start: &SessionStart<'_>) -> Result<Hdf5Session, DataError> {
        let &SessionStart { path, schema, fields, metadata, .. } = start;
        let (handles, rows) = match start.existing {
            Existing::None | Existing::Replaced => (create::create(path, fields, metadata)?, 0),
            Existing::Continued => {
                // Closed again before the library opens the file for writing.
                let end = {
                    let old = Hdf5Dataset::open_locked(path)?;
                    check_old(path, &old, fields, metadata)?;
                    EndOfData {
                        episodes: old.num_episodes(),
                        rows: old.total_rows(),
                        chunks_end: old.chunks_end(),
                        attributes: old.attributes().clone(),
                    }
                };
                (create::reopen(path, fields, &end, metadata)?, end.rows)
            }
        };
        let given = (0..schema.fields().len()).filter(|&index| schema.fields()[index].name != EP_IDX);
        let given = given.zip(&handles.columns).map(|(column, dataset)| {
            let form = StoredForm::of(dataset, &schema.fields()[column]).map_err(library_error)?;
            Ok(Given { column, encoder: form.map(Encoder::new), last: LastRow::default() })
        });
        let given = given.collect::<Result<_>>().map_err(|error| DataError::record(path, error))?;
        Ok(Hdf5Session {
            handles,
            path: path.to_owned(),
            schema: schema.clone(),
            given,
            rows,
            ep_idx: Vec::new(),
        })
    }
}

impl Session for Hdf5Session {
    fn append(&mut self, at: StepIndex, batch: &Batch) -> Result<()> {
        self.append_columns(at, batch, &[])
    }

    fn encoding(&self, column: usize) -> Option<&str> {
        Some(&self.form(column)?.name)
    }

    fn row_encoder(&self, column: usize) -> Option<Box<dyn RowEncoder>> {
        Some(Box::new(Encoder::new(self.form(column)?.clone())))
    }

    fn append_encoded(&mut self, at: StepIndex, rows: &EncodedBatch) -> Result<()> {
        self.append_columns(at, &rows.plain, &rows.encoded)
    }

    /// Columns, then offset, then length, each on its way to the disk before the next.
    fn commit(&mut self, end: StepIndex) -> Result<()> {
        let Handles { file, columns, ep_len, ep_offset, .. } = &self.handles;
        for (dataset, Given { column, last, .. }) in columns.iter().zip(&mut self.given) {
            let field = &self.schema.fields()[*column];
            last.hand_over(dataset, field).at(format_args!("column `{}`", field.name))?;
        }
        let flush = || file.flush().map_err(library_error);
        flush()?;
        append(ep_offset, end.episode as usize, Slice::I64(&[self.rows as i64]))?;
        flush()?;
        append(ep_len, end.episode as usize, Slice::I32(&[end.step as i32]))?;
        flush()?;
        self.rows += end.step;
        Ok(())
    }

    fn sync(&mut self) -> Result<()> {
        Ok(swm_files::sync(std::slice::from_ref(&self.path))?)
    }

    fn close(self) -> Result<()> {
        self.handles.close()?;
        Ok(swm_files::sync(&[self.path])?)
    }

    /// Cuts the open episode off: an abandoned file stays open until the process ends.
    fn cancel(self) {
        let Handles { columns, ep_idx, .. } = &self.handles;
        let cut = columns.iter().chain([ep_idx]).try_for_each(|dataset| create::set_rows(dataset, self.rows));
        match cut {
            Ok(()) => drop(self.handles.close()),
            Err(_) => self.handles.abandon(),
        }
    }

    fn abandon(self) {
        self.handles.abandon();
    }
}

impl Hdf5Session {
    /// How a column is stored, by its position in the schema, if each of its rows is stored on its own.
    fn form(&self, column: usize) -> Option<&StoredForm> {
        let given = self.given.iter().find(|given| given.column == column)?;
        Some(&given.encoder.as_ref()?.form)
    }

    /// Appends rows of all columns, of which `encoded` has some as they are stored, and `batch` the others.
    fn append_columns(
        &mut self,
        at: StepIndex,
        batch: &Batch,
        encoded: &[(usize, EncodedRows)],
    ) -> Result<()> {
        let first = self.rows + at.step;
        let end = first + batch.rows();
        for (dataset, given) in self.handles.columns.iter().zip(&mut self.given) {
            let Given { column, encoder, last } = given;
            let field = &self.schema.fields()[*column];
            let encoded = encoded.iter().find(|(encoded, _)| encoded == column);
            let write = || {
                create::set_rows(dataset, end).map_err(library_error)?;
                match (encoded, &encoder) {
                    (Some((_, rows)), Some(_)) => last.append(dataset, first, rows),
                    (Some(_), None) => Err(unsupported("its rows are not stored each on its own")),
                    (None, _) => {
                        let values = batch.schema().require(&field.name).map_err(FormatError::other)?;
                        match (encoder, batch.column(values)) {
                            (Some(encoder), Slice::U8(rows)) => {
                                encoder.append(dataset, first, rows, field.dim(), last)
                            }
                            (_, values) => library::write(dataset, field, first, batch.rows(), values),
                        }
                    }
                }
            };
            write().at(format_args!("column `{}`", field.name))?;
        }
        self.ep_idx.clear();
        self.ep_idx.resize(batch.rows(), at.episode);
        append(&self.handles.ep_idx, first, Slice::I32(&self.ep_idx))
    }
}

/// Appends scalars to a dataset that has `first` of them.
fn append(dataset: &hdf5_metno::Dataset, first: usize, values: Slice<'_>) -> Result<()> {
    let field = Field::step("", values.dtype(), &[]);
    create::set_rows(dataset, first + values.len()).map_err(library_error)?;
    library::write(dataset, &field, first, values.len(), values)
}

/// Whether episodes with these columns and settings continue `old`.
fn check_old(path: &Path, old: &Hdf5Dataset, fields: &[Field], metadata: &Metadata) -> Result<(), DataError> {
    let (columns, first) = old.ours().ok_or_else(|| recording::foreign(path))?;
    recording::check_fit(path, columns, first, fields, metadata)
}
