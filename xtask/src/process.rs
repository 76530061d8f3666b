//! Running other programs: where the checkout is, which cargo to call, and errors that say what was run.
//!
//! Knows no command of its own.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use anyhow::{Context as _, Error, Result, bail};

/// The root of the checkout that cargo runs us in. A binary in a build directory that several checkouts share may have been
/// built in another one.
pub(crate) fn root() -> &'static Path {
    static ROOT: LazyLock<PathBuf> = LazyLock::new(|| {
        let xtask =
            std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        Path::new(&xtask).parent().expect("xtask lies one level below the root").into()
    });
    &ROOT
}

/// The cargo that runs us, to be started in the checkout's root, without the variables that it set to describe xtask: build
/// scripts that read them (ring's) would be run again, and all that depends on them built again, after each other cargo.
pub(crate) fn cargo<I: AsRef<OsStr>>(args: impl IntoIterator<Item = I>) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    for (name, _) in std::env::vars_os().filter(|(name, _)| describes_a_package(name)) {
        command.env_remove(name);
    }
    command.current_dir(root()).args(args);
    command
}

/// Whether `cargo run` sets this variable to tell a program about its own package.
fn describes_a_package(name: &OsStr) -> bool {
    let name = name.to_string_lossy();
    name.starts_with("CARGO_PKG_") || matches!(&*name, "CARGO_MANIFEST_DIR" | "CARGO_MANIFEST_PATH")
}

/// Whether cargo has the subcommand `name`, its own or an installed one.
pub(crate) fn has_cargo_command(name: &str) -> bool {
    let list = output(&mut cargo(["--list"])).unwrap_or_default();
    String::from_utf8_lossy(&list).lines().any(|line| line.split_whitespace().next() == Some(name))
}

/// Whether a C++ compiler answers; without one, everything is built but MP4 videos.
pub(crate) fn has_cxx() -> bool {
    static FOUND: LazyLock<bool> = LazyLock::new(|| {
        let chosen = std::env::var_os("CXX").filter(|name| !name.is_empty());
        let usual = ["c++", "g++", "clang++"].map(Into::into);
        let mut candidates = chosen.map_or_else(|| usual.to_vec(), |name| vec![name]).into_iter();
        let found = candidates
            .any(|name| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success()));
        if !found {
            eprintln!(
                "xtask: no C++ compiler (tried $CXX, c++, g++, clang++): MP4 videos are left out, GIFs take their place"
            );
        }
        found
    });
    *FOUND
}

/// Shows the command line and runs it with our standard streams; an exit status other than 0 is an error.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    let line = display(command);
    eprintln!("$ {line}");
    let status = command.status().with_context(|| format!("failed to start `{line}`"))?;
    if !status.success() {
        bail!("`{line}` failed: {status}");
    }
    Ok(())
}

/// Runs silently and returns standard output; the error carries standard error.
pub(crate) fn output(command: &mut Command) -> Result<Vec<u8>> {
    let line = display(command);
    let output =
        command.stdin(Stdio::null()).output().with_context(|| format!("failed to start `{line}`"))?;
    if !output.status.success() {
        let stderr = String::from_utf8_lossy(&output.stderr);
        bail!("`{line}` failed: {}\n{}", output.status, stderr.trim_end());
    }
    Ok(output.stdout)
}

/// An error and its causes, one per line.
pub(crate) fn report(error: &Error) -> String {
    error.chain().map(ToString::to_string).collect::<Vec<_>>().join("\ncause: ")
}

/// A command line to copy into a shell: the program's plain name, words with blanks quoted.
fn display(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_stem().unwrap_or(command.get_program());
    let words = std::iter::once(program).chain(command.get_args()).map(|word| {
        let word = word.to_string_lossy();
        if word.is_empty() || word.contains(char::is_whitespace) { format!("'{word}'") } else { word.into() }
    });
    words.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_holds_the_workspace_manifest() {
        assert!(root().join("Cargo.lock").is_file());
    }

    #[test]
    fn a_failed_command_says_what_was_run_and_why_it_failed() {
        let error = output(&mut cargo(["no-such-subcommand", "two words"])).unwrap_err().to_string();
        assert!(
            error.starts_with("`cargo no-such-subcommand 'two words'` failed: exit status: 101"),
            "{error}"
        );
        assert!(error.contains("no such command"), "{error}");
    }

    #[test]
    fn a_cargo_that_we_start_knows_nothing_of_our_package() {
        let of_ours = ["CARGO_PKG_VERSION_MAJOR", "CARGO_MANIFEST_DIR"];
        assert!(of_ours.iter().all(|name| describes_a_package(name.as_ref())));
        let of_users = ["CARGO_TARGET_DIR", "CARGO_INCREMENTAL", "CARGO_HOME", "CARGO"];
        assert!(!of_users.iter().any(|name| describes_a_package(name.as_ref())));
        let command = cargo(["metadata"]);
        assert!(command.get_envs().any(|(name, value)| name == "CARGO_MANIFEST_DIR" && value.is_none()));
    }

    #[test]
    fn a_report_leads_from_the_effect_to_the_cause() {
        let error = Error::msg("no space").context("failed to write a.txt");
        assert_eq!(report(&error), "failed to write a.txt\ncause: no space");
    }

    #[test]
    fn installed_and_missing_subcommands_are_told_apart() {
        assert!(has_cargo_command("metadata"));
        assert!(!has_cargo_command("no-such-subcommand"));
    }
}
