//! What a machine lacks for computing on its GPUs: NVIDIA's driver, a GPU, the compiler of kernels, their headers. Takes the
//! answers of CUDA's libraries and makes reasons of them; asks none itself, so that it is tested without CUDA.

use std::any::Any;
use std::fmt::{Debug, Display};
use std::panic::{self, UnwindSafe};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A header that shows that a folder is one of the CUDA toolkit. Kernels in half precision include it.
const HEADER: &str = "include/cuda_fp16.h";

/// How many GPUs the driver counts. `counted`: its answer, or the panic of the crate that loads it.
pub(super) fn gpus<E: Display>(counted: Result<Result<i32, E>, String>) -> Result<usize, String> {
    match counted.map(|count| count.map(usize::try_from)) {
        Ok(Ok(Ok(found))) if found > 0 => Ok(found),
        Ok(Ok(_)) => {
            Err("NVIDIA's driver finds no GPU that this process may use; look at CUDA_VISIBLE_DEVICES and \
                          `nvidia-smi`, or use cpu"
                .to_owned())
        }
        Ok(Err(error)) => {
            Err(format!("NVIDIA's driver gives no GPU: {error}; look at `nvidia-smi`, or use cpu"))
        }
        Err(panic) => Err(format!("NVIDIA's driver cannot be used: {panic}; install it, or use cpu")),
    }
}

/// Whether NVRTC compiles. `compiled`: its answer, or the panic of the crate that loads it.
pub(super) fn compiler<E: Debug>(compiled: Result<Result<(), E>, String>) -> Result<(), String> {
    let reason = match compiled {
        Ok(Ok(())) => return Ok(()),
        Ok(Err(error)) => format!("{error:?}"),
        Err(panic) => panic,
    };
    Err(format!(
        "NVRTC, which compiles CUDA kernels, cannot be used: {reason}; name the folder of libnvrtc in LD_LIBRARY_PATH, \
         install the CUDA toolkit, or use cpu"
    ))
}

/// Whether kernels will find what they include in the CUDA toolkit at `path`, without which none is compiled.
pub(super) fn headers(path: Option<PathBuf>) -> Result<(), String> {
    let lack = match path.map(|path| path.join(HEADER)) {
        Some(header) if header.is_file() => return Ok(()),
        Some(header) => format!("`{}` is not there", header.display()),
        None => "no folder of it was found".to_owned(),
    };
    Err(format!(
        "CUDA kernels need headers of the CUDA toolkit, and {lack}; install it, set CUDA_PATH to the folder that has its \
         `include`, or use cpu"
    ))
}

/// What `call` returns, or the beginning of what it panics with, which is not printed.
pub(super) fn quietly<T>(call: impl FnOnce() -> T + UnwindSafe) -> Result<T, String> {
    // The hook belongs to the process: two calls at a time could leave it silent.
    static ONE: Mutex<()> = Mutex::new(());
    let _guard = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| {}));
    let result = panic::catch_unwind(call);
    panic::set_hook(hook);
    result.map_err(|payload| message(payload.as_ref()))
}

/// Up to the list of all names under which a library was looked for.
fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("it panics");
    text.split(" - searched").next().unwrap_or(text).trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const MISSING: &str =
        "Unable to dynamically load the \"cuda\" shared library - searched for library names: […].";

    #[test]
    fn a_panic_becomes_the_reason() {
        let count: Result<Result<i32, String>, String> = quietly(|| panic!("{MISSING}"));
        let error = gpus(count).unwrap_err();
        assert!(
            error.contains(
                "driver cannot be used: Unable to dynamically load the \"cuda\" shared library; install"
            ),
            "{error}"
        );
        assert_eq!(quietly(|| 3), Ok(3));
        assert_eq!(quietly(|| panic!("no")), Err::<(), _>("no".to_owned()));
    }

    #[test]
    fn each_thing_that_is_missing_is_named_with_the_fix() {
        let none = gpus(Ok(Ok::<_, String>(0))).unwrap_err();
        assert!(none.contains("no GPU") && none.contains("CUDA_VISIBLE_DEVICES"), "{none}");
        let refused = gpus(Ok(Err("CUDA_ERROR_NO_DEVICE"))).unwrap_err();
        assert!(refused.contains("CUDA_ERROR_NO_DEVICE") && refused.contains("nvidia-smi"), "{refused}");
        assert_eq!(gpus(Ok(Ok::<_, String>(2))), Ok(2));

        let nvrtc = compiler::<String>(Err(message(&MISSING.replace("cuda", "nvrtc")))).unwrap_err();
        assert!(nvrtc.contains("\"nvrtc\"") && nvrtc.contains("LD_LIBRARY_PATH"), "{nvrtc}");
        let broken = compiler(Ok(Err("NVRTC_ERROR_OUT_OF_MEMORY"))).unwrap_err();
        assert!(broken.contains("NVRTC_ERROR_OUT_OF_MEMORY"), "{broken}");
        assert_eq!(compiler::<String>(Ok(Ok(()))), Ok(()));
    }

    #[test]
    fn a_toolkit_without_headers_is_named() {
        let none = headers(None).unwrap_err();
        assert!(none.contains("no folder") && none.contains("CUDA_PATH"), "{none}");
        let toolkit = tempfile::tempdir().unwrap();
        let empty = headers(Some(toolkit.path().into())).unwrap_err();
        assert!(empty.contains("cuda_fp16.h` is not there"), "{empty}");
        fs::create_dir(toolkit.path().join("include")).unwrap();
        fs::write(toolkit.path().join(HEADER), "").unwrap();
        assert_eq!(headers(Some(toolkit.path().into())), Ok(()));
    }
}
