//! Reading and writing files of named tensors. All become 32-bit floats.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use safetensors::Dtype;
use safetensors::tensor::View;

use crate::error::WeightsError;
use crate::{refusal, torch};

/// How the names of files of weights end.
pub const ENDINGS: [&str; 5] = ["pt", "pth", "ckpt", "safetensors", "tar"];

/// A tensor of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stored {
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its values, row-major; none where only shapes were asked for.
    pub values: Vec<f32>,
    /// Whether the file holds whole numbers.
    pub is_whole: bool,
}

/// What is in a file.
#[derive(Debug, Default)]
pub struct Contents {
    /// Its tensors, by their names in the file.
    pub tensors: BTreeMap<String, Stored>,
    /// `safetensors`, or the container of PyTorch: `zip`, `legacy`, `tar`, `pickle`.
    pub format: &'static str,
    /// Functions that Python would call if it loaded the file.
    pub calls: Vec<String>,
    /// What was passed over: classes of objects that hold tensors, such as optimizers, and keys of further copies of the weights.
    pub passed_over: Vec<String>,
}

/// What is read of tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// Shapes alone.
    Shapes,
    /// Shapes and values.
    Values,
}

/// The largest file, in bytes; the most tensors, and values of all together; the longest name, in bytes.
const MOST_BYTES: u64 = 16 << 30;
const MOST_TENSORS: usize = 100_000;
const MOST_VALUES: usize = 4_000_000_000;
const LONGEST_NAME: usize = 512;

/// All tensors of a `.safetensors` file or of one that PyTorch wrote; its content decides, not its name.
///
/// # Errors
///
/// As of [`contents`].
pub fn read(path: &Path) -> Result<BTreeMap<String, Stored>, WeightsError> {
    Ok(contents(path, Of::Values)?.tensors)
}

/// What is in a file of weights.
///
/// # Errors
///
/// [`WeightsError::Unusable`]: it cannot be read, is cut off or larger than any that is read, or holds something else than dense tensors of numbers.
pub fn contents(path: &Path, of: Of) -> Result<Contents, WeightsError> {
    let wrong = |reason: String| WeightsError::unusable(path, reason);
    let mut file = File::open(path).map_err(|error| wrong(error.to_string()))?;
    let len = file.metadata().map_err(|error| wrong(error.to_string()))?.len();
    let mut start = Vec::with_capacity(refusal::START);
    (&mut file)
        .take(refusal::START as u64)
        .read_to_end(&mut start)
        .map_err(|error| wrong(error.to_string()))?;
    if let Some(reason) = refusal::of(&start, len, &mut file) {
        return Err(wrong(reason));
    }
    if len > MOST_BYTES {
        return Err(wrong(format!(
            "the file is {} bytes, more than the {MOST_BYTES} that are read",
            spaced(len)
        )));
    }
    // Eight bytes of length, then the brace of a JSON object.
    if start.get(8) == Some(&b'{') { read_safetensors(path, &mut file, of) } else { torch::read(path, of) }
}

/// Refuses a file of too many tensors, or with such names.
pub(crate) fn check_sizes<'a>(
    path: &Path,
    tensors: impl Iterator<Item = (&'a str, &'a [usize])>,
) -> Result<(), WeightsError> {
    let (mut count, mut values) = (0, 0_usize);
    for (name, shape) in tensors {
        count += 1;
        let size = shape.iter().try_fold(1_usize, |size, &dim| size.checked_mul(dim));
        let size = size.filter(|&size| size <= MOST_VALUES);
        let Some(size) = size else {
            let reason = format!("`{name}` of shape {shape:?} is larger than any tensor that is read");
            return Err(WeightsError::unusable(path, reason));
        };
        values = values.saturating_add(size);
        if count > MOST_TENSORS || values > MOST_VALUES {
            let reason = format!(
                "the file holds more than the {MOST_TENSORS} tensors or {MOST_VALUES} values that are read"
            );
            return Err(WeightsError::unusable(path, reason));
        }
        if name.len() > LONGEST_NAME || name.chars().any(char::is_control) {
            let start: String = name.chars().filter(|letter| !letter.is_control()).take(32).collect();
            let reason =
                format!("a tensor's name, `{start}…`, is longer than {LONGEST_NAME} bytes or not plain text");
            return Err(WeightsError::unusable(path, reason));
        }
    }
    Ok(())
}

/// A number with a comma between thousands.
pub(crate) fn spaced(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

fn read_safetensors(path: &Path, file: &mut File, of: Of) -> Result<Contents, WeightsError> {
    let wrong = |error: &dyn std::fmt::Display| WeightsError::unusable(path, error.to_string());
    let len = file.metadata().map_err(|error| wrong(&error))?.len();
    let mut read_at = |at: u64, count: u64| -> Result<Vec<u8>, WeightsError> {
        if at.checked_add(count).is_none_or(|end| end > len) {
            let reason = format!(
                "the file is cut off: {} bytes, and its header names more; fetch it again",
                spaced(len)
            );
            return Err(WeightsError::unusable(path, reason));
        }
        let mut bytes = vec![0; count as usize];
        file.seek(SeekFrom::Start(at))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(|error| wrong(&error))?;
        Ok(bytes)
    };
    let head = read_at(0, 8)?;
    let header = u64::from_le_bytes(head.try_into().expect("eight bytes"));
    let header = read_at(8, header)?;
    let data = 8 + header.len() as u64;
    let metadata: safetensors::tensor::Metadata = serde_json::from_slice(&header).map_err(|error| {
        let reason =
            format!("its header, of safetensors by its first bytes, is damaged ({error}): fetch it again");
        WeightsError::unusable(path, reason)
    })?;
    let mut tensors = BTreeMap::new();
    let infos = metadata.tensors();
    check_sizes(path, infos.iter().map(|(name, info)| (name.as_str(), &info.shape[..])))?;
    for (name, info) in infos {
        let (start, end) = info.data_offsets;
        let bytes = match of {
            Of::Values => read_at((start as u64).saturating_add(data), end.saturating_sub(start) as u64)?,
            Of::Shapes => Vec::new(),
        };
        let values = match info.dtype {
            Dtype::F32 => floats(&bytes, f32::from_le_bytes),
            Dtype::F64 => floats(&bytes, |bytes| f64::from_le_bytes(bytes) as f32),
            Dtype::F16 => floats(&bytes, half),
            Dtype::BF16 => floats(&bytes, brain),
            Dtype::I64 => floats(&bytes, |bytes| i64::from_le_bytes(bytes) as f32),
            Dtype::I32 => floats(&bytes, |bytes| i32::from_le_bytes(bytes) as f32),
            Dtype::BOOL | Dtype::U8 => floats(&bytes, |[byte]: [u8; 1]| byte.into()),
            other => return Err(kind(path, &name, &format!("{other:?}"))),
        };
        if of == Of::Values && values.len() != info.shape.iter().product::<usize>() {
            let reason = format!(
                "the file is damaged: `{name}` of shape {:?} has {} values",
                info.shape,
                values.len()
            );
            return Err(WeightsError::unusable(path, reason));
        }
        let is_whole = matches!(info.dtype, Dtype::I64 | Dtype::I32 | Dtype::BOOL | Dtype::U8);
        tensors.insert(name, Stored { shape: info.shape.clone(), values, is_whole });
    }
    Ok(Contents { tensors, format: "safetensors", ..Contents::default() })
}

pub(crate) fn kind(path: &Path, name: &str, kind: &str) -> WeightsError {
    WeightsError::unusable(path, format!("`{name}` is of type {kind}; store weights as 32- or 16-bit floats"))
}

pub(crate) fn floats<const N: usize>(bytes: &[u8], convert: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    let (chunks, _) = bytes.as_chunks::<N>();
    chunks.iter().map(|chunk| convert(*chunk)).collect()
}

pub(crate) fn brain(bytes: [u8; 2]) -> f32 {
    f32::from_bits(u32::from(u16::from_le_bytes(bytes)) << 16)
}

/// IEEE 754 binary16.
pub(crate) fn half(bytes: [u8; 2]) -> f32 {
    let bits = u16::from_le_bytes(bytes);
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f32::from(bits & 0x3ff));
    let size = match exponent {
        0 => fraction * 2.0_f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + fraction / 1024.0) * 2.0_f32.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// A tensor to write: its bytes are made when they are written.
struct Written {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl View for Written {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        self.values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    fn data_len(&self) -> usize {
        self.values.len() * size_of::<f32>()
    }
}

/// Writes safetensors: name, shape, values. The file appears whole or not at all.
///
/// # Errors
///
/// [`WeightsError::Write`]: the operating system refuses.
pub fn write(path: &Path, tensors: Vec<(String, Vec<usize>, Vec<f32>)>) -> Result<(), WeightsError> {
    write_with(path, tensors, None)
}

/// As [`write()`], with the note that transformers wants in a model's file.
///
/// # Errors
///
/// As of [`write()`].
pub fn write_for_transformers(
    path: &Path,
    tensors: Vec<(String, Vec<usize>, Vec<f32>)>,
) -> Result<(), WeightsError> {
    write_with(path, tensors, Some(HashMap::from([("format".to_owned(), "pt".to_owned())])))
}

fn write_with(
    path: &Path,
    tensors: Vec<(String, Vec<usize>, Vec<f32>)>,
    notes: Option<HashMap<String, String>>,
) -> Result<(), WeightsError> {
    let views = tensors.into_iter().map(|(name, shape, values)| (name, Written { shape, values }));
    let part = path.with_extension("part");
    let written = safetensors::serialize_to_file(views, notes, &part);
    written.map_err(|error| match error {
        safetensors::SafeTensorError::IoError(source) => {
            WeightsError::Write { path: path.to_owned(), source }
        }
        error => WeightsError::unusable(path, error.to_string()),
    })?;
    fs::rename(&part, path).map_err(|source| WeightsError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_floats_are_read_exactly() {
        let cases = [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_95),
            (0x0001, 5.960_464_5e-8),
            (0x7c00, f32::INFINITY),
        ];
        for (bits, value) in cases {
            assert_eq!(half(u16::to_le_bytes(bits)), value);
        }
        assert_eq!(brain(0xc040_u16.to_le_bytes()), -3.0);
    }

    #[test]
    fn a_file_comes_back_and_a_cut_one_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write(&path, vec![("a.b".to_owned(), vec![2, 1], vec![1.5, -2.0])]).unwrap();
        let stored = read(&path).unwrap();
        assert_eq!(stored["a.b"], Stored { shape: vec![2, 1], values: vec![1.5, -2.0], is_whole: false });
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
        assert!(matches!(read(&path), Err(WeightsError::Unusable { .. })));
        fs::write(&path, b"no weights at all").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("the file is neither safetensors nor"));
    }
}
