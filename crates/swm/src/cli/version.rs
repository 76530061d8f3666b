//! What `swm --version` says: the program, the physics and the renderer, each of which results depend on.

use std::fmt::Write as _;
use std::sync::LazyLock;

use crate::doctor;

/// Several lines: the program, its renderer, its physics, its features.
pub(super) fn long() -> &'static str {
    // Results depend on these, and all crates of the workspace have one version.
    const OURS: &str = env!("CARGO_PKG_VERSION");
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let mut text =
            format!("{}\nrenderer: swm-render {OURS}\nphysics: swm-envs-2d {OURS}", doctor::program_line());
        #[cfg(feature = "mujoco")]
        let _ = write!(text, ", {}", doctor::mujoco_version());
        let _ = write!(text, "\nfeatures: {}", features().join(" "));
        text
    });
    &TEXT
}

/// The features of this build.
fn features() -> Vec<&'static str> {
    [
        ("baselines", cfg!(feature = "baselines")),
        ("cli", cfg!(feature = "cli")),
        ("cuda", cfg!(feature = "cuda")),
        ("faer", cfg!(feature = "faer")),
        ("lance", cfg!(feature = "lance")),
        ("lerobot", cfg!(feature = "lerobot")),
        ("mp4", cfg!(feature = "mp4")),
        ("mujoco", cfg!(feature = "mujoco")),
        ("onnx", cfg!(feature = "onnx")),
        ("rapier", cfg!(feature = "rapier")),
        ("ui", cfg!(feature = "ui")),
    ]
    .into_iter()
    .filter_map(|(name, built)| built.then_some(name))
    .collect()
}
