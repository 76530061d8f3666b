//! The name of this program: `swm`, `swm-rs` of the Python package, or that of a plugin's command. Messages and help are written
//! for `swm`; another program prints them with its own name.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::path::Path;
use std::sync::{LazyLock, OnceLock};

use clap::CommandFactory as _;

use super::Cli;

/// The name in messages and help.
const WRITTEN: &str = "swm";

static NAME: OnceLock<String> = OnceLock::new();

/// Takes the name from the first word of the command line. That of a process does not change.
pub(super) fn set(first: Option<&OsStr>) {
    let name = first.and_then(|first| Path::new(first).file_name()).unwrap_or(OsStr::new(WRITTEN));
    let name = name.to_string_lossy();
    NAME.get_or_init(|| name.strip_suffix(std::env::consts::EXE_SUFFIX).unwrap_or(&name).to_owned());
}

/// The name.
pub(super) fn name() -> &'static str {
    NAME.get().map_or(WRITTEN, String::as_str)
}

/// Whether messages and help have to name another program than they are written for.
pub(super) fn is_renamed() -> bool {
    name() != WRITTEN
}

/// A text for the user, with this program's name in front of its commands.
pub(super) fn with_name(text: &str) -> Cow<'_, str> {
    renamed(text, name())
}

fn renamed<'a>(text: &'a str, name: &str) -> Cow<'a, str> {
    if name == WRITTEN {
        return Cow::Borrowed(text);
    }
    let mut told = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(WRITTEN) {
        let (before, after) = (&rest[..at], &rest[at + WRITTEN.len()..]);
        told += before;
        told += if is_word_end(&told) && begins_with_command(after) { name } else { WRITTEN };
        rest = after;
    }
    Cow::Owned(told + rest)
}

/// Whether a word may begin behind `before`.
fn is_word_end(before: &str) -> bool {
    before.chars().next_back().is_none_or(|last| last.is_whitespace() || "`'\"(".contains(last))
}

/// Whether a command stands behind the name, on the next line, too.
fn begins_with_command(after: &str) -> bool {
    static COMMANDS: LazyLock<Vec<String>> = LazyLock::new(|| {
        Cli::command().get_subcommands().map(|command| command.get_name().to_owned()).collect()
    });
    let word = after.trim_start();
    let end = word.find(|letter: char| letter != '-' && !letter.is_ascii_lowercase()).unwrap_or(word.len());
    word.len() < after.len() && COMMANDS.iter().any(|command| *command == word[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_get_the_name_of_the_program() {
        for (text, told) in [
            ("unknown; `swm envs` lists them", "unknown; `my-env envs` lists them"),
            ("run: swm train --resume runs", "run: my-env train --resume runs"),
            ("swm verify-result out", "my-env verify-result out"),
            ("`swm\n    fovs ENV` lists", "`my-env\n    fovs ENV` lists"),
            ("a crate swm has", "a crate swm has"),
            ("swm/PushT-v1 and /opt/swm envs", "swm/PushT-v1 and /opt/swm envs"),
            ("features of `swm` in Cargo.toml", "features of `swm` in Cargo.toml"),
            ("stable swmenvs, swm", "stable swmenvs, swm"),
        ] {
            assert_eq!(renamed(text, "my-env"), told);
            assert_eq!(renamed(text, "swm"), text);
        }
    }
}
