//! What networks are computed on: this machine's CPU, or a GPU in builds with the feature `cuda`.

use std::fmt;
use std::str::FromStr;

use burn::tensor::Device as TensorDevice;

use crate::error::BaselineError;

/// What networks are computed on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// That of this machine, with all its threads.
    #[default]
    Cpu,
    /// The NVIDIA GPU of this number, from 0. It sums in another order, so its results are close to the CPU's, not bit-identical.
    Cuda(usize),
}

impl Device {
    /// Where its tensors lie; an error where it is not there.
    pub(crate) fn device(self) -> Result<TensorDevice, BaselineError> {
        match self {
            Self::Cpu => Ok(TensorDevice::flex()),
            Self::Cuda(number) => gpu(number),
        }
    }
}

impl FromStr for Device {
    type Err = BaselineError;

    /// From `cpu`, `cuda` or `cuda:1`.
    fn from_str(text: &str) -> Result<Self, BaselineError> {
        let number = match text.split_once(':') {
            None if text == "cpu" => return Ok(Self::Cpu),
            None if text == "cuda" => Some(0),
            Some(("cuda", number)) => number.parse().ok(),
            _ => None,
        };
        number.map(Self::Cuda).ok_or_else(|| refused(text, "use cpu, cuda, or cuda:NUMBER".to_owned()))
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
        }
    }
}

#[cfg(feature = "cuda")]
fn gpu(number: usize) -> Result<TensorDevice, BaselineError> {
    let found = TensorDevice::enumerate(burn::tensor::DeviceType::Cuda).len();
    if number < found {
        return Ok(TensorDevice::cuda(number));
    }
    let name = Device::Cuda(number).to_string();
    Err(refused(
        &name,
        format!("CUDA finds {found} GPUs on this machine, counted from 0; use one of them, or cpu"),
    ))
}

#[cfg(not(feature = "cuda"))]
fn gpu(number: usize) -> Result<TensorDevice, BaselineError> {
    let reason = "this build has no CUDA; use cpu, or build it with it: \
                  cargo install --locked --path crates/swm --features cuda";
    Err(refused(&Device::Cuda(number).to_string(), reason.to_owned()))
}

fn refused(name: &str, reason: String) -> BaselineError {
    BaselineError::Device { name: name.to_owned(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_have_names() {
        let named = [("cpu", Device::Cpu), ("cuda", Device::Cuda(0)), ("cuda:3", Device::Cuda(3))];
        for (text, expected) in named {
            assert_eq!(text.parse::<Device>().unwrap(), expected);
            assert_eq!(expected.to_string().parse::<Device>().unwrap(), expected);
        }
        for text in ["gpu", "cpu:0", "cuda:", "cuda:-1", "cuda3", ""] {
            let error = text.parse::<Device>().unwrap_err().to_string();
            assert!(error.contains("use cpu, cuda, or cuda:NUMBER"), "{error}");
        }
    }

    /// No machine has so many GPUs: the refusal is one of every build.
    #[test]
    fn a_missing_gpu_is_refused_with_the_fix() {
        let error = Device::Cuda(999).device().unwrap_err().to_string();
        assert!(error.starts_with("device `cuda:999`: ") && error.contains("cpu"), "{error}");
    }
}
