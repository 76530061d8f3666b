//! Arrays of HDF5 files of other programs: tables, and encoded images.

use std::path::Path;
use std::sync::Arc;

use swm_core::{Dtype, SliceMut};
use swm_data::dataset::Steps;
use swm_data::error::{FormatError, Result, unsupported, wrong_type};
use swm_data::hdf5::{Bytes, Table, Tree, is_hdf5};

use super::array::{Array, Reshaped, Scratch, Shared, values};

/// Rows of an array.
pub(super) type Rows = Shared;

/// What images of JPEG begin with.
const JPEG: &[u8] = b"\xff\xd8\xff";

/// A file, if it is one of HDF5 that can be opened.
pub(super) fn open(path: &Path) -> Option<Tree> {
    is_hdf5(path).then(|| Tree::open(path).ok()).flatten()
}

impl Array for Table {
    fn dtype(&self) -> Dtype {
        self.dtype()
    }

    fn rows(&self) -> usize {
        self.len()
    }

    fn shape(&self) -> &[usize] {
        self.shape()
    }

    fn is_u64(&self) -> bool {
        self.is_u64()
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        self.read(rows, out, &mut scratch.hdf5)
    }
}

/// The rows of a table; those of one value are single values.
pub(super) fn rows_of(table: Table) -> Rows {
    Arc::new(table)
}

/// Single values, of a table of rows of one value.
pub(super) fn scalars(rows: Rows) -> Rows {
    match rows.shape() {
        [1] => Arc::new(Reshaped(rows, Vec::new())),
        _ => rows,
    }
}

/// An array of a group. With `is_jpeg`, rows of bytes that are images are decoded.
pub(super) fn array(tree: &Tree, group: &str, path: &str, is_jpeg: bool) -> Result<Rows> {
    if is_jpeg && let Some(bytes) = tree.bytes(group, path)? {
        return Jpeg::rows(Encoded::Lists(bytes));
    }
    let table = tree.table(group, path)?;
    let is_bytes = is_jpeg && table.dtype() == Dtype::U8 && table.shape().len() == 1 && table.len() > 0;
    let rows = rows_of(table);
    if is_bytes && row(&rows, 0)?.starts_with(JPEG) {
        return Jpeg::rows(Encoded::Table(rows));
    }
    Ok(rows)
}

fn row(rows: &Rows, at: usize) -> Result<Vec<u8>> {
    match values(rows.as_ref(), Steps { first: at, count: 1, stride: 1 }, &mut Scratch::default())? {
        swm_core::Column::U8(bytes) => Ok(bytes),
        other => Err(wrong_type(format!("its rows hold {}", other.dtype()))),
    }
}

/// Where encoded images are.
#[derive(Debug)]
enum Encoded {
    Lists(Bytes),
    /// All of one length.
    Table(Rows),
}

impl Encoded {
    fn len(&self) -> usize {
        match self {
            Self::Lists(bytes) => bytes.len(),
            Self::Table(rows) => rows.rows(),
        }
    }

    fn image(&self, at: usize) -> Result<Vec<u8>> {
        match self {
            Self::Lists(bytes) => Ok(bytes.read(at, 1)?.pop().unwrap_or_default()),
            Self::Table(rows) => row(rows, at),
        }
    }
}

/// Images of JPEG.
#[derive(Debug)]
struct Jpeg {
    encoded: Encoded,
    shape: [usize; 3],
}

impl Jpeg {
    fn rows(encoded: Encoded) -> Result<Rows> {
        if encoded.len() == 0 {
            return Err(unsupported("it has no images"));
        }
        let shape = swm_media::jpeg::shape(&encoded.image(0)?);
        let shape = shape.map_err(|error| unsupported(format!("its bytes are no image: {error}")))?;
        Ok(Arc::new(Self { encoded, shape }))
    }
}

impl Array for Jpeg {
    fn dtype(&self) -> Dtype {
        Dtype::U8
    }

    fn rows(&self) -> usize {
        self.encoded.len()
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn is_encoded(&self) -> bool {
        true
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, _scratch: &mut Scratch) -> Result<()> {
        let SliceMut::U8(out) = out else { return Err(wrong_type("images hold bytes")) };
        for (index, out) in out.chunks_exact_mut(self.dim()).enumerate() {
            let bytes = self.encoded.image(rows.first + index * rows.stride)?;
            swm_media::jpeg::decode_into(&bytes, self.shape, out).map_err(FormatError::other)?;
        }
        Ok(())
    }
}

/// Whether images of a dataset of Minari are encoded: unless its metadata denies it.
pub(super) fn is_jpeg(file: &Path) -> bool {
    let about = std::fs::read_to_string(file.with_file_name("metadata.json")).unwrap_or_default();
    let about: serde_json::Value = serde_json::from_str(&about).unwrap_or_default();
    about["jpeg_encoding"].as_bool().unwrap_or(true)
}
