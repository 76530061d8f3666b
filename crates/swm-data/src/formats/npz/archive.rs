//! Reading the array of an `.npz` file: straight from the file where it is stored as it is, from memory where it is
//! deflated.

use std::io::{self, BufReader, Read};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use swm_core::SliceMut;
use swm_files::{Cursor, ReadAt, Readable, new_file, open_regular, read_exact_at};
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive};

use super::growing;
use super::header::{ArrayType, Head};
use crate::error::{FormatError, Result, invalid, missing, unsupported, wrong_type};
use crate::formats::element::{self, Element, LOOKED_AT};

/// Where numpy puts the only array of an archive.
pub(super) const ENTRY: &str = "arr_0.npy";
/// The most that deflate can shrink by; what claims more is forged.
const MAX_RATIO: u64 = 1100;
/// A compressed array is held in memory.
const MAX_INFLATED: u64 = 1 << 30;
/// An index of episodes is never longer.
const MAX_INTEGERS: usize = 1 << 24;
/// A head is never longer.
const MAX_HEAD: u64 = 1 << 16;
/// The record at the end of a zip archive: how it begins, and its most bytes, with a comment.
const END: &[u8] = b"PK\x05\x06";
const MAX_END: u64 = 22 + 65_535;

/// Files that were made for decoded arrays.
static SPOOLED: AtomicUsize = AtomicUsize::new(0);

/// An open array: rows of one shape.
#[derive(Debug)]
pub struct Array {
    elements: ArrayType,
    /// Whether the values have to be [swapped](ArrayType::swap) where they are read.
    is_big_endian: bool,
    /// Rows first.
    shape: Vec<usize>,
    row_bytes: usize,
    values: Values,
}

#[derive(Debug)]
enum Values {
    /// From this byte of the file on.
    File(Readable, u64),
    Memory(Vec<u8>),
}

impl Array {
    /// Opens the array of an archive that any program wrote.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        Self::open_member(path, ENTRY, None)
    }

    /// Opens an array of an archive of several. A compressed one that is too large for memory is decoded into a file of the folder
    /// `storage`, which has no name.
    ///
    /// # Errors
    ///
    /// It is missing, damaged, of a type that is not read, or too large for memory without `storage`.
    pub fn open_member(path: &Path, member: &str, storage: Option<&Path>) -> Result<Self> {
        let file = Readable::open(path)?;
        let length = file.length()?;
        check_end(&file, length)?;
        let mut archive = ZipArchive::new(BufReader::new(Cursor::new(file.clone())?))
            .map_err(|error| archive_error(error, member))?;
        let entry = archive.by_name(member).map_err(|error| archive_error(error, member))?;
        let (size, stored) = (entry.size(), entry.compression() == CompressionMethod::Stored);
        if entry.compressed_size() > length || size / MAX_RATIO > entry.compressed_size() {
            return Err(invalid(format!("its array claims to have {size} bytes")));
        }
        if !stored {
            if size > MAX_INFLATED {
                let Some(folder) = storage else {
                    return Err(unsupported(format!(
                        "compressed, it takes {} GB of memory; store it uncompressed, as `numpy.savez` does, or open it with the \
                         option `storage`, a folder with so much room",
                        size >> 30
                    )));
                };
                return Self::spooled(entry, size, folder);
            }
            let mut bytes = Vec::new();
            entry.take(size).read_to_end(&mut bytes)?;
            let head = Head::parse(&bytes)?;
            bytes.drain(..head.bytes);
            return Self::in_memory(head, bytes);
        }
        let start = entry.data_start();
        drop(entry);
        let mut bytes = vec![0; size.min(MAX_HEAD) as usize];
        read_exact_at(&file, &mut bytes, start)?;
        let head = Head::parse(&bytes)?;
        if head.is_by_column && head.shape.len() > 1 {
            let size = size.saturating_sub(head.bytes as u64);
            if size > MAX_INFLATED {
                return Err(unsupported(format!(
                    "stored column by column (`fortran_order`), it takes {} GB of memory; store `numpy.ascontiguousarray` of it",
                    size >> 30
                )));
            }
            let mut bytes = vec![0; size as usize];
            read_exact_at(&file, &mut bytes, start + head.bytes as u64)?;
            return Self::in_memory(head, bytes);
        }
        let (values, available) = (start + head.bytes as u64, size.saturating_sub(head.bytes as u64));
        Self::new(head, available, Values::File(file, values))
    }

    /// Decodes an array into a file without a name, which is gone when it is closed.
    fn spooled(mut entry: impl Read, size: u64, folder: &Path) -> Result<Self> {
        let name = format!(".swm-{}-{}", std::process::id(), SPOOLED.fetch_add(1, Ordering::Relaxed));
        let path = folder.join(name);
        let mut file = new_file(&path)?;
        std::fs::remove_file(&path)?;
        io::copy(&mut entry.by_ref().take(size), &mut file)?;
        let mut bytes = vec![0; size.min(MAX_HEAD) as usize];
        read_exact_at(&file, &mut bytes, 0)?;
        let head = Head::parse(&bytes)?;
        if head.is_by_column && head.shape.len() > 1 {
            return Err(unsupported(
                "it is stored column by column (`fortran_order`); store `numpy.ascontiguousarray` of it",
            ));
        }
        let (start, available) = (head.bytes as u64, size.saturating_sub(head.bytes as u64));
        Self::new(head, available, Values::File(Readable::from(file), start))
    }

    /// Opens an array of ours with `rows` rows, which its own head may not count yet: it is being written, or its
    /// writer was killed.
    pub(crate) fn open_growing(path: &Path, rows: usize) -> Result<Self> {
        let file = open_regular(path)?;
        let length = file.metadata()?.len();
        let mut head = growing::head(&file)?;
        match head.shape.first_mut() {
            Some(first) => *first = rows,
            None => return Err(unsupported("it is a single value, not one per row")),
        }
        let start = growing::VALUES;
        let file = Readable::from(file);
        Self::new(head, length.saturating_sub(start), Values::File(file, start))
    }

    /// From all values as they are stored, which are brought into the order of this program.
    fn in_memory(head: Head, mut bytes: Vec<u8>) -> Result<Self> {
        let elements = head.elements;
        let values = head.shape.iter().try_fold(elements.size(), |bytes, &size| bytes.checked_mul(size));
        // A shape that does not fit is told below.
        if let Some(values) = values.filter(|&values| values > 0 && values <= bytes.len()) {
            bytes.truncate(values);
            if head.is_by_column {
                bytes = by_row(&bytes, &head.shape, elements.size());
            }
            if head.is_big_endian {
                elements.swap(&mut bytes);
            }
        }
        let available = bytes.len() as u64;
        Self::new(Head { is_big_endian: false, ..head }, available, Values::Memory(bytes))
    }

    fn new(head: Head, available: u64, values: Values) -> Result<Self> {
        let Head { elements, is_big_endian, shape, .. } = head;
        let Some((&rows, rest)) = shape.split_first() else {
            return Err(unsupported("it is a single value, not one per row"));
        };
        let row_bytes = rest.iter().try_fold(elements.size(), |bytes, &size| bytes.checked_mul(size));
        let row_bytes =
            row_bytes.filter(|&bytes| bytes > 0).ok_or(invalid(format!("it has the shape {shape:?}")))?;
        match row_bytes.checked_mul(rows) {
            Some(needed) if needed as u64 <= available => {
                Ok(Self { elements, is_big_endian, row_bytes, shape, values })
            }
            _ => Err(invalid(format!("it was cut short: {available} bytes cannot hold the shape {shape:?}"))),
        }
    }

    /// The type of its values.
    #[must_use]
    pub fn elements(&self) -> ArrayType {
        self.elements
    }

    /// Its rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.shape[0]
    }

    /// Shape of one row.
    #[must_use]
    pub fn row_shape(&self) -> &[usize] {
        &self.shape[1..]
    }

    /// Reads rows `first`, `first + stride`, …, `count` of them.
    ///
    /// # Errors
    ///
    /// They are damaged, or hold values that columns do not.
    pub fn read(
        &self,
        (first, count, stride): (usize, usize, usize),
        mut out: SliceMut<'_>,
        scratch: &mut Vec<u8>,
    ) -> Result<()> {
        if stride == 1 {
            let bytes = self.bytes(first, count, scratch)?;
            return self.elements.convert(bytes, out);
        }
        let width = out.len() / count.max(1);
        for row in 0..count {
            let (head, tail) = out.split_at(width);
            out = tail;
            let bytes = self.bytes(first + row * stride, 1, scratch)?;
            self.elements.convert(bytes, head)?;
        }
        Ok(())
    }

    /// Why it is left out, if it holds u64: see [`element::too_large`].
    pub fn too_large(&self) -> Option<String> {
        if self.elements != ArrayType::Plain(Element::U64) {
            return None;
        }
        element::too_large(LOOKED_AT, self.rows(), self.row_shape().iter().product(), |steps, out| {
            self.read((steps.first, steps.count, steps.stride), out, &mut Vec::new())
        })
    }

    /// All values of so many rows, as they are stored but for the order of bytes.
    ///
    /// # Errors
    ///
    /// They are damaged.
    pub fn bytes<'a>(&'a self, first: usize, count: usize, scratch: &'a mut Vec<u8>) -> Result<&'a [u8]> {
        if first.checked_add(count).is_none_or(|end| end > self.rows()) {
            return Err(invalid(format!("it has {} rows, not {count} from row {first} on", self.rows())));
        }
        let (start, size) = (first * self.row_bytes, count * self.row_bytes);
        match &self.values {
            Values::Memory(bytes) => Ok(&bytes[start..start + size]),
            Values::File(file, from) => {
                scratch.resize(size, 0);
                read_exact_at(file, scratch, from + start as u64)?;
                if self.is_big_endian {
                    self.elements.swap(scratch);
                }
                Ok(scratch)
            }
        }
    }

    /// All rows as integers; `None` for other types.
    pub(crate) fn integers(&self) -> Result<Vec<i64>> {
        let mut scratch = Vec::new();
        let (rows, width) = (self.rows(), self.row_shape().iter().product::<usize>());
        if rows.saturating_mul(width) > MAX_INTEGERS {
            return Err(invalid(format!("it claims {rows} episodes; {MAX_INTEGERS} are the most")));
        }
        let mut column = swm_core::Column::zeros(self.elements.dtype(), rows * width);
        self.read((0, rows, 1), column.as_slice_mut(), &mut scratch)?;
        match column {
            swm_core::Column::I32(values) => Ok(values.into_iter().map(i64::from).collect()),
            swm_core::Column::I64(values) => Ok(values),
            other => Err(wrong_type(format!("it holds {}, not integers", other.dtype()))),
        }
    }
}

/// The elements of an array whose first index varies fastest, in the order in which the last one does.
fn by_row(bytes: &[u8], shape: &[usize], size: usize) -> Vec<u8> {
    let mut sorted = Vec::with_capacity(bytes.len());
    let mut index = vec![0; shape.len()];
    for _ in 0..bytes.len() / size.max(1) {
        let from = index.iter().zip(shape).rev().fold(0, |from, (&at, &size)| from * size + at);
        sorted.extend_from_slice(&bytes[from * size..][..size]);
        for (at, &size) in index.iter_mut().zip(shape).rev() {
            *at += 1;
            if *at < size {
                break;
            }
            *at = 0;
        }
    }
    sorted
}

/// Names of the arrays of an archive, without `.npy`.
///
/// # Errors
///
/// It is no archive, or damaged.
pub fn members(path: &Path) -> Result<Vec<String>> {
    let file = Readable::open(path)?;
    check_end(&file, file.length()?)?;
    let archive =
        ZipArchive::new(BufReader::new(Cursor::new(file)?)).map_err(|error| archive_error(error, ""))?;
    let mut names: Vec<String> =
        archive.file_names().filter_map(|name| name.strip_suffix(".npy").map(str::to_owned)).collect();
    names.sort();
    Ok(names)
}

/// Whether a zip archive ends here. The zip crate would look for the record through all of the file, however large.
///
/// # Errors
///
/// It is no archive, or was cut short.
pub fn check_end(file: &dyn ReadAt, length: u64) -> Result<()> {
    let count = length.min(MAX_END);
    let mut tail = vec![0; count as usize];
    read_exact_at(file, &mut tail, length - count)?;
    match tail.windows(END.len()).any(|bytes| bytes == END) {
        true => Ok(()),
        false => Err(invalid("it does not end as a zip archive")),
    }
}

/// Why the archive or its entry cannot be opened.
fn archive_error(error: ZipError, member: &str) -> FormatError {
    match error {
        ZipError::UnsupportedArchive(_) => unsupported(error.to_string()),
        ZipError::FileNotFound => missing(format!("{error}: `{member}`")),
        error => FormatError::other(error),
    }
}
