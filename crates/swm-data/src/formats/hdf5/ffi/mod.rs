//! Calls of C libraries that their Rust interfaces lack: writing a chunk as it is stored, where objects lie, Blosc's compression, types of elements
//! that the interface has no name for, and the stored form of an attribute of any length.
#![expect(unsafe_code, reason = "calls of C libraries")]

use std::ffi::{CStr, CString, c_int, c_void};
use std::sync::OnceLock;

use hdf5_metno::filters::BloscShuffle;
use hdf5_metno::types::VarLenUnicode;
use hdf5_metno::{Attribute, Dataset, Datatype, File, h5check, sync};
use hdf5_metno_sys::h5::{H5free_memory, herr_t, hsize_t};
use hdf5_metno_sys::h5a::H5Aread;
use hdf5_metno_sys::h5d::H5Dwrite_chunk;
use hdf5_metno_sys::h5i::hid_t;
use hdf5_metno_sys::h5l::{H5L_info2_t, H5L_type_t, H5Lget_info2};
use hdf5_metno_sys::h5p::H5P_DEFAULT;
use hdf5_metno_sys::h5t::{
    H5T_cdata_t, H5T_class_t, H5T_pers_t, H5Tclose, H5Tcreate, H5Tget_class, H5Tget_fields, H5Tget_size,
    H5Tget_tag, H5Tregister,
};

use super::heap::REFERENCE;

/// The bit of the first filter in the mask of those that a chunk was stored without.
const FIRST_FILTER: u32 = 1;
/// Bytes of a value.
const ELEMENT: usize = 1;
const AUTOMATIC_BLOCKS: usize = 0;
const ONE_THREAD: c_int = 1;
/// No dataset has more (`H5S_MAX_RANK`).
const MAX_DIMENSIONS: usize = 32;

/// Writes the stored form of row `row` of a dataset whose chunks hold a row each: with all of its filters applied, or all but
/// the first, the compression.
pub(super) fn write_row(
    dataset: &Dataset,
    row: usize,
    stored: &[u8],
    is_compressed: bool,
) -> hdf5_metno::Result<()> {
    let skipped = if is_compressed { 0 } else { FIRST_FILTER };
    let mut offset: [hsize_t; MAX_DIMENSIONS] = [0; MAX_DIMENSIONS];
    offset[0] = row as hsize_t;
    // SAFETY: the dataset is open, `offset` has a value for each dimension that there can be, `stored` has as many bytes as
    // are told, and `sync` holds the lock under which the library is called.
    let written = sync::sync(|| unsafe {
        let (offset, bytes) = (offset.as_ptr(), stored.as_ptr());
        H5Dwrite_chunk(dataset.id(), H5P_DEFAULT, skipped, offset, stored.len(), bytes.cast())
    });
    h5check(written).map(|_| ())
}

/// Addresses of the headers of what a file's root group holds by hard links. The headers themselves are not read.
pub(super) fn addresses_of_members(file: &File) -> hdf5_metno::Result<Vec<u64>> {
    let addresses = file.member_names()?.into_iter().filter_map(|name| {
        let name = CString::new(name).ok()?;
        let mut info = H5L_info2_t::default();
        // SAFETY: the file is open, the name ends with NUL, and `info` is where the call writes.
        let status =
            sync::sync(|| unsafe { H5Lget_info2(file.id(), name.as_ptr(), &raw mut info, H5P_DEFAULT) });
        if let Err(error) = h5check(status) {
            return Some(Err(error));
        }
        (info.type_ == H5L_type_t::H5L_TYPE_HARD).then(|| {
            // SAFETY: a hard link has a token of 16 bytes, the first 8 of which are the address in files on a disk.
            let address = unsafe { info.u.token().cast::<[u8; 8]>().read_unaligned() };
            Ok(u64::from_le_bytes(address))
        })
    });
    addresses.collect()
}

/// Compresses `values` of one byte each by Blosc with LZ4, as the filter of the library does, and returns how many bytes of `out`
/// they take: 0 if more than it has.
pub(super) fn compress(level: u8, shuffle: BloscShuffle, values: &[u8], out: &mut [u8]) -> usize {
    let shuffle = match shuffle {
        BloscShuffle::None => 0,
        BloscShuffle::Byte => 1,
        BloscShuffle::Bit => 2,
    };
    // SAFETY: both buffers are as long as is told, the name ends with NUL, and a context of its own shares nothing with other
    // threads.
    let size = unsafe {
        let (source, target) = (values.as_ptr().cast(), out.as_mut_ptr().cast());
        blosc_src::blosc_compress_ctx(
            c_int::from(level),
            shuffle,
            ELEMENT,
            values.len(),
            source,
            target,
            out.len(),
            c"lz4".as_ptr(),
            AUTOMATIC_BLOCKS,
            ONE_THREAD,
        )
    };
    usize::try_from(size).unwrap_or(0)
}

/// A type of elements, as far as the Rust interface does not tell it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum StoredType {
    /// A float of so many bytes, and where its parts are: the bit of the sign; the first bit and the number of bits of the exponent;
    /// those of the fraction.
    Float { size: usize, parts: [usize; 5] },
    /// So many bytes without a meaning, with the name that their writer gave them.
    Opaque { size: usize, tag: String },
    /// Another class of types, which the Rust interface knows or which has this name.
    Other(&'static str),
}

/// The type of a dataset's elements.
pub(super) fn stored_type(dtype: &Datatype) -> StoredType {
    let id = dtype.id();
    // SAFETY: the type is open while it is borrowed, each pointer is to a value of its own, the tag is freed once, after it was copied,
    // and `sync` holds the lock under which the library is called.
    sync::sync(|| unsafe {
        let size = H5Tget_size(id);
        match H5Tget_class(id) {
            H5T_class_t::H5T_FLOAT => {
                let mut parts = [0; 5];
                let [sign, exponent, exponent_bits, fraction, fraction_bits] = &mut parts;
                H5Tget_fields(id, sign, exponent, exponent_bits, fraction, fraction_bits);
                StoredType::Float { size, parts }
            }
            H5T_class_t::H5T_OPAQUE => {
                let found = H5Tget_tag(id);
                if found.is_null() {
                    return StoredType::Opaque { size, tag: String::new() };
                }
                let tag = CStr::from_ptr(found).to_string_lossy().into_owned();
                H5free_memory(found.cast());
                StoredType::Opaque { size, tag }
            }
            H5T_class_t::H5T_TIME => StoredType::Other("time"),
            H5T_class_t::H5T_BITFIELD => StoredType::Other("bit field"),
            H5T_class_t::H5T_COMPOUND => StoredType::Other("compound"),
            H5T_class_t::H5T_REFERENCE => StoredType::Other("reference"),
            H5T_class_t::H5T_ENUM => StoredType::Other("enumeration"),
            H5T_class_t::H5T_VLEN => StoredType::Other("list of any length"),
            H5T_class_t::H5T_ARRAY => StoredType::Other("array"),
            _ => StoredType::Other("unknown"),
        }
    })
}

/// Where an attribute's one value of any length lies: what is stored of it, in a file whose references are of [`REFERENCE`] bytes. The
/// library would go there, without a bound where the heap is damaged; a conversion that keeps the bytes makes it hand them out.
pub(super) fn reference(attribute: &Attribute) -> hdf5_metno::Result<[u8; REFERENCE]> {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    if attribute.size() != 1 {
        return Err(format!("the attribute has {} values, not one", attribute.size()).into());
    }
    let text = Datatype::from_type::<VarLenUnicode>()?;
    let mut stored = [0; REFERENCE];
    // SAFETY: the attribute and the type are open while they are borrowed, `stored` has room for the one value of `REFERENCE` bytes that
    // the attribute has in the type `raw`, which is closed once, and `sync` holds the lock under which the library is called.
    let read = sync::sync(|| unsafe {
        let raw = H5Tcreate(H5T_class_t::H5T_OPAQUE, REFERENCE);
        let is_registered = *REGISTERED.get_or_init(|| {
            let name = c"stored reference".as_ptr();
            H5Tregister(H5T_pers_t::H5T_PERS_SOFT, name, text.id(), raw, Some(keep)) >= 0
        });
        let read = if is_registered { H5Aread(attribute.id(), raw, stored.as_mut_ptr().cast()) } else { -1 };
        let read = h5check(read);
        H5Tclose(raw);
        read
    });
    read.map(|_| stored)
}

/// A conversion of the library from elements of any length to [`REFERENCE`] bytes, which leaves them as they are stored. Others are refused.
extern "C" fn keep(
    _from: hid_t,
    to: hid_t,
    _data: *mut H5T_cdata_t,
    _count: usize,
    _stride: usize,
    _other_stride: usize,
    _values: *mut c_void,
    _others: *mut c_void,
    _transfer: hid_t,
) -> herr_t {
    // SAFETY: the library gives an open type, under its lock.
    if unsafe { H5Tget_size(to) } == REFERENCE { 0 } else { -1 }
}
