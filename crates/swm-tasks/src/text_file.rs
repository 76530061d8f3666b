//! Texts that a user names: settings, manifests, receipts. They may be pipes, but not endless. And texts that are replaced while
//! others read them.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use swm_core::settings::plain;

/// More is no text of this program: a receipt of 10,000 pairs has 10 MB.
const MAX_BYTES: u64 = 256 << 20;

/// Reads a text.
///
/// # Errors
///
/// It cannot be read, is longer than 256 MB, or is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    let file = File::open(path)?;
    let read = file.take(MAX_BYTES + 1).read_to_string(&mut text).map_err(|error| match error.kind() {
        io::ErrorKind::InvalidData => io::Error::new(
            error.kind(),
            "it is no text in UTF-8: it is another file, or has to be saved again as UTF-8",
        ),
        _ => error,
    })?;
    match read as u64 > MAX_BYTES {
        true => Err(io::Error::new(io::ErrorKind::InvalidData, "it is longer than 256 MB")),
        false => Ok(text),
    }
}

/// What is wrong in a JSON text, and in which line.
pub fn json_error(text: &str, error: &serde_json::Error) -> String {
    if error.is_eof() {
        return "it ends in the middle of a value, as if it was cut off".to_owned();
    }
    let said = error.to_string();
    let (said, _) = said.rsplit_once(" at line ").unwrap_or((&said, ""));
    in_line(text, error.line(), &plain(said))
}

/// What is wrong in a TOML text, and in which line or under which name.
pub fn toml_error(text: &str, error: &toml::de::Error) -> String {
    let said = plain(error.message());
    if let Some(span) = error.span() {
        let before = text.get(..span.start).unwrap_or(text);
        return in_line(text, 1 + before.matches('\n').count(), &said);
    }
    // A table that was read already has no lines, but names.
    let shown = error.to_string();
    match shown.rsplit_once("in `").and_then(|(_, rest)| rest.split_once('`')) {
        Some((name, _)) => format!("`{name}`: {said}"),
        None => said,
    }
}

/// `said` of the line `number`, counted from 1, which is shown if it is no longer than a line should be.
fn in_line(text: &str, number: usize, said: &str) -> String {
    const LONGEST: usize = 80;
    let line = number.checked_sub(1).and_then(|index| text.lines().nth(index)).unwrap_or_default().trim();
    match line.len() {
        0 if number == 0 => said.to_owned(),
        0 => format!("line {number}: {said}"),
        length if length > LONGEST => format!("line {number}: {said}"),
        _ => format!("line {number}, `{line}`: {said}"),
    }
}

/// Writes a text as a whole: readers see the old one or the new one, also after a loss of power.
///
/// # Errors
///
/// It cannot be written.
pub fn replace_text(path: &Path, text: &str) -> io::Result<()> {
    swm_files::replace(path, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_cannot_be_read_is_told_by_line_or_name() {
        let text = "{\n  \"pairs\": \"five\"\n}";
        let error = serde_json::from_str::<std::collections::BTreeMap<String, u64>>(text).unwrap_err();
        let told = "line 2, `\"pairs\": \"five\"`: must be a whole number, 0 or more; found string \"five\"";
        assert_eq!(json_error(text, &error), told);
        let cut = serde_json::from_str::<serde_json::Value>("{\"a\": ").unwrap_err();
        assert!(json_error("{\"a\": ", &cut).contains("cut off"));
    }

    #[test]
    fn what_is_no_toml_is_told_by_line_or_name() {
        let text = "a = 1\nb = [";
        let error = toml::from_str::<toml::Table>(text).unwrap_err();
        assert!(toml_error(text, &error).starts_with("line 2, `b = [`: "), "{}", toml_error(text, &error));
        let table: toml::Table = toml::from_str("budget = \"many\"").unwrap();
        let error = table.try_into::<std::collections::BTreeMap<String, u64>>().unwrap_err();
        let told = "`budget`: must be a whole number, 0 or more; found string \"many\"";
        assert_eq!(toml_error("", &error), told);
    }

    #[test]
    fn bytes_that_are_no_text_are_refused_in_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("no text in UTF-8"));
    }

    #[test]
    fn an_endless_text_is_refused() {
        if cfg!(target_os = "linux") {
            assert!(read_text(Path::new("/dev/zero")).unwrap_err().to_string().contains("256 MB"));
        }
    }
}
