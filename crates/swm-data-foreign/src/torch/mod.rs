//! Files of `torch.save`: a zip archive of storages and a pickle that says which tensors lie in them. Rows are read where they are; nothing
//! of the pickle is executed.

mod pickle;

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pickle::{Layout, Object};
use swm_core::{Dtype, SliceMut};
use swm_data::dataset::Steps;
use swm_data::element::{self, Element};
use swm_data::error::{At as _, FormatError, Result, invalid, missing, unsupported, wrong_type};
use swm_data::npz::check_end;
use swm_files::{open_regular, read_exact_at, read_regular};
use zip::{CompressionMethod, ZipArchive};

use super::array::{Array, Scratch, new_key};

/// A pickle of tensors or of lengths is never longer.
const MAX_PICKLE: u64 = 64 << 20;

/// An open file.
pub(super) struct Archive {
    file: Arc<File>,
    /// First byte and size of each storage, by its name in the pickle.
    storages: HashMap<String, (u64, u64)>,
    root: Object,
}

impl Archive {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = open_regular(path)?;
        let length = file.metadata()?.len();
        check_end(&file, length).map_err(|_| {
            unsupported("it is no zip archive, as `torch.save` writes since version 1.6; save it again with a newer PyTorch")
        })?;
        let mut archive = ZipArchive::new(BufReader::new(&file)).map_err(FormatError::other)?;
        let name = archive.file_names().find(|name| name.ends_with("/data.pkl")).map(str::to_owned);
        let name = name.ok_or_else(|| missing("it has no `data.pkl`, as files of `torch.save` have"))?;
        let folder = name.trim_end_matches("data.pkl").to_owned();
        let (mut pickled, mut storages) = (Vec::new(), HashMap::new());
        for index in 0..archive.len() {
            let entry = archive.by_index(index).map_err(FormatError::other)?;
            let Some(part) = entry.name().strip_prefix(&folder).map(str::to_owned) else { continue };
            let size = entry.size();
            if part == "data.pkl" {
                if size > MAX_PICKLE {
                    return Err(unsupported(format!(
                        "its pickle has {size} bytes, {MAX_PICKLE} are the most"
                    )));
                }
                entry.take(size).read_to_end(&mut pickled)?;
            } else if part == "byteorder" {
                let mut order = String::new();
                entry.take(16).read_to_string(&mut order)?;
                if order != "little" {
                    return Err(unsupported(format!("its byte order is `{order}`")));
                }
            } else if let Some(key) = part.strip_prefix("data/") {
                if entry.compression() != CompressionMethod::Stored {
                    return Err(unsupported("its storages are compressed, which `torch.save` does not do"));
                }
                let start = entry.data_start();
                if start.checked_add(size).is_none_or(|end| end > length) {
                    return Err(invalid(format!("storage {key} lies behind its end")));
                }
                storages.insert(key.to_owned(), (start, size));
            }
        }
        let root = pickle::load(&pickled)?;
        Ok(Self { file: Arc::new(file), storages, root })
    }

    /// The tensor that the file consists of.
    pub(super) fn tensor(&self) -> Result<Tensor> {
        match &self.root {
            Object::Tensor(layout) => self.open_tensor(layout),
            other => Err(unsupported(format!(
                "it holds {}, and a tensor is read; save the tensor itself",
                other.name()
            ))),
        }
    }

    fn open_tensor(&self, layout: &Layout) -> Result<Tensor> {
        let &(start, size) = self
            .storages
            .get(&layout.storage)
            .ok_or_else(|| missing(format!("storage {} is missing", layout.storage)))?;
        let element = element(&layout.kind)?;
        let width = element.size().unwrap_or(1) as u64;
        let last =
            layout.sizes.iter().zip(&layout.strides).try_fold(layout.offset, |at, (&size, &stride)| {
                at.checked_add(size.saturating_sub(1).checked_mul(stride)?)
            });
        let is_empty = layout.sizes.contains(&0);
        if !is_empty
            && last.and_then(|last| last.checked_add(1)?.checked_mul(width)).is_none_or(|end| end > size)
        {
            return Err(invalid(format!(
                "a storage of {size} bytes cannot hold the shape {:?}",
                layout.sizes
            )));
        }
        // An axis of stride 0 repeats values: a few bytes can claim any number of them.
        let values = layout.sizes.iter().try_fold(1u64, |all, &size| all.checked_mul(size));
        if values.is_none_or(|values| values > (size / width).saturating_mul(4096)) {
            return Err(invalid(format!(
                "a storage of {size} bytes cannot hold the shape {:?}",
                layout.sizes
            )));
        }
        let axes: Vec<Axis> = layout
            .sizes
            .iter()
            .zip(&layout.strides)
            .map(|(&size, &stride)| Axis { size: size as usize, stride })
            .collect();
        let Some((rows, shape)) = axes.split_first() else {
            return Err(wrong_type("it is a single value, not one per row"));
        };
        let shape_sizes = shape.iter().map(|axis| axis.size).collect();
        let start = start + layout.offset * width;
        Ok(Tensor {
            file: self.file.clone(),
            start,
            element,
            lead: vec![*rows],
            inner: shape.to_vec(),
            shape: shape_sizes,
        })
    }
}

/// How torch names types of storages.
fn element(kind: &str) -> Result<Element> {
    Ok(match kind {
        "FloatStorage" => Element::F32,
        "DoubleStorage" => Element::F64,
        "HalfStorage" => Element::F16,
        "BFloat16Storage" => Element::Bf16,
        "ByteStorage" => Element::U8,
        "CharStorage" => Element::I8,
        "ShortStorage" => Element::I16,
        "IntStorage" => Element::I32,
        "LongStorage" => Element::I64,
        "BoolStorage" => Element::Bool,
        other => return Err(unsupported(format!("tensors of `{other}` are not read"))),
    })
}

/// An axis of a tensor: from one index to the next, so many values in the storage.
#[derive(Clone, Copy, Debug)]
struct Axis {
    size: usize,
    stride: u64,
}

/// A tensor in a file.
#[derive(Clone, Debug)]
pub(super) struct Tensor {
    file: Arc<File>,
    /// The byte of its first value.
    start: u64,
    element: Element,
    /// The axes along which rows are counted.
    lead: Vec<Axis>,
    /// Those of one row.
    inner: Vec<Axis>,
    shape: Vec<usize>,
}

impl Tensor {
    /// Rows of the first two axes, and the sizes of these: episodes and steps.
    pub(super) fn by_step(mut self) -> Result<(Self, [usize; 2])> {
        if self.inner.is_empty() || self.lead.len() != 1 {
            return Err(wrong_type(format!("it has the shape {:?}, without an axis of steps", self.shape)));
        }
        let steps = self.inner.remove(0);
        self.shape.remove(0);
        let sizes = [self.lead[0].size, steps.size];
        self.lead.push(steps);
        Ok((self, sizes))
    }

    /// The value in the storage at which a row begins.
    fn row(&self, row: usize) -> u64 {
        let mut rest = row;
        let mut at = 0;
        for axis in self.lead.iter().rev() {
            at += (rest % axis.size) as u64 * axis.stride;
            rest /= axis.size;
        }
        at
    }

    /// Whether the values of a row follow each other.
    fn is_dense(&self) -> bool {
        let mut expected = 1;
        self.inner.iter().rev().all(|axis| {
            let fits = axis.size == 1 || axis.stride == expected;
            expected *= axis.size as u64;
            fits
        })
    }

    /// Where each value of a row is, from the first on.
    fn offsets(&self) -> Vec<u64> {
        let mut offsets = vec![0];
        for axis in &self.inner {
            offsets = offsets
                .iter()
                .flat_map(|&at| (0..axis.size as u64).map(move |index| at + index * axis.stride))
                .collect();
        }
        offsets
    }
}

impl Array for Tensor {
    fn dtype(&self) -> Dtype {
        self.element.dtype()
    }

    fn rows(&self) -> usize {
        self.lead.iter().map(|axis| axis.size).product()
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let width = self.element.size().unwrap_or(1);
        let row_bytes = self.dim() * width;
        let bytes = &mut scratch.bytes;
        bytes.resize(rows.count * row_bytes, 0);
        if row_bytes == 0 {
            return Ok(());
        }
        let offsets = if self.is_dense() { Vec::new() } else { self.offsets() };
        for (index, into) in bytes.chunks_exact_mut(row_bytes).enumerate() {
            let start = self.start + self.row(rows.first + index * rows.stride) * width as u64;
            if offsets.is_empty() {
                read_exact_at(self.file.as_ref(), into, start)?;
            } else {
                for (value, offset) in into.chunks_exact_mut(width).zip(&offsets) {
                    read_exact_at(self.file.as_ref(), value, start + offset * width as u64)?;
                }
            }
        }
        element::from_bytes(self.element, bytes, out)
    }
}

/// The tensor of a file of its own, which is opened when it is read: an episode.
#[derive(Debug)]
pub(super) struct TensorFile {
    path: PathBuf,
    key: usize,
    rows: usize,
    dtype: Dtype,
    shape: Vec<usize>,
}

impl TensorFile {
    /// Of so many rows, like those of `model`.
    pub(super) fn new(path: PathBuf, rows: usize, model: &Tensor) -> Self {
        Self { path, key: new_key(), rows, dtype: model.dtype(), shape: model.shape.clone() }
    }
}

impl Array for TensorFile {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn rows(&self) -> usize {
        self.rows
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let open = |_: &mut Scratch| Ok((Archive::open(&self.path)?.tensor()?, 4096));
        let tensor = scratch.part((self.key, 0), open).at(self.path.display())?.clone();
        if tensor.rows() < self.rows || tensor.dtype() != self.dtype || tensor.shape != self.shape {
            let found = format!("{} rows of {} {:?}", tensor.rows(), tensor.dtype(), tensor.shape);
            let reason = format!(
                "it holds {found}, and the episode has {} of {} {:?}",
                self.rows, self.dtype, self.shape
            );
            return Err(invalid(reason).at(self.path.display()));
        }
        tensor.read(rows, out, scratch).at(self.path.display())
    }
}

/// The integers of a pickled list.
pub(super) fn pickled_integers(path: &Path) -> Result<Vec<i64>> {
    let bytes = read_regular(path)?;
    let wrong = || wrong_type("it holds no list of whole numbers");
    let Object::List(items) = pickle::load(&bytes)? else { return Err(wrong()) };
    items.iter().map(|item| if let Object::Int(value) = item { Ok(*value) } else { Err(wrong()) }).collect()
}
