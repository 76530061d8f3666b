//! ONNX Runtime for the tests of exported models: pinned by version and hash, below `.tools`. Users bring their own.

use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::setup::wheel::{Keep, Package, Unpublished, Wheel};
use crate::{process, setup};

/// MIT.
const ONNX_RUNTIME: Package = Package {
    name: "onnxruntime",
    version: "1.23.2",
    wheels: &[
        Wheel {
            platforms: &["linux-x86_64"],
            tag: "manylinux_2_28_x86_64",
            sha256: "0f9b4ae77f8e3c9bee50c27bc1beede83f786fe1d52e99ac85aa8d65a01e9b77",
        },
        Wheel {
            platforms: &["linux-aarch64"],
            tag: "manylinux_2_28_aarch64",
            sha256: "76ff670550dc23e58ea9bc53b5149b99a44e63b34b524f7b8547469aaa0dcb8c",
        },
        Wheel {
            platforms: &["macos-aarch64"],
            tag: "macosx_13_0_arm64",
            sha256: "b8f029a6b98d3cf5be564d52802bb50a8489ab73409fa9db0bf583eabb7c2321",
        },
    ],
    keep: &[
        Keep {
            from: &["onnxruntime/capi/libonnxruntime.so.*", "onnxruntime/capi/libonnxruntime.*.dylib"],
            to: "",
        },
        Keep { from: &["onnxruntime/LICENSE", "onnxruntime/ThirdPartyNotices.txt"], to: "" },
    ],
};

/// What `swm-onnx` looks for, and where it is; nothing where it is not published: tests then say what they leave out.
pub(crate) fn environment() -> Result<Option<(&'static str, PathBuf)>> {
    let folder = match setup::ensure_in(&ONNX_RUNTIME, &process::root().join(".tools")) {
        Ok(folder) => folder,
        Err(error) if error.is::<Unpublished>() => {
            eprintln!("test: {error}: the models exported to ONNX are not tested");
            return Ok(None);
        }
        Err(error) => return Err(error),
    };
    let mut libraries = std::fs::read_dir(&folder)?.filter_map(|entry| Some(entry.ok()?.path()));
    let is_library = |path: &PathBuf| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("libonnxruntime"))
    };
    match libraries.find(is_library) {
        Some(library) => Ok(Some(("ORT_DYLIB_PATH", library))),
        None => bail!("{} holds no library; remove the folder and try again", folder.display()),
    }
}
