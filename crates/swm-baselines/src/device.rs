//! What networks are computed on: this machine's CPU, or a GPU in builds with the feature `cuda`.

use std::fmt;
use std::str::FromStr;

use burn::tensor::Device as TensorDevice;

use crate::error::BaselineError;

mod heap;
#[cfg(any(test, feature = "cuda"))]
mod missing;

/// What networks are computed on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
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
            Self::Cpu => {
                heap::keep_freed();
                Ok(TensorDevice::flex())
            }
            Self::Cuda(number) => open(number).map_err(|reason| refused(&self.to_string(), reason)),
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

/// CUDA's libraries are loaded when they are first called, and a missing one is a panic of the crate that loads it, on a thread
/// of the backend. So they are called here first, once in a process.
#[cfg(feature = "cuda")]
fn open(number: usize) -> Result<TensorDevice, String> {
    use missing::quietly;
    static FOUND: std::sync::LazyLock<Result<usize, String>> = std::sync::LazyLock::new(|| {
        let kernel = "extern \"C\" __global__ void nothing() {}";
        let found = missing::gpus(quietly(cudarc::driver::CudaContext::device_count))?;
        missing::compiler(quietly(|| cudarc::nvrtc::compile_ptx(kernel).map(drop)))?;
        missing::headers(cubecl::cuda::install::cuda_path())?;
        Ok(found)
    });
    let found = FOUND.clone()?;
    if number < found {
        return Ok(TensorDevice::cuda(number));
    }
    Err(format!("CUDA finds {found} GPUs on this machine, counted from 0; use one of them, or cpu"))
}

#[cfg(not(feature = "cuda"))]
fn open(_number: usize) -> Result<TensorDevice, String> {
    Err("this build has no CUDA; use cpu, or build it with CUDA in the folder `gpu` of a checkout: \
         cargo install --locked --path ."
        .to_owned())
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
