//! What the rules look at: the files of the checkout and the graph of crates, read once.

use std::fs;
use std::process::Command;

use anyhow::{Context as _, Result};

use crate::metadata::Metadata;
use crate::process;

/// The checkout.
pub(super) struct Tree {
    /// Text files that git tracks, or would after `git add`.
    pub files: Vec<TextFile>,
    /// Path and size in bytes of every such file.
    pub sizes: Vec<(String, u64)>,
    /// The crates.
    pub metadata: Metadata,
}

/// One text file.
pub(super) struct TextFile {
    /// From the root, with `/`.
    pub path: String,
    pub text: String,
}

impl Tree {
    /// Reads the checkout.
    pub(super) fn load() -> Result<Self> {
        let mut git = Command::new("git");
        // A CI machine may run us as another user than the one who owns the checkout; we only list files.
        git.current_dir(process::root()).args(["-c", "safe.directory=*"]).args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ]);
        let listing = process::output(&mut git)
            .context("tidy checks what git tracks, so it needs git and a git checkout")?;
        let listing = String::from_utf8(listing).context("git lists a file whose name is not UTF-8")?;
        let mut tree = Self { files: Vec::new(), sizes: Vec::new(), metadata: Metadata::load()? };
        for path in listing.split_terminator('\0') {
            let full = process::root().join(path);
            // Deleted but not yet committed, or a link.
            let Ok(metadata) = fs::symlink_metadata(&full) else { continue };
            if !metadata.is_file() {
                continue;
            }
            tree.sizes.push((path.into(), metadata.len()));
            let bytes = fs::read(&full).with_context(|| format!("failed to read {}", full.display()))?;
            if let Some(text) = String::from_utf8(bytes).ok().filter(|text| !text.contains('\0')) {
                tree.files.push(TextFile { path: path.into(), text });
            }
        }
        Ok(tree)
    }

    /// The text of one file; empty where it does not exist, so that the rule about it says what is missing.
    pub(super) fn text(&self, path: &str) -> &str {
        self.files.iter().find(|file| file.path == path).map_or("", |file| file.text.as_str())
    }
}

#[cfg(test)]
impl TextFile {
    pub(super) fn new(path: &str, text: &str) -> Self {
        Self { path: path.into(), text: text.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_holds_this_file_and_no_build_output() {
        let tree = Tree::load().unwrap();
        assert!(tree.text("xtask/src/tidy/tree.rs").starts_with("//! What the rules look at"));
        assert!(tree.sizes.iter().all(|(path, _)| !path.starts_with("target/")));
    }
}
