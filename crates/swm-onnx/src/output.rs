//! Outputs of an exported model: their types and shapes, checked when it is loaded and whenever it has run.

use ort::session::{Session, SessionOutputs};
use ort::value::{DynValue, Outlet, TensorElementType, ValueType};

use crate::error::OnnxError;

/// An output that is read: values of 32 or 64 bits.
pub(crate) struct Output {
    name: &'static str,
    is_double: bool,
    /// `[S]` (then `[S, 1]` will do, too) or `[S, H, D]`.
    shape: Vec<usize>,
}

impl Output {
    /// The output of this name, of the shape `shape` as far as the file states one.
    ///
    /// # Errors
    ///
    /// A sentence: there is none, or it has another type or shape.
    pub(crate) fn find(session: &Session, name: &'static str, shape: &[usize]) -> Result<Self, String> {
        let output = session.outputs().iter().find(|known| known.name() == name);
        let (kind, stated) = match output.map(Outlet::dtype) {
            Some(ValueType::Tensor { ty, shape, .. }) => (*ty, shape),
            Some(other) => return Err(format!("its output `{name}` is {other}, not a tensor")),
            None => return Err(format!("it has no output `{name}`")),
        };
        let is_double = match kind {
            TensorElementType::Float32 => false,
            TensorElementType::Float64 => true,
            other => {
                return Err(format!("its output `{name}` is {other}; export it as float32 or float64"));
            }
        };
        let output = Self { name, is_double, shape: shape.to_vec() };
        // A file that states no shape at all looks like a scalar here: what it gives decides.
        if stated.is_empty() || output.fits(stated) { Ok(output) } else { Err(output.misfit(stated)) }
    }

    /// Gives `take` the index and value of every element.
    ///
    /// # Errors
    ///
    /// [`OnnxError::Output`]: the model gave another type or shape.
    pub(crate) fn read(
        &self,
        outputs: &SessionOutputs<'_>,
        mut take: impl FnMut(usize, f64),
    ) -> Result<(), OnnxError> {
        let missing = || OnnxError::Output { reason: format!("it gave no output `{}`", self.name) };
        let value = outputs.get(self.name).ok_or_else(missing)?;
        let check = |shape: &[i64]| match self.fits(shape) && !shape.contains(&-1) {
            true => Ok(()),
            false => Err(OnnxError::Output { reason: self.misfit(shape) }),
        };
        if self.is_double {
            let (shape, values) = value.try_extract_tensor::<f64>().map_err(OnnxError::Run)?;
            check(shape)?;
            values.iter().enumerate().for_each(|(index, &value)| take(index, value));
        } else {
            let (shape, values) = value.try_extract_tensor::<f32>().map_err(OnnxError::Run)?;
            check(shape)?;
            values.iter().enumerate().for_each(|(index, &value)| take(index, f64::from(value)));
        }
        Ok(())
    }

    /// Whether a shape will do; -1 may be any size.
    fn fits(&self, shape: &[i64]) -> bool {
        let is = |shape: &[i64]| {
            shape.len() == self.shape.len()
                && shape.iter().zip(&self.shape).all(|(&found, &wanted)| {
                    found == -1 || usize::try_from(found).is_ok_and(|found| found == wanted)
                })
        };
        match (shape, self.shape.len()) {
            (&[samples, 1 | -1], 1) => is(&[samples]),
            _ => is(shape),
        }
    }

    fn misfit(&self, found: &[i64]) -> String {
        let (Self { name, shape: wanted, .. }, found) = (self, shape_text(found));
        match wanted[..] {
            [samples] => format!(
                "its output `{name}` is {found}, and [{samples}] or [{samples}, 1] is expected: one cost per candidate"
            ),
            _ => {
                format!("its output `{name}` is {found}, and {wanted:?} is expected: the shape of `actions`")
            }
        }
    }
}

/// `[100, ?]`: sizes that a file leaves open are `?`.
fn shape_text(shape: &[i64]) -> String {
    let size = |&size: &i64| if size == -1 { "?".to_owned() } else { size.to_string() };
    format!("[{}]", shape.iter().map(size).collect::<Vec<_>>().join(", "))
}

/// Refuses an output of the encoder that holds a NaN.
///
/// # Errors
///
/// [`OnnxError::Output`].
pub(crate) fn refuse_nan(name: &str, value: &DynValue) -> Result<(), OnnxError> {
    let has_nan = match value.dtype().tensor_type() {
        Some(TensorElementType::Float32) => {
            value.try_extract_tensor::<f32>().is_ok_and(|(_, values)| values.iter().any(|v| v.is_nan()))
        }
        Some(TensorElementType::Float64) => {
            value.try_extract_tensor::<f64>().is_ok_and(|(_, values)| values.iter().any(|v| v.is_nan()))
        }
        _ => false,
    };
    if !has_nan {
        return Ok(());
    }
    let reason = format!("encode.onnx gives NaN in `{name}`; check the columns that it is given");
    Err(OnnxError::Output { reason })
}
