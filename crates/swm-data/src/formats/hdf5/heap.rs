//! Values of any length. A stored element is a reference: a length, the address of a collection of the file's global heap, and the
//! number of an object in it. Both are read here and not by the library, which has no bound for its way through a damaged
//! collection.
//!
//! Source: HDF5 file format specification 3.0, section III.E (global heap), and section IV.A.2.d for the references.

use std::fs::File;
use std::ops::Range;

use hdf5_metno::Location;
use swm_files::read_exact_at;

use crate::error::{At as _, Result, invalid};

/// Size in bytes of a reference, where addresses have 8 bytes: length (4), address (8), number (4).
pub(super) const REFERENCE: usize = 16;
/// Size of what a collection begins with, and of what an object begins with.
const HEADER: usize = 16;
const SIGNATURE: [u8; 5] = *b"GCOL\x01";
/// A collection above this size is taken for damage.
const MAX_BYTES: u64 = 256 << 20;

/// Whether addresses have 8 bytes and count from the file's first byte. All libraries of today's machines write so, unless asked.
pub(super) fn is_common(object: &Location) -> hdf5_metno::Result<bool> {
    let made = object.file()?.fcpl()?;
    let sizes = made.sizes();
    Ok(made.userblock() == 0 && sizes.sizeof_addr as usize == 8 && sizes.sizeof_size as usize == 8)
}

/// The collection that was read last: neighboring rows share one.
#[derive(Debug, Default)]
pub(super) struct Heap {
    address: Option<u64>,
    bytes: Vec<u8>,
    /// Number and place of each object, by number.
    objects: Vec<(u16, Range<usize>)>,
}

impl Heap {
    /// Empties it: the file may have changed.
    pub(super) fn forget(&mut self) {
        self.address = None;
    }

    /// The bytes that a reference names.
    pub(super) fn get(&mut self, file: &File, reference: &[u8; REFERENCE]) -> Result<&[u8]> {
        let [length, address, number] = fields(reference);
        if length == 0 {
            return Ok(&[]);
        }
        if self.address != Some(address) {
            self.forget();
            read_collection(file, address, &mut self.bytes).at(format_args!("the heap at byte {address}"))?;
            self.objects = objects(&self.bytes).at(format_args!("the heap at byte {address}"))?;
            self.address = Some(address);
        }
        let found = self.objects.binary_search_by_key(&number, |(number, _)| u64::from(*number));
        let place = found.ok().map(|at| self.objects[at].1.clone());
        let bytes = place.and_then(|place| self.bytes[place].get(..length as usize));
        bytes.ok_or_else(|| {
            invalid(format!("the heap at byte {address} has no object {number} of {length} bytes"))
        })
    }
}

/// Length, address and number.
fn fields(reference: &[u8; REFERENCE]) -> [u64; 3] {
    let [a, b, c, d, address @ .., e, f, g, h] = *reference;
    let number = |bytes| u64::from(u32::from_le_bytes(bytes));
    [number([a, b, c, d]), u64::from_le_bytes(address), number([e, f, g, h])]
}

fn read_collection(file: &File, address: u64, bytes: &mut Vec<u8>) -> Result<()> {
    let mut header = [0; HEADER];
    read_exact_at(file, &mut header, address)?;
    let (start, size) = (&header[..SIGNATURE.len()], eight(&header[8..]));
    if start != SIGNATURE || !(HEADER as u64..=MAX_BYTES).contains(&size) {
        return Err(invalid("it is none"));
    }
    bytes.resize(size as usize, 0);
    Ok(read_exact_at(file, bytes, address)?)
}

/// The objects of a collection, by number.
fn objects(collection: &[u8]) -> Result<Vec<(u16, Range<usize>)>> {
    let (mut found, mut at) = (Vec::new(), HEADER);
    while let Some(header) = collection.get(at..at + HEADER) {
        let number = u16::from_le_bytes([header[0], header[1]]);
        // The rest is free.
        if number == 0 {
            break;
        }
        let start = at + HEADER;
        let end = usize::try_from(eight(&header[8..])).ok().and_then(|size| start.checked_add(size));
        let Some(end) = end.filter(|end| *end <= collection.len()) else {
            return Err(invalid(format!("its object {number} lies behind its end")));
        };
        found.push((number, start..end));
        at = end.next_multiple_of(8);
    }
    found.sort_by_key(|(number, _)| *number);
    Ok(found)
}

/// The number in the first 8 bytes, of which there are as many.
fn eight(bytes: &[u8]) -> u64 {
    bytes.first_chunk().copied().map_or(0, u64::from_le_bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn object(number: u16, declared: u64, text: &[u8]) -> Vec<u8> {
        let mut bytes = number.to_le_bytes().to_vec();
        bytes.extend([0; 6]);
        bytes.extend(declared.to_le_bytes());
        bytes.extend(text);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    fn reference(length: u32, address: u64, number: u32) -> [u8; REFERENCE] {
        let bytes = [&length.to_le_bytes()[..], &address.to_le_bytes(), &number.to_le_bytes()].concat();
        bytes.try_into().unwrap()
    }

    /// A file with a collection of these objects at byte 8.
    fn file(objects: &[Vec<u8>], declared: Option<u64>) -> File {
        let objects = objects.concat();
        let size = declared.unwrap_or((HEADER + objects.len()) as u64);
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&[&[0; 8][..], b"GCOL\x01\0\0\0", &size.to_le_bytes(), &objects].concat()).unwrap();
        file
    }

    #[test]
    fn objects_are_found_by_their_number() {
        let file = file(&[object(2, 5, b"hello"), object(1, 3, b"abc"), object(0, 0, b"")], None);
        let mut heap = Heap::default();
        assert_eq!(heap.get(&file, &reference(5, 8, 2)).unwrap(), b"hello");
        assert_eq!(heap.get(&file, &reference(3, 8, 1)).unwrap(), b"abc");
        assert_eq!(heap.get(&file, &reference(2, 8, 1)).unwrap(), b"ab");
        assert_eq!(heap.get(&file, &reference(0, u64::MAX, 0)).unwrap(), b"");
    }

    #[test]
    fn what_a_damaged_heap_lacks_is_named() {
        let failed = |file: &File, reference: [u8; REFERENCE], reason: &str| {
            let message = Heap::default().get(file, &reference).unwrap_err().to_string();
            assert!(message.contains(reason), "{message}");
        };
        let sound = file(&[object(1, 3, b"abc")], None);
        failed(&sound, reference(3, 8, 2), "the heap at byte 8 has no object 2 of 3 bytes");
        failed(&sound, reference(9, 8, 1), "has no object 1 of 9 bytes");
        failed(&sound, reference(3, 0, 1), "the heap at byte 0: it is none");
        failed(&sound, reference(3, u64::MAX, 1), "the heap at byte 18446744073709551615");
        for size in [0, 15, MAX_BYTES + 1, u64::MAX] {
            failed(&file(&[object(1, 3, b"abc")], Some(size)), reference(3, 8, 1), "it is none");
        }
        failed(&file(&[object(1, 3, b"abc")], Some(4096)), reference(3, 8, 1), "the heap at byte 8");
        for size in [17, u64::MAX - 20, u64::MAX] {
            failed(
                &file(&[object(1, size, b"abc")], None),
                reference(3, 8, 1),
                "its object 1 lies behind its end",
            );
        }
    }
}
