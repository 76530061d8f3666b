//! Files that people take for weights, and what they are.

use std::fs::File;

use crate::archive;
use crate::file::spaced;

/// Bytes of a file's start that tell.
pub(crate) const START: usize = 512;

/// Why a file is none of weights, by its start and length.
pub(crate) fn of(start: &[u8], len: u64, file: &mut File) -> Option<String> {
    if start.is_empty() {
        return Some("the file is empty: the download failed; fetch it again".to_owned());
    }
    let text = String::from_utf8_lossy(start);
    let text = text.trim_start();
    if text.starts_with("version https://git-lfs") {
        let size = text.lines().find_map(|line| line.strip_prefix("size ")?.trim().parse::<u64>().ok());
        let size = size.map_or(String::new(), |size| format!(" ({} MB)", size.div_ceil(1_000_000)));
        return Some(format!(
            "the file is a pointer of Git LFS, not the weights{size}: run `git lfs pull` in its repository, or `hf download`"
        ));
    }
    let lower = text.get(..text.len().min(64)).unwrap_or("").to_ascii_lowercase();
    if lower.starts_with("<!doctype") || lower.starts_with("<html") || lower.starts_with("<?xml") {
        return Some("the file is a web page, not weights: the download failed; fetch it again".to_owned());
    }
    let is_cut = start.starts_with(b"PK\x03\x04") && !archive::has_end(file).unwrap_or(false);
    is_cut.then(|| {
        format!("the file is cut off ({} bytes; its archive has no end): fetch it again", spaced(len))
    })
}
