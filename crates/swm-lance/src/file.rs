//! A file of rows: its footer, and of each column the pages.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::array::Array;
use crate::error::{At as _, Result, damaged, unsupported};
use crate::layout::Layout;
use crate::page::ChunkTable;
use crate::proto::{choice, fields};
use crate::store::{Bytes, Extent, Store, read};

const MAGIC: &[u8] = b"LANC";
const FOOTER: u64 = 40;
/// Position and size of a column's metadata.
const ENTRY: u64 = 16;
/// Rows that a file may have without bytes: constant columns.
const FREE_ROWS: u64 = 1 << 20;
/// Rows that a byte of a file may stand for.
const ROWS_PER_BYTE: u64 = 64;

/// An open file.
#[derive(Debug)]
pub(crate) struct DataFile {
    pub(crate) bytes: Box<dyn Bytes>,
    /// Of each column: where its metadata is, and what was read of it.
    columns: Vec<(Extent, OnceLock<Vec<Page>>)>,
    is_first: bool,
}

/// A part of the rows of a column.
#[derive(Debug)]
pub(crate) struct Page {
    /// Tells it from all others.
    pub(crate) key: usize,
    /// The row of the file that is its first one.
    pub(crate) first: u64,
    pub(crate) rows: u64,
    pub(crate) buffers: Vec<Extent>,
    pub(crate) encoding: Encoding,
    /// Of a page of chunks, read on first use.
    pub(crate) chunks: OnceLock<ChunkTable>,
}

/// How the values of a page are coded.
#[derive(Debug)]
pub(crate) enum Encoding {
    /// In files of version 2.0.
    Array(Array),
    Layout(Box<Layout>),
}

impl DataFile {
    /// Opens a file; `size` is the one that the manifest has, if it has one.
    pub(crate) fn open(store: &dyn Store, path: &str, size: u64) -> Result<Self> {
        let bytes = store.open(path)?;
        let length = bytes.length();
        if size != 0 && size != length {
            return Err(damaged(format!(
                "it has {length} bytes, and the manifest records {size}; it may be cut"
            )));
        }
        let whole = Extent { at: 0, size: length };
        let end = length.checked_sub(FOOTER).ok_or_else(|| damaged("it is cut"))?;
        let footer = read(bytes.as_ref(), whole.part(end, FOOTER)?)?;
        if !footer.ends_with(MAGIC) {
            return Err(damaged("it does not end as a file of Lance; it may be cut"));
        }
        let number = |at: usize, size: usize| crate::block::number(&footer[at..at + size]);
        let is_first = match (number(32, 2), number(34, 2)) {
            (0, 3) | (2, 0) => true,
            (2, 1 | 2) => false,
            (major, minor) => {
                return Err(unsupported(format!(
                    "it is a file of the version {major}.{minor}; 2.0, 2.1 and 2.2 are read (data_storage_version of lance.write_dataset)"
                )));
            }
        };
        let count = number(28, 4);
        let table = whole.part(number(8, 8), count * ENTRY).at("its table of columns")?;
        let table = read(bytes.as_ref(), table)?;
        let columns = table.chunks_exact(ENTRY as usize).map(|entry| {
            let (at, size) = entry.split_at(8);
            let extent = whole.part(crate::block::number(at), crate::block::number(size));
            Ok((extent.at("its table of columns")?, OnceLock::new()))
        });
        let columns = columns.collect::<Result<_>>()?;
        Ok(Self { bytes, columns, is_first })
    }

    /// Whether it is of version 2.0, where structures and lists have columns of their own.
    pub(crate) fn is_first(&self) -> bool {
        self.is_first
    }

    /// The pages of a column.
    pub(crate) fn pages(&self, column: usize) -> Result<&[Page]> {
        let (extent, pages) =
            self.columns.get(column).ok_or_else(|| damaged("it lacks a column that the manifest names"))?;
        if let Some(pages) = pages.get() {
            return Ok(pages);
        }
        let message = read(self.bytes.as_ref(), *extent)?;
        let found = self.parse(&message)?;
        Ok(pages.get_or_init(|| found))
    }

    /// As [`Self::pages`], which have to hold all rows of the file.
    pub(crate) fn pages_of(&self, column: usize, rows: u64) -> Result<&[Page]> {
        let pages = self.pages(column)?;
        let there = pages.last().map_or(0, |page| page.first + page.rows);
        if there != rows {
            return Err(damaged(format!("its pages have {there} rows, and {rows} are expected")));
        }
        let most = self.bytes.length().saturating_mul(ROWS_PER_BYTE).saturating_add(FREE_ROWS);
        match rows <= most {
            true => Ok(pages),
            false => {
                Err(damaged(format!("{rows} rows are more than {} bytes can hold", self.bytes.length())))
            }
        }
    }

    fn parse(&self, message: &[u8]) -> Result<Vec<Page>> {
        let mut pages = Vec::new();
        let mut first = 0u64;
        for field in fields(message) {
            match field? {
                (1, value) => self.check_column(value.bytes()?)?,
                (2, value) => {
                    let page = self.page(value.bytes()?, first).at(format_args!("page {}", pages.len()))?;
                    first = first
                        .checked_add(page.rows)
                        .ok_or_else(|| damaged("its pages have too many rows"))?;
                    pages.push(page);
                }
                _ => {}
            }
        }
        Ok(pages)
    }

    /// A column that is coded as a whole is not read.
    fn check_column(&self, message: &[u8]) -> Result<()> {
        let Some(message) = direct(message)? else { return Ok(()) };
        match choice(message)? {
            None | Some((1, _)) => Ok(()),
            Some((2, _)) => Err(unsupported("the encoding ZoneIndex of a column is not read")),
            Some((3, _)) => Err(unsupported("the encoding Blob of a column is not read")),
            Some((number, _)) => {
                Err(unsupported(format!("an encoding of a column with the number {number}")))
            }
        }
    }

    fn page(&self, message: &[u8], first: u64) -> Result<Page> {
        let (mut positions, mut sizes, mut rows, mut encoding) = (Vec::new(), Vec::new(), 0, None);
        for field in fields(message) {
            let (number, value) = field?;
            match number {
                1 => value.numbers(&mut positions)?,
                2 => value.numbers(&mut sizes)?,
                3 => rows = value.number()?,
                4 => encoding = direct(value.bytes()?)?,
                _ => {}
            }
        }
        if positions.len() != sizes.len() {
            return Err(damaged("its buffers have other numbers of positions than of sizes"));
        }
        let whole = Extent { at: 0, size: self.bytes.length() };
        let buffers = positions.into_iter().zip(sizes).map(|(at, size)| whole.part(at, size));
        let buffers: Vec<Extent> = buffers.collect::<Result<_>>()?;
        let encoding = encoding.ok_or_else(|| damaged("its encoding is missing"))?;
        let encoding = match self.is_first {
            true => Encoding::Array(Array::parse(encoding, &buffers)?),
            false => Encoding::Layout(Box::new(Layout::parse(encoding)?)),
        };
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let key = NEXT.fetch_add(1, Ordering::Relaxed);
        Ok(Page { key, first, rows, buffers, encoding, chunks: OnceLock::new() })
    }
}

/// The message that describes an encoding, where it is beside what it describes; `None` if there is none.
fn direct(message: &[u8]) -> Result<Option<&[u8]>> {
    match choice(message)? {
        Some((1, _)) => Err(unsupported("a description of an encoding is in another place")),
        Some((2, message)) => {
            let mut any: &[u8] = &[];
            for field in fields(message) {
                if let (1, value) = field? {
                    any = value.bytes()?;
                }
            }
            let mut found: &[u8] = &[];
            for field in fields(any) {
                if let (2, value) = field? {
                    found = value.bytes()?;
                }
            }
            Ok(Some(found))
        }
        _ => Ok(None),
    }
}
