//! An `.npz` file that grows by rows: values are appended in the place of the archive's directory, the directory is
//! written behind them again, and the number of rows in the head is set. Numpy can open the file after every append.
//!
//! Killed between these steps, it lacks a directory; but values always begin at the same byte and earlier ones are
//! never touched, so whoever knows the number of rows can read it ([`Array::open_growing`](super::Array)).
//!
//! Source of the format: PKWARE's APPNOTE 6.3, with the 64-bit fields always there, as numpy writes them.

use std::fs::File;
use std::path::Path;

use crc32fast::Hasher;
use swm_core::{Field, Slice};
use swm_files::{open_own, read_exact_at, write_all_at};

use super::archive::ENTRY;
use super::header::{self, HEAD_BYTES, Head, TEXT_CHARACTERS};
use crate::error::{Result, invalid, wrong_type};
use crate::formats::element;

/// Bytes before the array: the entry's own header, its name, its sizes in 64 bits.
const ENTRY_BYTES: u64 = 30 + ENTRY.len() as u64 + 20;
/// Where values begin.
pub(super) const VALUES: u64 = ENTRY_BYTES + HEAD_BYTES as u64;
/// The first day that the format knows: no time reaches the file.
const DATE: u16 = 0x21;
/// "Needs version 4.5": 64-bit sizes.
const VERSION: u16 = 45;
const NOT_HERE: u32 = u32::MAX;
/// Values that are read at once to continue a checksum.
const PIECE: usize = 1 << 20;

/// An array that is being recorded.
#[derive(Debug)]
pub(in crate::formats) struct GrowingArray {
    file: File,
    field: Field,
    rows: usize,
    /// Bytes of values.
    size: u64,
    checksum: Hasher,
    buffer: Vec<u8>,
}

impl GrowingArray {
    /// A new file without rows.
    pub(in crate::formats) fn create(path: &Path, field: &Field) -> Result<Self> {
        let file = open_own(path, true)?;
        file.set_len(0)?;
        let mut array = Self {
            file,
            field: field.clone(),
            rows: 0,
            size: 0,
            checksum: Hasher::new(),
            buffer: Vec::new(),
        };
        array.finish_rows(0)?;
        Ok(array)
    }

    /// Continues a file of ours behind its first `rows` rows; later ones are forgotten.
    pub(in crate::formats) fn reopen(path: &Path, field: &Field, rows: usize) -> Result<Self> {
        let file = open_own(path, false)?;
        let found = head(&file)?;
        let expected = Head::parse(&header::format(field, rows)?)?;
        if found.elements != expected.elements || found.shape.get(1..) != expected.shape.get(1..) {
            return Err(wrong_type(format!(
                "it holds {:?} {:?} instead of `{}`",
                found.elements, found.shape, field.name
            )));
        }
        let mut left = rows * field.dim() * expected.elements.size();
        let (mut checksum, mut buffer) = (Hasher::new(), Vec::new());
        let mut size = 0;
        while left > 0 {
            buffer.resize(left.min(PIECE), 0);
            read_exact_at(&file, &mut buffer, VALUES + size)?;
            checksum.update(&buffer);
            left -= buffer.len();
            size += buffer.len() as u64;
        }
        Ok(Self { file, field: field.clone(), rows, size, checksum, buffer })
    }

    /// Appends values of `rows` rows and returns their checksum. They count once they have been committed elsewhere.
    pub(in crate::formats) fn append(&mut self, rows: usize, values: Slice<'_>) -> Result<Hasher> {
        self.buffer.clear();
        to_bytes(values, &mut self.buffer)?;
        write_all_at(&self.file, &self.buffer, VALUES + self.size)?;
        let mut checksum = Hasher::new();
        checksum.update(&self.buffer);
        self.checksum.combine(&checksum);
        self.size += self.buffer.len() as u64;
        self.finish_rows(rows)?;
        Ok(checksum)
    }

    /// Brings what was appended to the disk.
    pub(in crate::formats) fn sync(&self) -> Result<()> {
        Ok(self.file.sync_all()?)
    }

    /// Makes the file one that numpy opens.
    pub(in crate::formats) fn finish_rows(&mut self, more: usize) -> Result<()> {
        self.rows += more;
        let head = header::format(&self.field, self.rows)?;
        let mut checksum = Hasher::new();
        checksum.update(&head);
        checksum.combine(&self.checksum);
        let (checksum, size) = (checksum.finalize(), HEAD_BYTES as u64 + self.size);
        let directory = directory(checksum, size);
        let end = VALUES + self.size;
        let entry = entry(checksum, size);
        write_all_at(&self.file, &directory, end)?;
        self.file.set_len(end + directory.len() as u64)?;
        Ok(write_all_at(&self.file, &[entry, head].concat(), 0)?)
    }
}

/// The head of an array of ours.
pub(super) fn head(file: &File) -> Result<Head> {
    let mut bytes = vec![0; VALUES as usize];
    read_exact_at(file, &mut bytes, 0).map_err(|_| invalid("it is shorter than its head"))?;
    let (entry, head) = bytes.split_at(ENTRY_BYTES as usize);
    if !entry.starts_with(b"PK\x03\x04") || !entry[30..].starts_with(ENTRY.as_bytes()) {
        return Err(invalid("it is no array of this program"));
    }
    let head = Head::parse(head)?;
    match head.bytes == HEAD_BYTES {
        true => Ok(head),
        false => Err(invalid("it is no array of this program")),
    }
}

/// What stands before the array.
fn entry(checksum: u32, size: u64) -> Vec<u8> {
    let mut bytes = b"PK\x03\x04".to_vec();
    for field in [VERSION, 0, 0, 0, DATE] {
        bytes.extend(field.to_le_bytes());
    }
    for field in [checksum, NOT_HERE, NOT_HERE] {
        bytes.extend(field.to_le_bytes());
    }
    for field in [ENTRY.len() as u16, 20] {
        bytes.extend(field.to_le_bytes());
    }
    bytes.extend(ENTRY.as_bytes());
    extend_sizes(&mut bytes, size);
    bytes
}

/// What stands behind the array.
fn directory(checksum: u32, size: u64) -> Vec<u8> {
    let start = ENTRY_BYTES + size;
    let mut bytes = b"PK\x01\x02".to_vec();
    for field in [VERSION, VERSION, 0, 0, 0, DATE] {
        bytes.extend(field.to_le_bytes());
    }
    for field in [checksum, NOT_HERE, NOT_HERE] {
        bytes.extend(field.to_le_bytes());
    }
    for field in [ENTRY.len() as u16, 20, 0, 0, 0, 0, 0, 0, 0] {
        bytes.extend(field.to_le_bytes());
    }
    bytes.extend(ENTRY.as_bytes());
    extend_sizes(&mut bytes, size);
    let directory = bytes.len() as u64;

    bytes.extend(b"PK\x06\x06");
    bytes.extend(44u64.to_le_bytes());
    bytes.extend([VERSION.to_le_bytes(), VERSION.to_le_bytes()].concat());
    bytes.extend([0; 8]);
    for field in [1, 1, directory, start] {
        bytes.extend(u64::to_le_bytes(field));
    }
    bytes.extend(b"PK\x06\x07");
    bytes.extend([0; 4]);
    bytes.extend((start + directory).to_le_bytes());
    bytes.extend(1u32.to_le_bytes());
    bytes.extend(b"PK\x05\x06");
    for field in [0u16, 0, 1, 1] {
        bytes.extend(field.to_le_bytes());
    }
    bytes.extend((directory as u32).to_le_bytes());
    bytes.extend(NOT_HERE.to_le_bytes());
    bytes.extend([0; 2]);
    bytes
}

fn extend_sizes(bytes: &mut Vec<u8>, size: u64) {
    bytes.extend([1, 0, 16, 0]);
    bytes.extend(size.to_le_bytes());
    bytes.extend(size.to_le_bytes());
}

fn to_bytes(values: Slice<'_>, out: &mut Vec<u8>) -> Result<()> {
    match values {
        Slice::Bool(values) => out.extend(values.iter().map(|&value| u8::from(value))),
        Slice::U8(values) => out.extend(values),
        Slice::I32(values) => out.extend(values.iter().flat_map(|value| value.to_le_bytes())),
        Slice::I64(values) => out.extend(values.iter().flat_map(|value| value.to_le_bytes())),
        Slice::F32(values) => out.extend(values.iter().flat_map(|value| value.to_le_bytes())),
        Slice::F64(values) => out.extend(values.iter().flat_map(|value| value.to_le_bytes())),
        Slice::Str(values) => {
            for value in values {
                let count = value.chars().count();
                if value.contains('\0') {
                    return Err(invalid("a text contains the character NUL"));
                }
                if count > TEXT_CHARACTERS {
                    return Err(element::long_text(count, TEXT_CHARACTERS, "characters"));
                }
                out.extend(value.chars().flat_map(|character| u32::from(character).to_le_bytes()));
                out.resize(out.len() + 4 * (TEXT_CHARACTERS - count), 0);
            }
        }
    }
    Ok(())
}
