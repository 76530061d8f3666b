//! A table at its newest version: columns, and rows by number.

use std::collections::BTreeMap;
use std::iter;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use crate::array::Part;
use crate::block::MAX_BYTES;
use crate::cursor::Cursor;
use crate::error::{At as _, Result, damaged, unsupported};
use crate::file::{DataFile, Encoding, Page};
use crate::kind::{Column, Kind};
use crate::manifest::{FileEntry, Manifest, newest};
use crate::page;
use crate::store::{Folder, Store};
use crate::values::Values;

/// The fragment and the position in it of a file, and the file.
type OpenFile = ((usize, usize), Arc<DataFile>);

/// Files that stay open.
const MAX_OPEN: usize = 64;

/// Rows of a fragment, one behind the other, of which none is deleted.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// The first of them, in the table.
    first: u64,
    fragment: usize,
    /// The first of them, in the fragment.
    at: u64,
    /// Whether rows in front of it are deleted.
    follows_deleted: bool,
}

/// A table, as it was when it was opened. Readers of several threads share it.
#[derive(Debug)]
pub struct Table {
    store: Box<dyn Store>,
    manifest: Manifest,
    /// All rows, in order.
    pieces: Vec<Piece>,
    rows: u64,
    deleted: u64,
    /// By fragment and position in it, the newest last.
    open: Mutex<Vec<OpenFile>>,
}

impl Table {
    /// Opens the newest version of a table in a folder of this machine. The manifest is read, and which rows are deleted.
    ///
    /// # Errors
    ///
    /// There is no table, it is damaged, or it needs what this reader lacks, such as overwritten values.
    pub fn open(folder: &Path) -> Result<Self> {
        Self::open_in(Box::new(Folder(folder.to_owned())))
    }

    /// As [`Table::open`], wherever its files are.
    ///
    /// # Errors
    ///
    /// As of [`Table::open`].
    pub fn open_in(store: Box<dyn Store>) -> Result<Self> {
        let manifest = newest(store.as_ref())?;
        let mut table =
            Self { store, manifest, pieces: Vec::new(), rows: 0, deleted: 0, open: Mutex::default() };
        let mut follows_deleted = false;
        for (index, fragment) in table.manifest.fragments.iter().enumerate() {
            let deletions = fragment.deletions.as_ref();
            let deleted = deletions.map(|file| file.read(table.store.as_ref(), fragment.id, fragment.rows));
            let mut at = 0;
            let deleted = deleted.transpose()?.into_iter().flatten();
            for Range { start, end } in deleted.chain(iter::once(fragment.rows..fragment.rows)) {
                if at < start {
                    table.pieces.push(Piece { first: table.rows, fragment: index, at, follows_deleted });
                    (table.rows, follows_deleted) = (table.rows + start - at, false);
                }
                table.deleted += end - start;
                (at, follows_deleted) = (end, follows_deleted || start < end);
            }
        }
        Ok(table)
    }

    /// The number of the version.
    pub fn version(&self) -> u64 {
        self.manifest.version
    }

    /// How many rows, without those that are deleted.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// How many rows of its files are deleted.
    pub fn deleted(&self) -> u64 {
        self.deleted
    }

    /// The rows in front of which some are deleted, in order.
    pub fn gaps(&self) -> impl Iterator<Item = u64> + '_ {
        self.pieces.iter().filter(|piece| piece.follows_deleted).map(|piece| piece.first)
    }

    /// All columns, in the order of the schema. Those of a type that is not read are among them: [`Kind::Other`].
    pub fn columns(&self) -> &[Column] {
        &self.manifest.columns
    }

    /// The column with a name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns().iter().find(|column| column.name == name)
    }

    /// Texts by which the table and its schema are described.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.manifest.metadata
    }

    /// Reads rows of a column, one behind the other. What is read of the files is what these rows need: of large values each by itself, of
    /// small ones chunks of some kilobytes, which `cursor` keeps for the next call.
    ///
    /// # Errors
    ///
    /// There are no such rows, a file is missing or damaged, or an encoding is not known.
    pub fn read(&self, column: &Column, first: u64, count: usize, cursor: &mut Cursor) -> Result<Values> {
        if let Kind::Other(kind) = &column.kind {
            return Err(unsupported(format!("column `{}` has values of type {kind}", column.name)));
        }
        let mut values = Values::empty(&column.kind)?;
        let end = first.checked_add(count as u64).filter(|&end| end <= self.rows());
        let end =
            end.ok_or_else(|| damaged(format!("it has {} rows, not {count} from {first} on", self.rows())))?;
        let row_bytes = column.kind.shape().map_or(1, |(size, width)| size.max(1) * width) as u64;
        if (count as u64).saturating_mul(row_bytes) > MAX_BYTES as u64 {
            return Err(unsupported(format!("{count} rows of {row_bytes} bytes in one read")));
        }
        let mut index = self.pieces.partition_point(|piece| piece.first <= first).saturating_sub(1);
        let mut row = first;
        while row < end {
            let Piece { first: start, fragment, at, .. } = self.pieces[index];
            let here = self.pieces.get(index + 1).map_or(self.rows, |next| next.first).min(end);
            self.read_fragment(column, fragment, (at + row - start, at + here - start), cursor, &mut values)
                .at(format_args!("column `{}`", column.name))?;
            (row, index) = (here, index + 1);
        }
        Ok(values)
    }

    fn read_fragment(
        &self,
        column: &Column,
        fragment: usize,
        (from, to): (u64, u64),
        cursor: &mut Cursor,
        out: &mut Values,
    ) -> Result<()> {
        let (files, rows) =
            (&self.manifest.fragments[fragment].files, self.manifest.fragments[fragment].rows);
        // Files since 2.1 have no columns of lists, only of their items.
        let fields = [column.item, Some(column.field)].into_iter().flatten();
        let found = fields.into_iter().find_map(|field| {
            files.iter().position(|file| file.column(field).is_some()).map(|at| (at, field))
        });
        let Some((at, field)) = found else { return out.push_missing((to - from) as usize) };
        let entry = &files[at];
        let file = self.file(fragment, at, entry).at(&entry.path)?;
        let position =
            |field| entry.column(field).ok_or_else(|| damaged("its file lacks a part of the column"));
        let mut read = || match (&column.kind, file.is_first()) {
            (Kind::List(item), true) => {
                let of_lists = file.pages_of(position(column.field)?, rows)?;
                lists_of_first(&file, of_lists, file.pages(position(field)?)?, item, (from, to), out)
            }
            _ => {
                let pages = file.pages_of(position(field)?, rows)?;
                read_pages(&file, pages, &column.kind, (from, to), cursor, out)
            }
        };
        read().at(&entry.path)
    }

    /// An open file; those that were used last stay open.
    fn file(&self, fragment: usize, at: usize, entry: &FileEntry) -> Result<Arc<DataFile>> {
        let key = (fragment, at);
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = open.iter().rposition(|(there, _)| *there == key) {
            let file = open.remove(at);
            open.push(file.clone());
            return Ok(file.1);
        }
        let file = Arc::new(DataFile::open(self.store.as_ref(), &entry.path, entry.size)?);
        if open.len() == MAX_OPEN {
            open.remove(0);
        }
        open.push((key, file.clone()));
        Ok(file)
    }
}

fn read_pages(
    file: &DataFile,
    pages: &[Page],
    kind: &Kind,
    (from, to): (u64, u64),
    cursor: &mut Cursor,
    out: &mut Values,
) -> Result<()> {
    let mut index = pages.partition_point(|page| page.first + page.rows <= from);
    let mut row = from;
    while row < to {
        let page = pages.get(index).ok_or_else(|| damaged("it has fewer pages than rows"))?;
        let end = (page.first + page.rows).min(to);
        let rows = row - page.first..end - page.first;
        let read = match &page.encoding {
            Encoding::Array(array) => {
                let shape = kind.shape().ok_or_else(|| damaged("it has no values"))?;
                array.read(file.bytes.as_ref(), rows.start, (end - row) as usize, shape).and_then(|part| {
                    let Part { block, valid } = part;
                    out.push(&block, 0..(end - row) as usize, valid.as_deref())
                })
            }
            Encoding::Layout(layout) => {
                page::rows(file.bytes.as_ref(), page, layout, kind, rows, cursor, out)
            }
        };
        read.at(format_args!("page {index}"))?;
        (row, index) = (end, index + 1);
    }
    Ok(())
}

/// Lists of a file of version 2.0: their ends are a column, and their values another one.
fn lists_of_first(
    file: &DataFile,
    lists: &[Page],
    items: &[Page],
    kind: &Kind,
    (from, to): (u64, u64),
    out: &mut Values,
) -> Result<()> {
    let mut base = 0u64;
    for page in lists {
        let Encoding::Array(array @ crate::array::Array::List { items: count, .. }) = &page.encoding else {
            return Err(damaged("its values are no lists"));
        };
        let rows = page.first.max(from)..(page.first + page.rows).min(to);
        if rows.start < rows.end {
            let ends = array.lists(file.bytes.as_ref(), page.rows as usize)?;
            let mut values = Values::empty(kind)?;
            let (first, last) = ((rows.start - page.first) as usize, (rows.end - page.first) as usize);
            let start = if first == 0 { 0 } else { ends[first - 1].0 };
            let end = ends[last - 1].0;
            let all = items.last().map_or(0, |page| page.first + page.rows);
            if end > *count || base.checked_add(end).is_none_or(|end| end > all) {
                return Err(damaged("its lists have more values than there are"));
            }
            read_pages(file, items, kind, (base + start, base + end), &mut Cursor::default(), &mut values)?;
            let mut at = start;
            for &(end, is_valid) in &ends[first..last] {
                out.push_list_of(&values, (at - start) as usize..(end - start) as usize, is_valid)?;
                at = end;
            }
        }
        base = base.checked_add(*count).ok_or_else(|| damaged("its lists have too many values"))?;
    }
    Ok(())
}
