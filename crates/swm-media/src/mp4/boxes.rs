//! The boxes that an MP4 file consists of, and what is wrong with a file.
//!
//! Source of the format: ISO/IEC 14496-12.

use crate::error::MediaError;
use crate::format::Format;

/// Why a video cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wrong {
    /// It contradicts itself or was cut short.
    Damaged(String),
    /// It may be valid; this crate does not decode it.
    Unsupported(String),
}

impl From<String> for Wrong {
    fn from(reason: String) -> Self {
        Self::Damaged(reason)
    }
}

impl From<&str> for Wrong {
    fn from(reason: &str) -> Self {
        Self::Damaged(reason.to_owned())
    }
}

impl From<Wrong> for MediaError {
    fn from(wrong: Wrong) -> Self {
        match wrong {
            Wrong::Damaged(reason) => Self::Decode { format: Format::Mp4, reason },
            Wrong::Unsupported(reason) => Self::Unsupported { format: Format::Mp4, reason },
        }
    }
}

/// Name and content.
pub(super) type NamedBox<'a> = ([u8; 4], &'a [u8]);

/// The boxes in `content`, in order.
pub(super) fn boxes(mut content: &[u8]) -> Result<Vec<NamedBox<'_>>, String> {
    let mut found = Vec::new();
    while content.len() >= 8 {
        let size = number(content, 0, 4)? as usize;
        let name = [content[4], content[5], content[6], content[7]];
        let size = if size == 0 { content.len() } else { size };
        let Some(inner) = content.get(8..size) else {
            return Err(format!("box `{}` is cut short", name.escape_ascii()));
        };
        found.push((name, inner));
        content = &content[size..];
    }
    Ok(found)
}

/// The first box of this name.
pub(super) fn find<'a>(content: &'a [u8], name: &[u8; 4]) -> Result<&'a [u8], String> {
    let found = boxes(content)?.into_iter().find(|(there, _)| there == name);
    found.map(|(_, inner)| inner).ok_or_else(|| format!("it has no box `{}`", name.escape_ascii()))
}

/// The number of entries that a table commits, if they are there.
pub(super) fn entries(table: &[u8], width: usize, at: usize) -> Result<usize, String> {
    let count = number(table, at, 4)? as usize;
    match count.checked_mul(width).and_then(|bytes| bytes.checked_add(at + 4)) {
        Some(needed) if needed <= table.len() => Ok(count),
        _ => Err("a table is cut short".to_owned()),
    }
}

/// A big-endian number of `width` bytes.
pub(super) fn number(bytes: &[u8], at: usize, width: usize) -> Result<u64, String> {
    let bytes = at.checked_add(width).and_then(|end| bytes.get(at..end)).ok_or("a box is cut short")?;
    Ok(bytes.iter().fold(0, |value, &byte| value << 8 | u64::from(byte)))
}

/// A big-endian number of four bytes with a sign.
pub(super) fn signed(bytes: &[u8], at: usize) -> Result<i64, String> {
    Ok(i64::from(number(bytes, at, 4)? as u32 as i32))
}
