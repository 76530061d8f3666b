//! Where the bytes of one column lie, and reading rows of it: straight from the file by its chunk table (no global
//! lock, only what is wanted is decoded), or through the HDF5 library for everything unusual.

use std::fs::File;
use std::io;
use std::ops::Range;

use hdf5_metno::Dataset;
use hdf5_metno::dataset::Layout;
use hdf5_metno::datatype::ByteOrder;
use hdf5_metno::filters::{Blosc, BloscShuffle, Filter};
use swm_core::{Dtype, Field, SliceMut};
use swm_files::read_exact_at;

use super::checksum::{self, check_chunk};
use super::deflate::Inflated;
use super::encoding::StoredForm;
use super::fetch::Fetched;
use super::heap::{self, Heap};
use super::tiles::Tiles;
use super::{blosc, library};
use crate::dataset::{EncodedRow, EncodedRows, Steps};
use crate::error::{At as _, FormatError, Result, invalid};
use crate::formats::element::{self, Element};

/// One column of an open file.
#[derive(Debug)]
pub(super) struct ColumnStorage {
    element: Element,
    access: Access,
    encoding: Option<String>,
}

#[derive(Debug)]
enum Access {
    /// In chunks of whole rows (one chunk for all rows, if the dataset is not chunked), or of tiles of rows. The chunks of the same rows
    /// are next to each other.
    Chunks {
        rows_per_chunk: usize,
        row_bytes: usize,
        codec: Codec,
        checksummed: bool,
        tiles: Option<Tiles>,
        chunks: Vec<Chunk>,
    },
    /// Wherever the library finds it.
    Library(Dataset),
}

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Codec {
    /// Not at all.
    Plain,
    /// By blosc with LZ4.
    Blosc,
    /// By deflate; `shuffled` is the size of elements whose bytes were shuffled.
    Deflate { shuffled: Option<usize> },
}

#[derive(Clone, Copy, Debug, Default)]
struct Chunk {
    address: u64,
    size: u64,
}

/// Buffers of one reader.
#[derive(Debug, Default)]
pub struct Scratch {
    fetched: Fetched,
    rows: Vec<u8>,
    blosc: blosc::Scratch,
    inflated: Inflated,
    heap: Heap,
}

/// Adjacent chunks are fetched together, and gaps between strided rows with them, up to this size.
const FETCH_BYTES: u64 = 1 << 20;

impl ColumnStorage {
    pub(super) fn element(&self) -> Element {
        self.element
    }

    /// Finds out how the first `rows` rows of `dataset` are stored, in a file of this length.
    pub(super) fn of(
        dataset: Dataset,
        field: &Field,
        element: Element,
        rows: usize,
        file_length: u64,
    ) -> hdf5_metno::Result<Self> {
        let (access, encoding) = match direct(&dataset, field, element, rows, file_length)? {
            Some(access) => (access, StoredForm::of(&dataset, field)?.map(|form| form.name)),
            None => (Access::Library(dataset), None),
        };
        Ok(Self { element, access, encoding })
    }

    /// Whether the library reads it, and converts its elements.
    pub(super) fn is_by_library(&self) -> bool {
        matches!(self.access, Access::Library(_))
    }

    /// Why this column is not read, if it is a column of texts that only the library could read.
    pub(super) fn unread_text(&self, rows: usize) -> Option<&'static str> {
        match (self.is_by_library(), self.element) {
            (true, Element::FixedText(_)) => Some(library::FIXED_TEXT),
            (true, Element::Text | Element::AsciiText) if rows > 0 => Some(library::TEXT),
            _ => None,
        }
    }

    /// The first row that would lie behind the end of a file of this length.
    pub(super) fn first_row_behind(&self, file_length: u64) -> Option<usize> {
        let Access::Chunks { rows_per_chunk, codec, row_bytes, tiles, chunks, .. } = &self.access else {
            return None;
        };
        let cut = |chunk: &Chunk| chunk.address.checked_add(chunk.size).is_none_or(|end| end > file_length);
        let index = chunks.iter().position(cut)?;
        if let Some(tiles) = tiles {
            return Some(index / tiles.count() * rows_per_chunk);
        }
        // The last chunk of rows that are not compressed may be longer than what has been written of it.
        let whole = file_length.saturating_sub(chunks[index].address) as usize / (*row_bytes).max(1);
        Some(index * rows_per_chunk + if *codec == Codec::Plain { whole } else { 0 })
    }

    /// Reads rows, counted over the whole file, into `out`. The caller has checked that they exist and that `out`
    /// has their size and type.
    pub(super) fn read(
        &self,
        file: &File,
        field: &Field,
        rows: Steps,
        out: SliceMut<'_>,
        scratch: &mut Scratch,
    ) -> Result<()> {
        if out.is_empty() {
            return Ok(());
        }
        let row_bytes = match &self.access {
            Access::Chunks { row_bytes, .. } => row_bytes,
            Access::Library(dataset) => return library::read(dataset, self.element, field, rows, out),
        };
        match out {
            SliceMut::U8(bytes) if self.element == Element::U8 => self.read_bytes(file, rows, bytes, scratch),
            out => {
                let mut bytes = std::mem::take(&mut scratch.rows);
                bytes.resize(rows.count * row_bytes, 0);
                let read = self.read_bytes(file, rows, &mut bytes, scratch);
                let converted = read.and_then(|()| match out {
                    SliceMut::Str(out) if self.element.size().is_none() => {
                        texts(file, &bytes, out, &mut scratch.heap)
                    }
                    out => element::from_bytes(self.element, &bytes, out),
                });
                scratch.rows = bytes;
                converted
            }
        }
    }

    /// The bytes of rows of which each is one element of any length.
    pub(super) fn read_lists(&self, file: &File, rows: Steps, scratch: &mut Scratch) -> Result<Vec<Vec<u8>>> {
        let mut bytes = vec![0; rows.count * heap::REFERENCE];
        self.read_bytes(file, rows, &mut bytes, scratch)?;
        let references = bytes.as_chunks::<{ heap::REFERENCE }>().0.iter();
        references.map(|reference| Ok(scratch.heap.get(file, reference)?.to_vec())).collect()
    }

    /// Reads the stored form of rows, one after the other.
    fn read_bytes(&self, file: &File, rows: Steps, out: &mut [u8], scratch: &mut Scratch) -> Result<()> {
        let Access::Chunks { rows_per_chunk, row_bytes, codec, tiles, chunks, .. } = &self.access else {
            return Ok(());
        };
        scratch.fetched.forget();
        scratch.inflated.forget();
        scratch.heap.forget();
        let mut done = 0;
        while done < rows.count {
            let row = rows.first + done * rows.stride;
            let (index, within) = (row / rows_per_chunk, row % rows_per_chunk);
            // The wanted rows of this chunk.
            let count = (rows_per_chunk - within).div_ceil(rows.stride).min(rows.count - done);
            let part = &mut out[done * row_bytes..(done + count) * row_bytes];
            let here = Steps { first: within, count, stride: rows.stride };
            // Chunks that follow in the file come along, if every chunk is wanted.
            let ahead = || {
                let last = (rows.first + (rows.count - 1) * rows.stride) / rows_per_chunk;
                adjacent(&chunks[index..=if rows.stride <= *rows_per_chunk { last } else { index }])
            };
            let total = || rows_per_chunk * row_bytes;
            let read = match (tiles, *codec) {
                (Some(tiles), codec) => {
                    let of_rows = &chunks[index * tiles.count()..(index + 1) * tiles.count()];
                    let total = rows_per_chunk * tiles.bytes();
                    read_tiles(file, of_rows, tiles, (codec, total), here, part, scratch)
                }
                (None, Codec::Blosc) => {
                    read_compressed(file, chunks[index], ahead(), total(), here, part, scratch)
                }
                (None, Codec::Deflate { .. }) => {
                    read_deflated(file, chunks[index], ahead(), (*codec, total()), here, part, scratch)
                }
                (None, Codec::Plain) => {
                    let ahead = if *rows_per_chunk == 1 { ahead() } else { 0 };
                    read_plain(file, chunks[index], ahead, here, part, scratch).map_err(FormatError::from)
                }
            };
            read.at(format_args!("row {row}"))?;
            done += count;
        }
        Ok(())
    }

    /// Whether chunks have checksums that [`ColumnStorage::check`] compares.
    pub(super) fn is_checksummed(&self) -> bool {
        matches!(self.access, Access::Chunks { checksummed: true, .. })
    }

    /// Compares the checksums of the chunks that hold these rows, `first..end` over the whole file.
    pub(super) fn check(&self, file: &File, rows: Range<usize>, buffer: &mut Vec<u8>) -> Result<()> {
        let Access::Chunks { rows_per_chunk, checksummed: true, chunks, .. } = &self.access else {
            return Ok(());
        };
        if rows.is_empty() {
            return Ok(());
        }
        let (first, last) = (rows.start / rows_per_chunk, (rows.end - 1) / rows_per_chunk);
        for (index, &Chunk { address, size }) in chunks.iter().enumerate().take(last + 1).skip(first) {
            buffer.resize(size as usize, 0);
            read_exact_at(file, buffer, address)?;
            check_chunk(buffer).at(format_args!("row {}", index * rows_per_chunk))?;
        }
        Ok(())
    }

    /// How rows are stored, if each is a chunk of its own.
    pub(super) fn encoding(&self) -> Option<&str> {
        self.encoding.as_deref()
    }

    /// Reads the chunks of these rows, `first..end` over the whole file, where there is an encoding.
    pub(super) fn read_encoded(
        &self,
        file: &File,
        rows: Range<usize>,
        out: &mut EncodedRows,
        scratch: &mut Scratch,
    ) -> Result<()> {
        out.clear();
        scratch.fetched.forget();
        let Access::Chunks { chunks, .. } = &self.access else { return Ok(()) };
        for row in rows.clone() {
            let Chunk { address, size } = chunks[row];
            let stored = scratch.fetched.get(file, address, size, adjacent(&chunks[row..rows.end]))?;
            // Copied damage would look sound: the other columns are not read with it.
            check_chunk(stored).at(format_args!("row {row}"))?;
            out.push(EncodedRow { bytes: stored, is_compressed: true });
        }
        Ok(())
    }

    /// The address behind the last chunk of a dataset, whatever its layout; 0 if it has none.
    pub(super) fn chunks_end(dataset: &Dataset) -> hdf5_metno::Result<u64> {
        let mut end = 0;
        if dataset.is_chunked() {
            dataset.chunks_visit(|chunk| {
                end = end.max(chunk.addr.saturating_add(chunk.size));
                0
            })?;
        }
        Ok(end)
    }
}

/// The texts that references name.
fn texts(file: &File, references: &[u8], out: &mut [String], heap: &mut Heap) -> Result<()> {
    for (text, reference) in out.iter_mut().zip(references.as_chunks().0) {
        *text = element::text(heap.get(file, reference)?)?;
    }
    Ok(())
}

/// Rows of a compressed chunk of `total` bytes.
fn read_compressed(
    file: &File,
    chunk: Chunk,
    ahead: u64,
    total: usize,
    rows: Steps,
    out: &mut [u8],
    scratch: &mut Scratch,
) -> Result<()> {
    let Scratch { fetched, blosc: buffers, .. } = scratch;
    let bytes = fetched.get(file, chunk.address, chunk.size, ahead)?;
    let row_bytes = out.len() / rows.count;
    // Neighboring rows are decoded in one go.
    let piece = if rows.stride == 1 { rows.count } else { 1 };
    for (index, into) in out.chunks_exact_mut(piece * row_bytes).enumerate() {
        let start = (rows.first + index * rows.stride) * row_bytes;
        let decoded = blosc::decode(bytes, total, start..start + into.len(), into, buffers);
        decoded.map_err(|reason| invalid(format!("its chunk is {reason}")))?;
    }
    Ok(())
}

/// A whole chunk of `total` bytes, which is deflated, or stored as it is.
fn whole<'a>(
    file: &File,
    chunk: Chunk,
    ahead: u64,
    (codec, total): (Codec, usize),
    scratch: &'a mut Scratch,
) -> Result<&'a [u8]> {
    let Scratch { fetched, inflated, .. } = scratch;
    let Codec::Deflate { shuffled } = codec else {
        return Ok(fetched.get(file, chunk.address, chunk.size, ahead)?);
    };
    if inflated.held(chunk.address).is_none() {
        let bytes = fetched.get(file, chunk.address, chunk.size, ahead)?;
        let decoded = inflated.decode(chunk.address, bytes, total, shuffled);
        decoded.map_err(|reason| invalid(format!("its chunk is {reason}")))?;
    }
    Ok(inflated.held(chunk.address).unwrap_or_default())
}

/// Rows of a chunk that can only be decoded as a whole.
fn read_deflated(
    file: &File,
    chunk: Chunk,
    ahead: u64,
    of: (Codec, usize),
    rows: Steps,
    out: &mut [u8],
    scratch: &mut Scratch,
) -> Result<()> {
    let bytes = whole(file, chunk, ahead, of, scratch)?;
    let row_bytes = out.len() / rows.count;
    for (index, into) in out.chunks_exact_mut(row_bytes).enumerate() {
        let start = (rows.first + index * rows.stride) * row_bytes;
        let stored = bytes.get(start..start + row_bytes).ok_or(invalid("its chunk is cut short"))?;
        into.copy_from_slice(stored);
    }
    Ok(())
}

/// Rows whose tiles are in these chunks, each of which is decoded once.
fn read_tiles(
    file: &File,
    chunks: &[Chunk],
    tiles: &Tiles,
    of: (Codec, usize),
    rows: Steps,
    out: &mut [u8],
    scratch: &mut Scratch,
) -> Result<()> {
    let row_bytes = out.len() / rows.count;
    for (index, chunk) in chunks.iter().enumerate() {
        let bytes = whole(file, *chunk, adjacent(&chunks[index..]), of, scratch)?;
        let stored = bytes.chunks_exact(tiles.bytes()).skip(rows.first).step_by(rows.stride);
        let rows = out.chunks_exact_mut(row_bytes);
        rows.zip(stored).for_each(|(row, stored)| tiles.place(index, stored, row));
    }
    Ok(())
}

/// Rows of a chunk that is not compressed: together with what lies between them, if that is little.
fn read_plain(
    file: &File,
    chunk: Chunk,
    ahead: u64,
    rows: Steps,
    out: &mut [u8],
    scratch: &mut Scratch,
) -> io::Result<()> {
    let row_bytes = out.len() / rows.count;
    let address = |row: usize| chunk.address + (row * row_bytes) as u64;
    let span = (((rows.count - 1) * rows.stride + 1) * row_bytes) as u64;
    if span <= FETCH_BYTES {
        let bytes = scratch.fetched.get(file, address(rows.first), span, ahead)?;
        for (into, from) in out.chunks_exact_mut(row_bytes).zip(bytes.chunks(row_bytes).step_by(rows.stride))
        {
            into.copy_from_slice(from);
        }
        return Ok(());
    }
    if rows.stride == 1 {
        return read_exact_at(file, out, address(rows.first));
    }
    let mut each = out.chunks_exact_mut(row_bytes).enumerate();
    each.try_for_each(|(index, into)| read_exact_at(file, into, address(rows.first + index * rows.stride)))
}

/// The table of chunks, if the bytes can be read without the library.
fn direct(
    dataset: &Dataset,
    field: &Field,
    element: Element,
    rows: usize,
    file_length: u64,
) -> hdf5_metno::Result<Option<Access>> {
    let size = match (element.size(), dataset.dtype()?.byte_order()) {
        (Some(size), ByteOrder::LittleEndian | ByteOrder::None) => size,
        (None, _) if heap::is_common(dataset)? => heap::REFERENCE,
        _ => return Ok(None),
    };
    let row_bytes = field.dim() * size;
    let mut filters = &dataset.dcpl()?.get_filters()?[..];
    let checksummed = filters.last() == Some(&Filter::Fletcher32);
    filters = if checksummed { &filters[..filters.len() - 1] } else { filters };
    let codec = match *filters {
        [] => Codec::Plain,
        [Filter::Blosc(Blosc::LZ4 | Blosc::LZ4HC, _, BloscShuffle::None | BloscShuffle::Byte)] => {
            Codec::Blosc
        }
        [Filter::Deflate(_)] if !checksummed => Codec::Deflate { shuffled: None },
        [Filter::Shuffle, Filter::Deflate(_)] if !checksummed => Codec::Deflate { shuffled: Some(size) },
        _ => return Ok(None),
    };
    let checksum_bytes = if checksummed { checksum::BYTES as u64 } else { 0 };
    if dataset.layout() == Layout::Contiguous {
        let access = dataset.offset().map(|address| {
            let chunks = vec![Chunk { address, size: (rows * row_bytes) as u64 }];
            Access::Chunks {
                rows_per_chunk: usize::MAX,
                row_bytes,
                codec: Codec::Plain,
                checksummed: false,
                tiles: None,
                chunks,
            }
        });
        return Ok(access);
    }
    let Some(chunk) = dataset.chunk().filter(|chunk| chunk.first().is_some_and(|&rows| rows > 0)) else {
        return Ok(None);
    };
    let rows_per_chunk = chunk[0];
    let is_cut = chunk[1..] != field.shape;
    let can_be_cut = element.dtype() != Dtype::Str && !checksummed && codec != Codec::Blosc;
    if is_cut && !can_be_cut {
        return Ok(None);
    }
    let Some(tiles) = Tiles::new(&field.shape, &chunk[1..], size) else { return Ok(None) };
    let expected = rows.div_ceil(rows_per_chunk).checked_mul(tiles.count());
    let chunk_bytes = tiles.bytes().checked_mul(rows_per_chunk);
    let (Some(expected), Some(chunk_bytes)) = (expected, chunk_bytes) else { return Ok(None) };
    // More chunks than fit the file are not worth a table: missing ones stand for the fill value.
    let smallest = match codec {
        Codec::Plain => chunk_bytes as u64,
        Codec::Blosc => blosc::HEADER as u64,
        Codec::Deflate { .. } => 1,
    };
    if (expected as u64).checked_mul(smallest).is_none_or(|bytes| bytes > file_length) {
        return Ok(None);
    }
    let mut chunks = vec![Chunk::default(); expected];
    let mut plain = true;
    dataset.chunks_visit(|info| {
        let index = info.offset.split_first().and_then(|(&row, places)| {
            (row as usize / rows_per_chunk).checked_mul(tiles.count())?.checked_add(tiles.index(places)?)
        });
        if let Some(chunk) = index.and_then(|index| chunks.get_mut(index)) {
            *chunk = Chunk { address: info.addr, size: info.size };
            let expected = chunk_bytes as u64 + checksum_bytes;
            plain &= info.filter_mask == 0 && (codec != Codec::Plain || info.size == expected);
        }
        0
    })?;
    let complete = chunks.iter().all(|chunk| chunk.size > 0);
    let tiles = is_cut.then_some(tiles);
    let access = Access::Chunks { rows_per_chunk, row_bytes, codec, checksummed, tiles, chunks };
    Ok((plain && complete).then_some(access))
}

/// How many bytes from the start of the first chunk on belong to chunks that follow each other in the file.
fn adjacent(chunks: &[Chunk]) -> u64 {
    let Some((first, rest)) = chunks.split_first() else { return 0 };
    let mut bytes = first.size;
    for chunk in rest {
        if chunk.address != first.address + bytes || bytes + chunk.size > FETCH_BYTES {
            break;
        }
        bytes += chunk.size;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_tiles_are_read_without_the_library() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.h5");
        let file = hdf5_metno::File::create(&path).unwrap();
        let make = || file.new_dataset::<u8>().shape((40, 21, 20, 3)).chunk((7, 8, 9, 1));
        let values = ndarray::Array4::<u8>::zeros((40, 21, 20, 3));
        make().create("plain").unwrap();
        make().deflate(4).create("gzip").unwrap();
        make().shuffle().deflate(4).create("shuffled").unwrap();
        make().fletcher32().create("checked").unwrap();
        make().lzf().create("lzf").unwrap();
        let field = Field::step("pixels", Dtype::U8, &[21, 20, 3]);
        for (name, is_direct) in
            [("plain", true), ("gzip", true), ("shuffled", true), ("checked", false), ("lzf", false)]
        {
            let dataset = file.dataset(name).unwrap();
            dataset.write(&values).unwrap();
            file.flush().unwrap();
            let length = path.metadata().unwrap().len();
            let storage = ColumnStorage::of(dataset, &field, Element::U8, 40, length).unwrap();
            assert_eq!(matches!(storage.access, Access::Chunks { tiles: Some(_), .. }), is_direct, "{name}");
        }
    }
}
