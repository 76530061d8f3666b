//! Reading and writing files of named tensors. All become 32-bit floats.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use pytorch_reader::{DType as TorchType, PytorchReader};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};

use crate::error::BaselineError;

/// A tensor of a file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stored {
    /// Its shape.
    pub(crate) shape: Vec<usize>,
    /// Its values, row-major.
    pub(crate) values: Vec<f32>,
}

/// All tensors of a `.safetensors` file or of one that PyTorch wrote; its content decides, not its name.
pub(crate) fn read(path: &Path) -> Result<BTreeMap<String, Stored>, BaselineError> {
    let mut start = [0; 9];
    let length = {
        use std::io::Read as _;
        let mut file =
            fs::File::open(path).map_err(|error| BaselineError::weights(path, error.to_string()))?;
        file.read(&mut start).map_err(|error| BaselineError::weights(path, error.to_string()))?
    };
    // Eight bytes of length, then the brace of a JSON object.
    if length == start.len() && start[8] == b'{' { read_safetensors(path) } else { read_pytorch(path) }
}

fn read_safetensors(path: &Path) -> Result<BTreeMap<String, Stored>, BaselineError> {
    let bytes = fs::read(path).map_err(|error| BaselineError::weights(path, error.to_string()))?;
    let file =
        SafeTensors::deserialize(&bytes).map_err(|error| BaselineError::weights(path, error.to_string()))?;
    let mut tensors = BTreeMap::new();
    for (name, view) in file.iter() {
        let values = match view.dtype() {
            Dtype::F32 => floats(view.data(), f32::from_le_bytes),
            Dtype::F64 => floats(view.data(), |bytes| f64::from_le_bytes(bytes) as f32),
            Dtype::F16 => floats(view.data(), half),
            Dtype::BF16 => floats(view.data(), brain),
            Dtype::I64 => floats(view.data(), |bytes| i64::from_le_bytes(bytes) as f32),
            Dtype::BOOL | Dtype::U8 => floats(view.data(), |[byte]: [u8; 1]| byte.into()),
            other => return Err(kind(path, name, &format!("{other:?}"))),
        };
        tensors.insert(name.to_owned(), Stored { shape: view.shape().to_vec(), values });
    }
    Ok(tensors)
}

/// Keys under which trainers store the weights of a model.
const NESTED: [&str; 3] = ["state_dict", "model_state_dict", "model"];

fn read_pytorch(path: &Path) -> Result<BTreeMap<String, Stored>, BaselineError> {
    let reason = "is neither safetensors nor a file of torch.save, or it is cut off";
    let broken = |error: &dyn std::fmt::Display| BaselineError::weights(path, format!("{reason}: {error}"));
    let reader = PytorchReader::new(path).map_err(|error| broken(&error))?;
    let names = reader.keys();
    let nested = NESTED.iter().find(|key| {
        let prefix = format!("{key}.");
        names.iter().any(|name| name.starts_with(&prefix))
    });
    let inside = nested.and_then(|key| PytorchReader::with_top_level_key(path, key).ok());
    let reader = inside.unwrap_or(reader);
    let mut tensors = BTreeMap::new();
    for (name, tensor) in reader.tensors() {
        let bytes = tensor.read().map_err(|error| broken(&error))?;
        // The reader gives bytes in the order of this machine.
        let values = match tensor.dtype() {
            TorchType::F32 => floats(&bytes, f32::from_ne_bytes),
            TorchType::F64 => floats(&bytes, |bytes| f64::from_ne_bytes(bytes) as f32),
            TorchType::F16 => floats(&bytes, |bytes: [u8; 2]| half(u16::from_ne_bytes(bytes).to_le_bytes())),
            TorchType::BF16 => {
                floats(&bytes, |bytes: [u8; 2]| brain(u16::from_ne_bytes(bytes).to_le_bytes()))
            }
            TorchType::I64 => floats(&bytes, |bytes| i64::from_ne_bytes(bytes) as f32),
            TorchType::Bool | TorchType::U8 => floats(&bytes, |[byte]: [u8; 1]| byte.into()),
            other => return Err(kind(path, name, &format!("{other:?}"))),
        };
        tensors.insert(name.clone(), Stored { shape: tensor.shape().to_vec(), values });
    }
    if tensors.is_empty() {
        return Err(BaselineError::weights(path, "holds no tensors"));
    }
    Ok(tensors)
}

fn kind(path: &Path, name: &str, kind: &str) -> BaselineError {
    BaselineError::weights(path, format!("`{name}` is of type {kind}; store weights as 32- or 16-bit floats"))
}

fn floats<const N: usize>(bytes: &[u8], convert: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    let (chunks, _) = bytes.as_chunks::<N>();
    chunks.iter().map(|chunk| convert(*chunk)).collect()
}

fn brain(bytes: [u8; 2]) -> f32 {
    f32::from_bits(u32::from(u16::from_le_bytes(bytes)) << 16)
}

/// IEEE 754 binary16.
fn half(bytes: [u8; 2]) -> f32 {
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

/// Writes safetensors: name, shape, values. The file appears whole or not at all.
pub(crate) fn write(path: &Path, tensors: Vec<(String, Vec<usize>, Vec<f32>)>) -> Result<(), BaselineError> {
    let failed = |error: &dyn std::fmt::Display| BaselineError::weights(path, error.to_string());
    let bytes: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
        .into_iter()
        .map(|(name, shape, values)| {
            (name, shape, values.iter().flat_map(|value| value.to_le_bytes()).collect())
        })
        .collect();
    let mut views = Vec::with_capacity(bytes.len());
    for (name, shape, data) in &bytes {
        views.push((
            name.as_str(),
            TensorView::new(Dtype::F32, shape.clone(), data).map_err(|error| failed(&error))?,
        ));
    }
    let file = safetensors::serialize(views, None).map_err(|error| failed(&error))?;
    let part = path.with_extension("part");
    let io = |source| BaselineError::Io { action: "write", path: path.to_owned(), source };
    fs::write(&part, file).and_then(|()| fs::rename(&part, path)).map_err(io)
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
        assert_eq!(stored["a.b"], Stored { shape: vec![2, 1], values: vec![1.5, -2.0] });
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
        assert!(matches!(read(&path), Err(BaselineError::Weights { .. })));
        fs::write(&path, b"no weights at all").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("neither safetensors nor"));
    }
}
