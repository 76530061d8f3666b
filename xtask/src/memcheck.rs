//! `cargo xtask memcheck`: runs the tests of the `unsafe` code under valgrind, which sees reads and writes out of bounds,
//! uses of freed or uninitialized memory, and leaks, in MuJoCo's C as in our Rust.
//!
//! Valgrind and not AddressSanitizer: the sanitizer needs a nightly toolchain and cannot see into a library that was
//! built without it.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;

use crate::{process, setup};

/// Options of `cargo xtask memcheck`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The crate whose tests run
    #[arg(short, long, value_name = "CRATE", default_value = "swm-mujoco")]
    package: String,
    /// Run the tests whose path contains this; `""` runs all of them, which takes long
    #[arg(default_value = "tests::")]
    filter: String,
}

/// Leaks count if nothing points to the memory any more: what a library keeps until the process ends is no leak.
const VALGRIND: &[&str] = &[
    "--quiet",
    "--error-exitcode=9",
    "--leak-check=full",
    "--show-leak-kinds=definite",
    "--errors-for-leak-kinds=definite",
    "--num-callers=30",
];

/// Builds the tests and runs each binary under valgrind.
pub(crate) fn run(args: &Args) -> Result<()> {
    if process::output(Command::new("valgrind").arg("--version")).is_err() {
        bail!(
            "valgrind was not found on PATH\n\
             to fix it, install your system's package `valgrind` (Linux; there is none for macOS on ARM or Windows)"
        );
    }
    setup::run(&setup::Args::default())?;
    let mut build =
        process::cargo(["test", "--lib", "--no-run", "--message-format", "json-render-diagnostics"]);
    let messages = process::output(build.args(["--package", &args.package]))?;
    let binaries = test_binaries(&messages)?;
    if binaries.is_empty() {
        bail!("{} has no library with tests", args.package);
    }
    for binary in binaries {
        let mut valgrind = Command::new("valgrind");
        valgrind.current_dir(process::root()).args(VALGRIND).arg(&binary);
        // One at a time: valgrind runs one thread anyway, and its report then belongs to the test named last.
        process::run(valgrind.args([&args.filter, "--test-threads=1"]))
            .context("valgrind found an error, or a test failed under it; its report stands above")?;
    }
    println!("memcheck: no error, no leak");
    Ok(())
}

/// The programs that cargo reports to have built as tests.
fn test_binaries(messages: &[u8]) -> Result<Vec<PathBuf>> {
    #[derive(Deserialize)]
    struct Message {
        executable: Option<PathBuf>,
        profile: Option<Profile>,
    }
    #[derive(Deserialize)]
    struct Profile {
        test: bool,
    }
    let mut binaries = Vec::new();
    for line in String::from_utf8_lossy(messages).lines() {
        let message: Message = serde_json::from_str(line).context("cargo wrote a message that is no JSON")?;
        if message.profile.is_some_and(|profile| profile.test) {
            binaries.extend(message.executable);
        }
    }
    Ok(binaries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_tests_are_run() {
        let messages =
            br#"{"reason":"compiler-artifact","profile":{"test":false},"executable":"target/debug/swm"}
{"reason":"compiler-artifact","profile":{"test":true},"executable":"target/debug/deps/swm-1"}
{"reason":"compiler-artifact","profile":{"test":true},"executable":null}
{"reason":"build-finished","success":true}"#;
        assert_eq!(test_binaries(messages).unwrap(), [PathBuf::from("target/debug/deps/swm-1")]);
        assert!(test_binaries(b"error: no").is_err());
    }
}
