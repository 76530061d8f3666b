//! Stands in for CubeCL's LLVM compiler: the names and types that `cubecl-cuda` 0.11.3 uses, and no compiler behind them.
//!
//! `cubecl-cuda` compiles kernels by NVRTC with its feature `cpp`, and through LLVM without it, but links the latter either
//! way. The crate on crates.io has a build script that fetches LLVM from outside of any registry. This one has nothing to
//! fetch, and says so where it is called: [`PlironCompiler::compile`] always fails, [`restrict_features`] panics, and what a
//! compilation would have made is of types without values.
//!
//! [`restrict_features`]: shared::lowered_features::restrict_features

use std::convert::Infallible;
use std::ffi::c_char;

use cubecl_core::ir::nvidia::SmArch;
use cubecl_core::prelude::KernelDefinition;
use cubecl_environment::backtrace::BackTrace;
use cubecl_server::compiler::{CompilationError, Compiler};
use cubecl_server::kernel::BufferIOAttr;

use nvptx::ptx_version::PtxVersion;

/// Why nothing is compiled here, and what to do.
const REASON: &str = "this program was linked without LLVM, so it cannot compile CUDA kernels with it; \
                      build it with the feature `cuda-cpp` of cubecl, which compiles them by NVRTC";

/// What to compile for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LlvmTarget {
    /// NVIDIA's GPUs.
    Nvptx,
}

/// The compiler, which refuses every kernel.
#[derive(Clone, Debug)]
pub struct PlironCompiler {
    /// What it would compile for.
    pub target: LlvmTarget,
}

/// How it would compile.
#[derive(Clone, Debug, Default)]
pub struct PlironOptions {
    /// An architecture of AMD's GPUs: none.
    pub arch: Option<Infallible>,
    /// The architecture of the NVIDIA GPU.
    pub sm_arch: Option<SmArch>,
    /// The version of PTX to emit: none.
    pub ptx_version: Option<PtxVersion>,
    /// Whether launch parameters are grid constants.
    pub grid_constants: bool,
}

/// A compiled kernel, of which there is none.
pub enum PlironArtifact {
    /// For an NVIDIA GPU.
    NvptxCode(NvptxModule),
}

/// A compiled kernel for an NVIDIA GPU, of which there is none.
#[derive(Clone, Debug)]
pub struct NvptxModule {
    /// Assembly, ending with a zero.
    pub ptx: Vec<c_char>,
    /// What is logged.
    pub ir: String,
    /// Bytes of shared memory that a launch reserves.
    pub shared_memory_size: usize,
    /// What it does with each buffer.
    pub io: Vec<BufferIOAttr>,
    /// Nothing has a value of this type, so nothing makes one of these.
    pub never: Infallible,
}

impl std::fmt::Display for PlironArtifact {
    fn fmt(&self, _: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NvptxCode(module) => match module.never {},
        }
    }
}

impl Compiler for PlironCompiler {
    type Representation = PlironArtifact;
    type CompilationOptions = PlironOptions;

    /// Always an error.
    fn compile(
        &mut self,
        _: KernelDefinition,
        _: &PlironOptions,
    ) -> Result<PlironArtifact, CompilationError> {
        Err(refusal())
    }

    fn extension(&self) -> &'static str {
        "ll"
    }

    fn lang_tag(&self) -> &'static str {
        "llvm"
    }
}

fn refusal() -> CompilationError {
    CompilationError::Generic { reason: REASON.to_owned(), backtrace: BackTrace::capture() }
}

/// NVIDIA's assembly.
pub mod nvptx {
    /// Its versions.
    pub mod ptx_version {
        use std::fmt;

        /// A version to emit, of which there is none, as nothing is emitted.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum PtxVersion {}

        impl PtxVersion {
            /// The newest that a driver loads: none.
            #[must_use]
            pub fn for_driver(_version: i32) -> Option<Self> {
                None
            }
        }

        impl fmt::Display for PtxVersion {
            fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
                match *self {}
            }
        }
    }
}

/// What several targets have in common.
pub mod shared {
    /// What LLVM does not compile.
    pub mod lowered_features {
        use cubecl_core::ir::DeviceProperties;

        /// What to compile for.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum GpuTarget {
            /// NVIDIA's GPUs.
            Nvptx,
        }

        /// Removes what the compiler does not support from what a device promises.
        ///
        /// # Panics
        ///
        /// Always: `cubecl-cuda` calls it when it starts to use a device by LLVM, and no kernel would compile.
        pub fn restrict_features(_properties: &mut DeviceProperties, _target: GpuTarget) {
            panic!("{}", super::super::REASON);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_refusal_names_the_feature_that_compiles() {
        let text = refusal().to_string();
        assert!(text.contains("without LLVM") && text.contains("`cuda-cpp`"), "{text}");
    }
}
