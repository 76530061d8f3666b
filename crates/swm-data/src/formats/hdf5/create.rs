//! Files open for recording: a new one, or an old one with its rows cut to the finished episodes. Both end up in
//! SWMR mode ("single writer, multiple readers"), in which the library orders its writes so that the file on disk is
//! readable at any moment.

use std::path::Path;
use std::{fs, io};

use hdf5_metno as h5;
use hdf5_metno::file::{FileCloseDegree, LibraryVersion};
use hdf5_metno::filters::BloscShuffle;
use hdf5_metno::types::FixedUnicode;
use hdf5_metno::{Extent, SimpleExtents};
use swm_core::{Dtype, Field, Metadata};
use swm_files::{beside, lacks_locks};

use super::attributes::{self, Attributes, RunChange};
use super::handles::{Handles, library_error};
use super::layout::{MAX_CHUNK_BYTES, TEXT_BYTES, chunking};
use super::superblock;
use crate::error::{DataError, Result};

/// Level of the LZ4 compression, as the reference has it.
const COMPRESSION_LEVEL: u8 = 5;

/// Makes a new file. It gets its name only when it is complete, so that a kill leaves no half-made file there, and
/// an old file of that name stays until then.
pub(super) fn create(path: &Path, fields: &[Field], metadata: &Metadata) -> Result<Handles, DataError> {
    let draft = beside(path, ".new");
    let made = create_draft(&draft, fields, metadata).map_err(|error| DataError::record(path, error));
    let moved = made.and_then(|datasets| {
        fs::rename(&draft, path).map_err(|source| DataError::io(path, "create", source))?;
        Ok(datasets)
    });
    moved.inspect_err(|_| {
        // The error is what matters; a draft that stays is replaced by the next recording.
        let _ = fs::remove_file(&draft);
    })
}

fn create_draft(draft: &Path, fields: &[Field], metadata: &Metadata) -> Result<Handles> {
    // A link of that name is not followed.
    drop(swm_files::new_file(draft)?);
    let mut builder = options(draft);
    // Without times of creation: equal content makes equal files.
    builder.fcpl().obj_track_times(false);
    let file = builder.create(draft).map_err(library_error)?;
    Handles::new(file, fields, new_column)?.prepared(|Handles { file, .. }| {
        attributes::write(file, fields, metadata)?;
        file.start_swmr().map_err(library_error)
    })
}

/// Opens an old file to append to it: repairs it if its writer was killed, and cuts what belongs to no finished
/// episode. The caller holds the writer's lock and has checked that the columns fit.
pub(super) fn reopen(
    path: &Path,
    fields: &[Field],
    end: &EndOfData,
    metadata: &Metadata,
) -> Result<Handles, DataError> {
    let change = RunChange::plan(&end.attributes.runs, end.episodes as u64, metadata);
    if let Some(change) = change {
        change_attributes(path, end.chunks_end, &change)?;
    }
    superblock::repair(path, end.chunks_end)?;
    reopen_repaired(path, fields, end).map_err(|error| DataError::record(path, error))
}

/// Changes attributes in a copy that then takes the file's place: outside SWMR mode, in which attributes cannot be
/// changed, a kill between two writes of the library could cost the file.
fn change_attributes(path: &Path, chunks_end: u64, change: &RunChange<'_>) -> Result<(), DataError> {
    let draft = beside(path, ".new");
    let changed = || -> Result<(), DataError> {
        let copied = swm_files::new_file(&draft).and_then(|mut draft| {
            let mut file = fs::File::open(path)?;
            draft.set_permissions(file.metadata()?.permissions())?;
            io::copy(&mut file, &mut draft).map(drop)
        });
        copied.map_err(|source| DataError::io(&draft, "copy the dataset to", source))?;
        superblock::repair(&draft, chunks_end)?;
        let apply = || -> Result<()> {
            let file = options(&draft).open_rw(&draft).map_err(library_error)?;
            change.apply(&file)?;
            file.close().map_err(library_error)
        };
        apply().map_err(|error| DataError::record(path, error))?;
        fs::rename(&draft, path).map_err(|source| DataError::io(path, "replace", source))
    };
    changed().inspect_err(|_| {
        // The error is what matters; a draft that stays is replaced by the next recording.
        let _ = fs::remove_file(&draft);
    })
}

/// Where the finished part of a file ends.
#[derive(Debug)]
pub(super) struct EndOfData {
    pub(super) episodes: usize,
    pub(super) rows: usize,
    pub(super) chunks_end: u64,
    pub(super) attributes: Attributes,
}

fn reopen_repaired(path: &Path, fields: &[Field], end: &EndOfData) -> Result<Handles> {
    let file = options(path).open_rw(path).map_err(library_error)?;
    let handles = Handles::new(file, fields, |file, field| file.dataset(&field.name))?;
    handles.prepared(|Handles { file, columns, ep_idx, ep_len, ep_offset }| {
        let cut_all = || -> h5::Result<()> {
            file.start_swmr()?;
            for dataset in columns.iter().chain([ep_idx]) {
                cut(dataset, end.rows)?;
            }
            for dataset in [ep_len, ep_offset] {
                cut(dataset, end.episodes)?;
            }
            file.flush()
        };
        cut_all().map_err(library_error)
    })
}

/// Sets the number of rows of a dataset.
pub(super) fn set_rows(dataset: &h5::Dataset, rows: usize) -> h5::Result<()> {
    let mut shape = dataset.shape();
    if let Some(first) = shape.first_mut() {
        *first = rows;
    }
    dataset.resize(shape)
}

fn cut(dataset: &h5::Dataset, rows: usize) -> h5::Result<()> {
    if dataset.shape().first().is_some_and(|&there| there > rows) { set_rows(dataset, rows) } else { Ok(()) }
}

/// Cached chunks of a column: the one that is being filled. The library walks all of them at every commit, so that with
/// its default of 521 an episode would cost more the longer the file is.
const CACHED_CHUNKS: usize = 1;

/// The file format of HDF5 1.10, the first with SWMR: later ones would lock out readers with older libraries.
fn options(path: &Path) -> h5::FileBuilder {
    let mut builder = h5::File::with_options();
    builder
        .fapl()
        .libver_bounds(LibraryVersion::V110, LibraryVersion::V110)
        .fclose_degree(FileCloseDegree::Strong)
        .chunk_cache(CACHED_CHUNKS, MAX_CHUNK_BYTES, 1.0);
    // Where the file system has no locks, the library would refuse the file. The writer's own lock keeps others from it.
    if lacks_locks(path) {
        builder.fapl().file_locking(false);
    }
    builder
}

fn new_column(file: &h5::File, field: &Field) -> h5::Result<h5::Dataset> {
    let (compressed, rows) = chunking(field);
    let extents =
        [Extent::resizable(0)].into_iter().chain(field.shape.iter().map(|&size| Extent::fixed(size)));
    let extents = SimpleExtents::new(extents);
    let chunk: Vec<usize> = [rows].into_iter().chain(field.shape.iter().copied()).collect();
    macro_rules! dataset {
        ($type:ty) => {{
            let mut builder = file.new_dataset::<$type>().shape(extents).chunk(chunk).obj_track_times(false);
            if compressed {
                // A checksum only here: these chunks are written once. Chunks of many rows are written again and again,
                // and a kill between two of their blocks would make the checksum of finished rows wrong.
                builder = builder.blosc_lz4(COMPRESSION_LEVEL, BloscShuffle::Byte).fletcher32();
            }
            builder.create(field.name.as_str())
        }};
    }
    match field.dtype {
        Dtype::Bool => dataset!(bool),
        Dtype::U8 => dataset!(u8),
        Dtype::I32 => dataset!(i32),
        Dtype::I64 => dataset!(i64),
        Dtype::F32 => dataset!(f32),
        Dtype::F64 => dataset!(f64),
        Dtype::Str => dataset!(FixedUnicode<TEXT_BYTES>),
    }
}
