//! A user's folder, and the program in it.

use std::path::PathBuf;
use std::process::{Command, Output};

/// A folder that goes away, with nothing of the checkout in its environment.
pub(crate) struct Home(tempfile::TempDir);

/// What a command printed.
pub(crate) struct Said {
    pub(crate) status: Option<i32>,
    /// Results.
    pub(crate) out: String,
    /// Notes and messages.
    pub(crate) err: String,
}

impl Home {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `swm` with the words of a line.
    pub(crate) fn command(&self, line: &str) -> Command {
        let program = std::env::var_os("SWM_FIRST_WEEK_COMMAND");
        let mut command =
            Command::new(program.unwrap_or_else(|| env!("CARGO_BIN_EXE_swm-under-test").into()));
        command.args(line.split_whitespace()).current_dir(self.0.path());
        for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_string_lossy().starts_with("CARGO")) {
            command.env_remove(name);
        }
        command
    }

    pub(crate) fn run(&self, line: &str) -> Said {
        let Output { status, stdout, stderr } = self.command(line).output().expect("the program starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("the program prints text");
        Said { status: status.code(), out: text(stdout), err: text(stderr) }
    }

    /// Runs a command that must succeed.
    pub(crate) fn ok(&self, line: &str) -> Said {
        let said = self.run(line);
        assert_eq!(said.status, Some(0), "swm {line}:\n{}{}", said.out, said.err);
        said
    }

    /// Runs a command that must be refused with all of `words`.
    pub(crate) fn refused(&self, line: &str, words: &[&str]) {
        let said = self.run(line);
        assert_eq!(said.status, Some(2), "swm {line}:\n{}{}", said.out, said.err);
        for word in words {
            assert!(said.err.contains(word), "swm {line}: no `{word}` in\n{}", said.err);
        }
    }

    /// The result of a command as JSON.
    pub(crate) fn json(&self, line: &str) -> serde_json::Value {
        serde_json::from_str(&self.ok(&format!("{line} --json")).out).expect("--json prints JSON")
    }
}
