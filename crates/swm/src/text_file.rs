//! Texts that a user names: settings, manifests, receipts. They may be pipes, but not endless.

use std::fs::File;
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
