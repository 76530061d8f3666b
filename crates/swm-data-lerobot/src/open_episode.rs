//! The episode that is being recorded: its table and its videos, which have their names only once it ends. Rows of the
//! table are held until they make a group, so that the file does not depend on the pieces in which they came.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crc32fast::Hasher;
use rayon::prelude::*;
use swm_core::{Batch, Column, Field, Schema, Slice};
use swm_data::dataset::row_bytes;
use swm_data::error::{At as _, Result, missing, wrong_type};
use swm_data::video::VideoWriter;
use swm_files::{new_file, replace_unsynced};
use swm_media::mp4::Mp4Options;

use super::manifest::{Manifest, OWN, is_own, is_video};
use super::parquet_file::{ColumnOut, TableWriter};
use super::{episodes, last_row};

/// Bytes of a group of rows.
const GROUP_BYTES: usize = 32 << 20;
/// Rows of a group at most.
const GROUP_ROWS: usize = 1 << 16;

/// One episode that has not ended.
pub(super) struct OpenEpisode {
    episode: usize,
    /// Where it begins among the rows of the dataset.
    first: usize,
    rows: usize,
    /// Those of them that are in the table.
    written: usize,
    /// Rows of a full group.
    group: usize,
    /// Where the table gets its name.
    table_path: PathBuf,
    table: Option<TableWriter<Checked<BufWriter<File>>>>,
    /// The columns of the table that are not made up, with those rows that no group holds yet.
    held: Vec<(Field, String, Column)>,
    /// The tasks of those rows.
    tasks: Vec<i64>,
    videos: Vec<OpenVideo>,
}

/// The checksums of the files of an episode.
pub(super) struct Checksums {
    /// That of the table, then those of the videos.
    pub(super) files: Vec<u32>,
    /// That of the last row, where it is beside the table.
    pub(super) last_row: Option<u32>,
}

struct OpenVideo {
    field: Field,
    camera: String,
    video: VideoWriter,
}

impl OpenEpisode {
    /// Begins episode number `episode` of the folder, whose rows begin at `first`.
    pub(super) fn new(
        folder: &Path,
        manifest: &Manifest,
        encoding: &Mp4Options,
        (episode, first): (usize, usize),
    ) -> Result<Self> {
        let is_stored =
            |field: &&Field| !is_video(field) && !is_own(&field.name) && !manifest.is_task(&field.name);
        let stored = manifest.columns.iter().filter(is_stored);
        let held: Vec<_> = stored
            .map(|field| (field.clone(), manifest.feature(&field.name), Column::zeros(field.dtype, 0)))
            .collect();
        let videos = manifest.cameras().map(|(field, camera)| {
            let video = VideoWriter::new(field, encoding).at(format_args!("column `{}`", field.name))?;
            Ok(OpenVideo { field: field.clone(), camera, video })
        });
        let fields: Vec<Field> = held.iter().map(|(field, ..)| field.clone()).collect();
        let own = OWN.len() * size_of::<i64>();
        Ok(Self {
            episode,
            first,
            rows: 0,
            written: 0,
            group: (GROUP_BYTES / (row_bytes(&fields) + own)).clamp(1, GROUP_ROWS),
            table_path: folder.join(episodes::data_path(episode)),
            table: None,
            videos: videos.collect::<Result<_>>()?,
            held,
            tasks: Vec::new(),
        })
    }

    /// Appends rows with these tasks.
    pub(super) fn append(&mut self, rate: f64, schema: &Schema, batch: &Batch, tasks: &[i64]) -> Result<()> {
        self.append_images(schema, batch)?;
        let mut taken = 0;
        while taken < batch.rows() {
            let in_group = self.rows - self.written;
            let count = (self.group - in_group).min(batch.rows() - taken);
            self.hold(schema, batch, (taken, count))?;
            self.tasks.extend(&tasks[taken..taken + count]);
            taken += count;
            self.rows += count;
            if in_group + count == self.group {
                self.write_group(rate)?;
            }
        }
        Ok(())
    }

    /// Holds so many rows from a row on.
    fn hold(&mut self, schema: &Schema, batch: &Batch, (first, count): (usize, usize)) -> Result<()> {
        for (field, _, column) in &mut self.held {
            let from = schema.index(&field.name).ok_or(missing("a column is missing"))?;
            let width = field.dim();
            if !column.extend(batch.column(from).range(first * width, count * width)) {
                return Err(wrong_type(format!("column `{}` has another type", field.name)));
            }
        }
        Ok(())
    }

    fn append_images(&mut self, schema: &Schema, batch: &Batch) -> Result<()> {
        // Encoding is most of the work, and videos do not know of each other.
        self.videos.par_iter_mut().try_for_each(|OpenVideo { field, video, .. }| {
            let written = match schema.index(&field.name).map(|column| batch.column(column)) {
                Some(Slice::U8(values)) => video.append(values),
                Some(_) => Err(wrong_type("it holds no images")),
                None => Err(missing("it is missing")),
            };
            written.at(format_args!("column `{}`", field.name))
        })
    }

    /// Ends the episode: a last row that shall be beside the table is written, videos get their names, then the table.
    pub(super) fn finish(
        mut self,
        folder: &Path,
        rate: f64,
        last_row: Option<(&Schema, &Batch, i64)>,
    ) -> Result<Checksums> {
        if self.rows > self.written {
            self.write_group(rate)?;
        }
        let last_row = match last_row {
            None => None,
            Some((schema, batch, task)) => {
                self.append_images(schema, batch)?;
                self.hold(schema, batch, (0, 1))?;
                self.tasks.push(task);
                let place = folder.join(last_row::path_of(self.episode));
                let written = self
                    .with_columns(self.rows..self.rows + 1, rate, |columns| last_row::write(&place, columns));
                Some(written?)
            }
        };
        let mut checksums = vec![0];
        for OpenVideo { field, camera, video } in self.videos {
            let video = video.finish().at(format_args!("column `{}`", field.name))?;
            let path = folder.join(episodes::video_path(&camera, self.episode));
            make_parent(&path).and_then(|()| replace_unsynced(&path, &video)).at(path.display())?;
            checksums.push(crc32fast::hash(&video));
        }
        // LeRobot reads all tables that there are, listed or not, so a table gets its name when it is complete; and the
        // less time between that and the list, the better.
        let table = self.table.take().ok_or(missing("an episode without rows"))?;
        let mut checked = table.finish()?;
        let named = checked.flush().and_then(|()| fs::rename(draft(&self.table_path), &self.table_path));
        named.at(self.table_path.display())?;
        checksums[0] = checked.checksum.finalize();
        Ok(Checksums { files: checksums, last_row })
    }

    /// Writes the rows that are held.
    fn write_group(&mut self, rate: f64) -> Result<()> {
        let (rows, mut table) = (self.written..self.rows, self.table.take());
        let path = draft(&self.table_path);
        self.with_columns(rows, rate, |columns| {
            let table = match &mut table {
                Some(table) => table,
                None => {
                    let file = make_parent(&path).and_then(|()| new_file(&path)).at(path.display())?;
                    let out = Checked { out: BufWriter::new(file), checksum: Hasher::new() };
                    table.insert(TableWriter::new(out, columns, &[])?)
                }
            };
            table.group(columns)
        })?;
        self.table = table;
        self.written = self.rows;
        self.held.iter_mut().for_each(|(_, _, column)| column.resize(0));
        self.tasks.clear();
        Ok(())
    }

    /// The columns of the rows that are held.
    fn with_columns<T>(
        &self,
        rows: Range<usize>,
        rate: f64,
        work: impl FnOnce(&[ColumnOut<'_>]) -> Result<T>,
    ) -> Result<T> {
        let times: Vec<f32> = rows.clone().map(|row| (row as f64 / rate) as f32).collect();
        let frames: Vec<i64> = rows.clone().map(|row| row as i64).collect();
        let all: Vec<i64> = rows.clone().map(|row| (self.first + row) as i64).collect();
        let episode = vec![self.episode as i64; rows.len()];
        let own = [
            Slice::F32(&times),
            Slice::I64(&frames),
            Slice::I64(&episode),
            Slice::I64(&all),
            Slice::I64(&self.tasks),
        ];
        let held = self.held.iter().map(|(field, feature, column)| ColumnOut {
            name: feature.clone(),
            values: column.as_slice(),
            list: (field.dim() > 1).then(|| field.dim()),
        });
        let made_up = OWN.iter().zip(own).map(|(&(name, _), values)| ColumnOut::scalar(name, values));
        let columns: Vec<ColumnOut<'_>> = held.chain(made_up).collect();
        work(&columns)
    }
}

/// Sums up what is written.
struct Checked<W> {
    out: W,
    checksum: Hasher,
}

impl<W: Write> Write for Checked<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.checksum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// What a file is called before it is complete, as `replace` calls it.
fn draft(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    name.into()
}

fn make_parent(path: &Path) -> io::Result<()> {
    path.parent().map_or(Ok(()), fs::create_dir_all)
}
