//! Rows of an array of Zarr, out of chunks that are decoded whole and kept for a while.

use std::sync::Arc;

use swm_core::{Dtype, SliceMut};
use swm_data::dataset::Steps;
use swm_data::element::Element;
use swm_data::error::{At as _, Result, invalid, unsupported, wrong_type};
use swm_data::npz::ArrayType;

use super::meta::Meta;
use super::store::Store;
use crate::array::{Array, Scratch, new_key};

/// Chunks above this size are compared with what is stored of them…
const LARGE: usize = 64 << 20;
/// …of which no codec makes more than so many times its bytes: zstd writes 128 KiB of equal ones in 4.
const MAX_RATIO: usize = 1 << 15;
/// Chunks of one row.
const MAX_CHUNKS: usize = 1 << 16;
/// Where the list of a shard has no chunk.
const NONE: u64 = u64::MAX;

/// An open array.
#[derive(Debug)]
pub(super) struct ZarrArray {
    store: Arc<Store>,
    /// Its path in the store.
    path: String,
    meta: Meta,
    /// Of its decoded rows, and of the lists of its shards.
    keys: [usize; 2],
}

/// Rows of the chunks that begin with one row.
enum Rows {
    Bytes(Vec<u8>),
    /// None of the chunks is stored.
    Fill,
}

impl ZarrArray {
    pub(super) fn open(store: &Arc<Store>, path: &str) -> Result<Self> {
        let meta = Meta::read(store, path)?;
        Ok(Self { store: store.clone(), path: path.to_owned(), meta, keys: [new_key(), new_key()] })
    }

    /// Bytes of a row.
    fn row_bytes(&self) -> usize {
        self.meta.shape[1..].iter().product::<usize>() * self.meta.elements.size()
    }

    /// The rows of the chunks that are number `at` along the first axis, and their bytes.
    fn decoded(&self, at: usize, scratch: &mut Scratch) -> Result<(Rows, usize)> {
        let Meta { shape, chunk, elements, fill, .. } = &self.meta;
        let rows = chunk[0].min(shape[0] - at * chunk[0]);
        let counts: Vec<usize> =
            shape[1..].iter().zip(&chunk[1..]).map(|(all, one)| all.div_ceil(*one)).collect();
        let (count, size) = (counts.iter().product::<usize>(), rows * self.row_bytes());
        if count > MAX_CHUNKS {
            return Err(unsupported(format!("a row in {count} chunks is not read; store rows in fewer")));
        }
        let is_plain = count == 1
            && chunk[1..] == shape[1..]
            && self.meta.order.iter().enumerate().all(|(axis, &from)| axis == from);
        let (mut place, mut out) = (vec![0; shape.len()], Vec::new());
        place[0] = at;
        for number in 0..count {
            let mut rest = number;
            for axis in (0..counts.len()).rev() {
                place[axis + 1] = rest % counts[axis];
                rest /= counts[axis];
            }
            let Some(bytes) = self.stored(&place, scratch)? else { continue };
            for claimed in [size / count, self.chunk_bytes()] {
                if claimed > LARGE && claimed / MAX_RATIO > bytes.len() {
                    return Err(invalid(format!(
                        "a chunk claims {claimed} bytes, and {} are stored",
                        bytes.len()
                    )));
                }
            }
            let mut decoded = self.unpacked(bytes).at(format_args!("chunk {place:?}"))?;
            if self.meta.is_big_endian {
                elements.swap(&mut decoded);
            }
            if is_plain {
                decoded.truncate(size);
                out = decoded;
                break;
            }
            if out.is_empty() {
                out = fill.iter().copied().cycle().take(size).collect();
            }
            self.place(&decoded, &place, rows, &mut out);
        }
        let held = out.len();
        Ok((if out.is_empty() { Rows::Fill } else { Rows::Bytes(out) }, held))
    }

    /// Bytes of a chunk as it was before it was stored.
    fn chunk_bytes(&self) -> usize {
        self.meta.chunk.iter().product::<usize>() * self.meta.elements.size()
    }

    /// A chunk as it is stored; `None` where it is not.
    fn stored(&self, place: &[usize], scratch: &mut Scratch) -> Result<Option<Vec<u8>>> {
        let Some(shards) = &self.meta.shards else {
            return self.store.bytes(&self.meta.keys.of(&self.path, place));
        };
        let shard: Vec<usize> = place.iter().zip(&shards.chunks).map(|(at, count)| at / count).collect();
        let inner = place.iter().zip(&shards.chunks).fold(0, |all, (at, count)| all * count + at % count);
        let sizes = self.meta.chunk.iter().zip(&shards.chunks).map(|(chunk, count)| chunk * count);
        let counts = self.meta.shape.iter().zip(sizes).map(|(all, size)| all.div_ceil(size));
        let number = shard.iter().zip(counts).fold(0, |all, (at, count)| all * count + at);
        let key = self.meta.keys.of(&self.path, &shard);
        let list = scratch.part((self.keys[1], number), |_| {
            let list = self.list(&key).at(format_args!("the list of chunks of `{key}`"))?;
            let bytes = list.as_ref().map_or(0, |list| 16 * list.len());
            Ok((list, bytes))
        })?;
        let Some(&[start, length]) = list.as_ref().and_then(|list| list.get(inner)) else { return Ok(None) };
        if start == NONE && length == NONE {
            return Ok(None);
        }
        let end = start.checked_add(length).ok_or_else(|| invalid("a chunk of a shard ends nowhere"))?;
        self.store.part(&key, start..end)
    }

    /// Where the chunks of a shard are in its file, and their bytes; `None` if there is no file.
    fn list(&self, key: &str) -> Result<Option<Vec<[u64; 2]>>> {
        let (Some(shards), Some(length)) = (&self.meta.shards, self.store.length(key)?) else {
            return Ok(None);
        };
        let size = shards.index_bytes();
        let start = match shards.is_index_first {
            true => Some(0),
            false => length.checked_sub(size),
        };
        let start = start.filter(|_| size <= length).ok_or_else(|| invalid("it is cut short"))?;
        let Some(mut bytes) = self.store.part(key, start..start + size)? else { return Ok(None) };
        if shards.has_checksum {
            bytes = super::codec::checked(bytes)?;
        }
        let numbers = bytes.as_chunks::<16>().0.iter().map(|pair| {
            let [start, length] = [0, 8]
                .map(|at| pair[at..at + 8].iter().rev().fold(0, |all, &byte| all << 8 | u64::from(byte)));
            [start, length]
        });
        Ok(Some(numbers.collect()))
    }

    /// The bytes of a chunk in the order in which they were stored.
    fn unpacked(&self, bytes: Vec<u8>) -> Result<Vec<u8>> {
        let size = self.chunk_bytes();
        let mut bytes = bytes;
        for (at, codec) in self.meta.codecs.iter().enumerate() {
            let is_last = at + 1 == self.meta.codecs.len();
            // Between two codecs there is hardly more than in the end.
            bytes = codec.decode(bytes, if is_last { size } else { size + size / 8 + (1 << 16) })?;
        }
        match bytes.len() == size {
            true => Ok(bytes),
            false => Err(invalid(format!(
                "it has {} bytes, {size} make a chunk of {:?}",
                bytes.len(),
                self.meta.chunk
            ))),
        }
    }

    /// Puts what a chunk has of the rows into these.
    fn place(&self, chunk: &[u8], place: &[usize], rows: usize, out: &mut [u8]) {
        let Meta { shape, chunk: sizes, elements, order, .. } = &self.meta;
        let (axes, size) = (shape.len(), elements.size());
        let mut strides = vec![[size; 2]; axes];
        for axis in (0..axes - 1).rev() {
            strides[axis][1] = strides[axis + 1][1] * shape[axis + 1];
        }
        let mut step = size;
        for &axis in order.iter().rev() {
            strides[axis][0] = step;
            step *= sizes[axis];
        }
        let begin = |axis: usize| if axis == 0 { 0 } else { place[axis] * sizes[axis] };
        let limit = |axis: usize| if axis == 0 { rows } else { shape[axis] };
        let counts: Vec<usize> = (0..axes).map(|axis| sizes[axis].min(limit(axis) - begin(axis))).collect();
        let first: usize = (0..axes).map(|axis| begin(axis) * strides[axis][1]).sum();
        copy(chunk, &mut out[first..], &counts, &strides, size);
    }
}

/// Copies a box of elements; `strides` are bytes from one to the next along each axis, in the source and in the target.
fn copy(from: &[u8], out: &mut [u8], counts: &[usize], strides: &[[usize; 2]], size: usize) {
    let (&[count, ref counts @ ..], &[[source, target], ref strides @ ..]) = (counts, strides) else {
        return;
    };
    if counts.is_empty() && source == size && target == size {
        out[..count * size].copy_from_slice(&from[..count * size]);
        return;
    }
    for at in 0..count {
        let (from, out) = (&from[at * source..], &mut out[at * target..]);
        match counts.is_empty() {
            true => out[..size].copy_from_slice(&from[..size]),
            false => copy(from, out, counts, strides, size),
        }
    }
}

impl Array for ZarrArray {
    fn dtype(&self) -> Dtype {
        self.meta.elements.dtype()
    }

    fn rows(&self) -> usize {
        self.meta.shape[0]
    }

    fn shape(&self) -> &[usize] {
        &self.meta.shape[1..]
    }

    fn is_u64(&self) -> bool {
        self.meta.elements == ArrayType::Plain(Element::U64)
    }

    fn read(&self, rows: Steps, mut out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let (size, dim, per_chunk) = (self.row_bytes(), self.dim(), self.meta.chunk[0]);
        if rows.end().is_none_or(|end| end > self.rows()) || out.len() != rows.count * dim {
            return Err(wrong_type(format!("it has {} rows of {:?}", self.rows(), self.shape())));
        }
        let fill: Vec<u8> = self.meta.fill.iter().copied().cycle().take(size).collect();
        let mut index = 0;
        while index < rows.count {
            let row = rows.first + index * rows.stride;
            let chunk = row / per_chunk;
            let decoded = scratch.part((self.keys[0], chunk), |scratch| self.decoded(chunk, scratch))?;
            // Of all rows that are in it.
            while index < rows.count && (rows.first + index * rows.stride) / per_chunk == chunk {
                let at = (rows.first + index * rows.stride) % per_chunk * size;
                let bytes = match decoded {
                    Rows::Bytes(bytes) => {
                        bytes.get(at..at + size).ok_or_else(|| invalid("a chunk is cut short"))?
                    }
                    Rows::Fill => &fill,
                };
                let (one, rest) = out.split_at(dim);
                self.meta.elements.convert(bytes, one)?;
                (out, index) = (rest, index + 1);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_copied_in_any_order_of_axes() {
        // Two rows of three, column by column.
        let from = [1, 4, 2, 5, 3, 6];
        let mut out = [0; 6];
        copy(&from, &mut out, &[2, 3], &[[1, 3], [2, 1]], 1);
        assert_eq!(out, [1, 2, 3, 4, 5, 6]);
        let mut out = [9; 8];
        copy(&from, &mut out, &[2, 2], &[[3, 4], [1, 1]], 1);
        assert_eq!(out, [1, 4, 9, 9, 5, 3, 9, 9]);
    }
}
