//! The versions of programs, as they print them.

use std::fmt;
use std::path::Path;
use std::process::{Command, Stdio};

/// Major and minor: what build scripts ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Version(pub(super) u32, pub(super) u32);

impl Version {
    /// Reads major and minor of `3.31.10`, `1.13.0.git.kitware` and their like.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut parts = text.trim().split('.').map(str::parse);
        Some(Self(parts.next()?.ok()?, parts.next()?.ok()?))
    }

    /// Finds the version in what `--version` prints: on the first line, alone or as its last word.
    fn in_output(text: &str) -> Option<Self> {
        Self::parse(text.lines().next()?.split_whitespace().last()?)
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.0, self.1)
    }
}

/// The version that the program prints; none where it does not run.
pub(super) fn version(binary: &Path) -> Option<Version> {
    let output = Command::new(binary).arg("--version").stdin(Stdio::null()).output().ok()?;
    Version::in_output(std::str::from_utf8(&output.stdout).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_from_what_the_tools_print() {
        let cmake =
            "cmake version 3.31.10\n\nCMake suite maintained and supported by Kitware (kitware.com/cmake).\n";
        assert_eq!(Version::in_output(cmake), Some(Version(3, 31)));
        assert_eq!(Version::in_output("1.13.0.git.kitware.jobserver-pipe-1\n"), Some(Version(1, 13)));
        assert_eq!(Version::in_output("command not found"), None);
        assert_eq!(Version::in_output(""), None);
    }
}
