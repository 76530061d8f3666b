//! Copying episodes of datasets into another, of any format: conversion, merging and splitting are all that.
//!
//! One thread reads the next rows while the caller's writes the ones before. Columns that both sides store in the same way, such as
//! images in HDF5, pass as they are stored, without being decoded. Episodes flow in pieces, so that memory is bounded
//! whatever their length. A copy that was interrupted continues where it ended, if what it holds is what it would
//! be given.

use std::fmt::Display;
use std::ops::Range;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use swm_core::checkpoint::CHECKPOINT;
use swm_core::error::BoxError;
use swm_core::{Field, Metadata, Registry, Schema};
use swm_files::remote::is_remote;

use super::{compatibility, resume_check};
use crate::dataset::{self, Dataset, EncodedBatch, WriteMode, WriteOptions};
use crate::error::DataError;
use crate::format;

/// One episode to copy: which source, which of its episodes.
pub type Piece = (usize, usize);

/// What a copy did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Copied {
    /// Episodes that were there already.
    pub resumed: usize,
    /// Episodes that were copied now.
    pub episodes: usize,
    /// Their rows.
    pub rows: usize,
    /// Rows per second that the copy has and no source: its format needs a rate, and none was given.
    pub assumed_rate: Option<f64>,
}

/// Copies `pieces` of `sources` to the end of the dataset at `to`. The columns are those of the first source; the others
/// must have them too. `watch` is told after each episode how many rows it has.
///
/// The copy is a part of a recording ([`Metadata::part`]) only if it holds all of one dataset that is.
///
/// With [`WriteMode::Append`], episodes that are there must be the first of `pieces`: the rest of an interrupted copy. The columns and
/// all lengths are compared, and of some episodes the values of some rows; images only where the target keeps them without loss.
/// [`WriteOptions::frames_per_second`], where given, is also the rate of rows that the copy's record says.
///
/// # Errors
///
/// Sources without a wanted column, of several recordings ([`compatibility::check_recordings`]) or of a rate that is in doubt and not given
/// ([`compatibility::rate_doubt`]): then nothing is written. A target that holds something else, and whatever reading and writing may meet; an
/// error after the first episode says how many there are.
pub fn copy(
    sources: &mut [Box<dyn Dataset>],
    pieces: &[Piece],
    to: &Path,
    how: (Option<&str>, &WriteOptions),
    watch: &mut dyn FnMut(usize),
) -> Result<Copied, DataError> {
    copy_in(format::built_in(), sources, pieces, to, how, watch)
}

/// As [`copy`], to any format of a registry.
///
/// # Errors
///
/// As of [`copy`].
pub fn copy_in(
    registry: &Registry,
    sources: &mut [Box<dyn Dataset>],
    pieces: &[Piece],
    to: &Path,
    (format, options): (Option<&str>, &WriteOptions),
    watch: &mut dyn FnMut(usize),
) -> Result<Copied, DataError> {
    let Some(first) = sources.first() else { return Ok(Copied::default()) };
    let schema = first.schema().clone();
    compatibility::check_recordings(sources, pieces)?;
    for source in sources.iter() {
        check_columns(source.as_ref(), &schema)?;
        if is_same(source.path(), to) {
            return Err(DataError::record(to, "it is one of the sources"));
        }
    }
    if options.frames_per_second.is_none()
        && let Some(doubt) = compatibility::rate_doubt(sources, pieces)
    {
        return Err(doubt.into());
    }
    let resumed = if options.mode == WriteMode::Append {
        resume_check::copied_pieces(registry, sources, pieces, to)?
    } else {
        0
    };
    let mut copied = Copied { resumed, ..Copied::default() };
    let done = copy_rest(registry, sources, pieces, to, (format, options), &mut copied, watch);
    done.map_err(|error| unfinished(error, to, &copied, pieces.len()))?;
    Ok(copied)
}

/// Adds to an error how much of a copy is there.
fn unfinished(error: DataError, to: &Path, copied: &Copied, of: usize) -> DataError {
    let there = copied.resumed + copied.episodes;
    if there == 0 {
        return error;
    }
    let add = |reason: &dyn Display| -> BoxError {
        format!(
            "{reason}; {} holds the first {there} of {of} episodes; once that is repaired, the same copy goes on from there, without \
             overwriting",
            to.display()
        )
        .into()
    };
    match error {
        DataError::Damaged { path, column, episode, reason } => {
            DataError::Damaged { path, column, episode, reason: add(&reason) }
        }
        DataError::Unsupported { path, column, episode, reason } => {
            DataError::Unsupported { path, column, episode, reason: add(&reason) }
        }
        DataError::Request { path, reason } => DataError::Request { path, reason: add(&reason) },
        DataError::Record { path, reason } => DataError::Record { path, reason: add(&reason) },
        DataError::Write { path, episodes, reason } => {
            DataError::Write { path, episodes, reason: add(&reason) }
        }
        DataError::Replay { path, episode, row, reason } => {
            DataError::Replay { path, episode, row, reason: add(&reason).to_string() }
        }
        DataError::Io { path, action, source } => {
            DataError::Io { path, action, source: std::io::Error::new(source.kind(), add(&source)) }
        }
        error => error,
    }
}

/// Copies what is not there yet, and counts it.
fn copy_rest(
    registry: &Registry,
    sources: &mut [Box<dyn Dataset>],
    pieces: &[Piece],
    to: &Path,
    (format, options): (Option<&str>, &WriteOptions),
    copied: &mut Copied,
    watch: &mut dyn FnMut(usize),
) -> Result<(), DataError> {
    let Some(first) = sources.first() else { return Ok(()) };
    let schema = first.schema().clone();
    let mut options = options.clone();
    let rate = options.frames_per_second;
    let keeps_part = sources.len() == 1 && pieces == all(sources);
    let metadata_of = |sources: &[Box<dyn Dataset>], piece| {
        let metadata = metadata_of(sources, piece);
        let rows_per_second = rate.or(metadata.rows_per_second);
        Metadata { part: metadata.part.filter(|_| keeps_part), rows_per_second, ..metadata }
    };
    let mut start = copied.resumed;
    while start < pieces.len() {
        // A run of episodes with one record.
        let metadata = metadata_of(sources, pieces[start]);
        let same = pieces[start..].iter().take_while(|&&piece| metadata_of(sources, piece) == metadata);
        let end = start + same.count();
        let run = &pieces[start..end];
        let failed = |error: BoxError| match error.downcast::<DataError>() {
            Ok(error) => *error,
            Err(error) => DataError::request(to, error.to_string()),
        };
        let mut writer = format::create_in(registry, to, &options, format)?;
        writer.begin(&schema, &metadata).map_err(failed)?;
        copied.assumed_rate = copied.assumed_rate.or(writer.assumed_rate());
        let spare = EncodedBatch::new(&schema, |column| {
            let name = &schema.fields()[column].name;
            let of = |source: &dyn Dataset| source.encoding(source.schema().index(name)?).map(str::to_owned);
            let wanted = writer.encoding(column);
            wanted.is_some() && sources.iter().all(|source| of(source.as_ref()).as_deref() == wanted)
        });
        let (to_writer, from_reader) = sync_channel(1);
        let (to_reader, from_writer) = sync_channel(2);
        for _ in 0..2 {
            // Two tables: one is read into, the other written from.
            let _ = to_reader.send(spare.clone());
        }
        thread::scope(|scope| {
            let (sources, schema) = (&mut *sources, &*schema);
            scope.spawn(move || read(sources, schema, run, &from_writer, &to_writer));
            let mut count = 0;
            for rows_read in from_reader {
                let (rows, is_last): (EncodedBatch, bool) = rows_read?;
                writer.write_encoded_rows(&rows).map_err(failed)?;
                count += rows.rows();
                if is_last {
                    writer.end_episode().map_err(failed)?;
                    copied.episodes += 1;
                    copied.rows += count;
                    watch(count);
                    count = 0;
                }
                // The reader may have read the last one.
                let _ = to_reader.send(rows);
            }
            drop(to_reader);
            writer.finish().map_err(failed)
        })?;
        options.mode = WriteMode::Append;
        start = end;
    }
    Ok(())
}

/// Reads rows: values of some columns, the others as they are stored.
fn read_rows(
    source: &mut dyn Dataset,
    schema: &Schema,
    episode: usize,
    rows: Range<usize>,
    out: &mut EncodedBatch,
) -> Result<(), DataError> {
    source.read(episode, rows.clone(), &mut out.plain)?;
    for (column, encoded) in &mut out.encoded {
        let name = &schema.fields()[*column].name;
        let found = source.schema().index(name).expect("a column that is not there has no encoding");
        source.encoded_rows(found, episode, rows.clone(), encoded)?;
    }
    Ok(())
}

/// Reads episodes into spare tables, until there are no more or nobody wants them. Each table comes with whether it ends
/// its episode.
fn read(
    sources: &mut [Box<dyn Dataset>],
    schema: &Schema,
    pieces: &[Piece],
    spare: &Receiver<EncodedBatch>,
    out: &SyncSender<Result<(EncodedBatch, bool), DataError>>,
) {
    for &(source, episode) in pieces {
        let source = &mut sources[source];
        let len = source.episode_len(episode);
        if len == 0 {
            let _ =
                out.send(Err(DataError::damaged(source.path(), format!("episode {episode} has no rows"))));
            return;
        }
        for rows in dataset::pieces(source.schema(), len) {
            let Ok(mut piece) = spare.recv() else { return };
            let is_last = rows.end == len;
            let read = read_rows(source.as_mut(), schema, episode, rows, &mut piece);
            let failed = read.is_err();
            if out.send(read.map(|()| (piece, is_last))).is_err() || failed {
                return;
            }
        }
    }
}

fn check_columns(source: &dyn Dataset, schema: &Schema) -> Result<(), DataError> {
    for field in schema.fields() {
        let found = source.schema().index(&field.name).map(|at| &source.schema().fields()[at]);
        match found {
            Some(found) if found.dtype == field.dtype && found.shape == field.shape => {}
            Some(found) => {
                return Err(DataError::request(
                    source.path(),
                    format!(
                        "its column `{}` holds {} {:?}, the first source's {} {:?}",
                        field.name, found.dtype, found.shape, field.dtype, field.shape
                    ),
                ));
            }
            None => {
                let fix = fix(field);
                let reason = format!("it has no column `{}`, which the first source has{fix}", field.name);
                return Err(DataError::request(source.path(), reason));
            }
        }
    }
    match source.schema().fields().iter().find(|field| schema.index(&field.name).is_none()) {
        Some(more) => {
            let reason = format!("its column `{}` is not in the first source{}", more.name, fix(more));
            Err(DataError::request(source.path(), reason))
        }
        None => Ok(()),
    }
}

/// What helps where only some sources have a column.
fn fix(field: &Field) -> &'static str {
    // Recordings without images have the states that images are rendered from.
    match resume_check::is_image(field) || field.name == CHECKPOINT {
        true => "; `image_size` renders images for all sources",
        false => "",
    }
}

/// The record of the run that an episode comes from. Files of other programs have none.
fn metadata_of(sources: &[Box<dyn Dataset>], (source, episode): Piece) -> Metadata {
    let info = sources[source].info();
    match compatibility::run_of(sources[source].as_ref(), episode) {
        Some(metadata) => metadata.clone(),
        None => Metadata { rows_per_second: info.rows_per_second, ..Metadata::unknown() },
    }
}

/// Whether two paths lead to the same file or folder, links of either kind included. Where nothing is, there is nothing the same.
pub fn is_same(a: &Path, b: &Path) -> bool {
    if is_remote(a) {
        return a == b;
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;

        let of = |path| std::fs::metadata(path).map(|found| (found.dev(), found.ino()));
        matches!((of(a), of(b)), (Ok(a), Ok(b)) if a == b)
    }
    #[cfg(not(unix))]
    {
        matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
    }
}

/// Every episode of every source, in order.
pub fn all(sources: &[Box<dyn Dataset>]) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for (at, source) in sources.iter().enumerate() {
        pieces.extend((0..source.num_episodes()).map(|episode| (at, episode)));
    }
    pieces
}
