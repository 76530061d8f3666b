//! The command `swm`, with baselines on NVIDIA GPUs.

use std::process::ExitCode;

fn main() -> ExitCode {
    swm::cli::main(&swm::registry())
}

#[cfg(test)]
mod tests {
    use cubecl::cuda::compiler::CudaBackend;

    /// The other one is the crate that stands in for LLVM, and compiles nothing.
    #[test]
    fn kernels_are_compiled_by_nvrtc() {
        assert_eq!(CudaBackend::default(), CudaBackend::Cpp);
    }
}
