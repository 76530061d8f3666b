//! Texts that a user names: settings, manifests, receipts. They may be pipes, but not endless. And texts that are replaced while
//! others read them.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::Path;

/// More is no text of this program: a receipt of 10,000 pairs has 10 MB.
const MAX_BYTES: u64 = 256 << 20;

/// Reads a text.
///
/// # Errors
///
/// It cannot be read, is longer than 256 MB, or is not UTF-8.
pub(crate) fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    let read = File::open(path)?.take(MAX_BYTES + 1).read_to_string(&mut text)?;
    match read as u64 > MAX_BYTES {
        true => Err(io::Error::new(io::ErrorKind::InvalidData, "it is longer than 256 MB")),
        false => Ok(text),
    }
}

/// Writes a text as a whole: readers see the old one or the new one.
///
/// # Errors
///
/// It cannot be written.
pub(crate) fn replace_text(path: &Path, text: &str) -> io::Result<()> {
    let new = path.with_extension(format!("{}.new", std::process::id()));
    let written = fs::write(&new, text).and_then(|()| fs::rename(&new, path));
    // What is half written is of no use; the error that counts is the first one.
    written.inspect_err(|_| drop(fs::remove_file(&new)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endless_text_is_refused() {
        if cfg!(target_os = "linux") {
            assert!(read_text(Path::new("/dev/zero")).unwrap_err().to_string().contains("256 MB"));
        }
    }
}
