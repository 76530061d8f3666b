//! Columns of a table and the types of their values.

use std::collections::BTreeSet;
use std::fmt;

use crate::error::{Result, damaged, unsupported};
use crate::proto::fields;

/// Levels of nested types.
const MAX_DEPTH: usize = 8;
/// Fields of a table.
const MAX_FIELDS: usize = 4096;
/// Items of a row of a fixed-size list.
const MAX_WIDTH: usize = 1 << 28;

/// The type of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// True or false, a byte 0 or 1 as it is read.
    Bool,
    /// Integers.
    Int {
        /// 8, 16, 32 or 64.
        bits: u8,
        /// Whether they may be negative.
        signed: bool,
    },
    /// Floats.
    Float {
        /// 16, 32 or 64.
        bits: u8,
    },
    /// UTF-8.
    Text,
    /// Bytes, such as files of images.
    Binary,
    /// As many values in each row.
    Fixed(Box<Self>, usize),
    /// Any number of values in a row.
    List(Box<Self>),
    /// What this reader has no values of, as the table names it.
    Other(String),
}

impl Kind {
    fn parse(name: &str, depth: usize) -> Self {
        let int = |bits, signed| Self::Int { bits, signed };
        match name {
            "bool" => Self::Bool,
            "int8" => int(8, true),
            "int16" => int(16, true),
            "int32" => int(32, true),
            "int64" => int(64, true),
            "uint8" => int(8, false),
            "uint16" => int(16, false),
            "uint32" => int(32, false),
            "uint64" => int(64, false),
            "halffloat" => Self::Float { bits: 16 },
            "float" => Self::Float { bits: 32 },
            "double" => Self::Float { bits: 64 },
            "string" | "large_string" => Self::Text,
            "binary" | "large_binary" => Self::Binary,
            other => Self::fixed(other, depth).unwrap_or_else(|| Self::Other(other.to_owned())),
        }
    }

    /// `fixed_size_list:float:2`.
    fn fixed(name: &str, depth: usize) -> Option<Self> {
        let (item, width) = name.strip_prefix("fixed_size_list:")?.rsplit_once(':')?;
        let width: usize = width.parse().ok()?;
        let item = Self::parse(item, depth.checked_sub(1)?);
        let width_of_all = item.shape()?.1.checked_mul(width)?;
        (width > 0 && width_of_all <= MAX_WIDTH).then(|| Self::Fixed(Box::new(item), width))
    }

    /// The bytes of an item, 0 where each has its own, and the items of a value. `None` for lists and what has no values.
    pub(crate) fn shape(&self) -> Option<(usize, usize)> {
        match self {
            Self::Bool => Some((1, 1)),
            Self::Int { bits, .. } | Self::Float { bits } => Some((usize::from(*bits) / 8, 1)),
            Self::Text | Self::Binary => Some((0, 1)),
            Self::Fixed(item, width) => match item.shape()? {
                (0, _) => None,
                (size, items) => Some((size, items * width)),
            },
            Self::List(_) | Self::Other(_) => None,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool => f.write_str("bool"),
            Self::Int { bits, signed } => write!(f, "{}int{bits}", if *signed { "" } else { "u" }),
            Self::Float { bits } => write!(f, "float{bits}"),
            Self::Text => f.write_str("string"),
            Self::Binary => f.write_str("binary"),
            Self::Fixed(item, width) => write!(f, "{width} of {item}"),
            Self::List(item) => write!(f, "list of {item}"),
            Self::Other(name) => f.write_str(name),
        }
    }
}

/// A column of values. Members of structures are columns of their own.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Column {
    /// Its name; that of a member follows that of its structure and a dot.
    pub name: String,
    /// The type of its values.
    pub kind: Kind,
    /// The field of the schema.
    pub(crate) field: i32,
    /// That of the items of a list.
    pub(crate) item: Option<i32>,
}

/// A field as the manifest has it.
#[derive(Debug)]
pub(crate) struct Stored {
    name: String,
    id: i32,
    parent: i32,
    kind: String,
    /// Whether its bytes are in other places, by its metadata.
    is_blob: bool,
}

impl Stored {
    pub(crate) fn parse(message: &[u8]) -> Result<Self> {
        let mut stored = Self { name: String::new(), id: 0, parent: 0, kind: String::new(), is_blob: false };
        for field in fields(message) {
            let (number, value) = field?;
            match number {
                2 => stored.name = value.text()?,
                3 => stored.id = value.signed()?,
                4 => stored.parent = value.signed()?,
                5 => stored.kind = value.text()?,
                10 => stored.is_blob |= value.bytes()?.windows(BLOB.len()).any(|part| part == BLOB),
                _ => {}
            }
        }
        Ok(stored)
    }
}

/// In the metadata of a field.
const BLOB: &[u8] = b"lance-encoding:blob";

/// The columns of a schema.
pub(crate) fn columns(stored: &[Stored]) -> Result<Vec<Column>> {
    let (mut found, mut ids) = (Vec::new(), BTreeSet::new());
    if stored.len() > MAX_FIELDS {
        return Err(unsupported(format!("it has {} fields, and {MAX_FIELDS} are read", stored.len())));
    }
    if let Some(field) = stored.iter().find(|field| field.id < 0 || !ids.insert(field.id)) {
        return Err(damaged(format!(
            "its field `{}` has the number {} of another one",
            field.name, field.id
        )));
    }
    for field in stored.iter().filter(|field| field.parent < 0) {
        add(stored, field, &field.name, MAX_DEPTH, &mut found)?;
    }
    Ok(found)
}

fn add(stored: &[Stored], field: &Stored, name: &str, depth: usize, found: &mut Vec<Column>) -> Result<()> {
    let depth = depth.checked_sub(1).ok_or_else(|| damaged(format!("`{name}` is nested too deeply")))?;
    let mut children = stored.iter().filter(|child| child.parent == field.id && child.id != field.id);
    let mut item = None;
    let kind = match field.kind.as_str() {
        _ if field.is_blob => Kind::Other("blob".to_owned()),
        "struct" => {
            for child in children {
                add(stored, child, &format!("{name}.{}", child.name), depth, found)?;
            }
            return Ok(());
        }
        "list" | "large_list" => match (children.next(), children.next()) {
            (Some(child), None) => match Kind::parse(&child.kind, MAX_DEPTH) {
                kind if matches!(kind.shape(), Some((_, 1))) && !child.is_blob => {
                    item = Some(child.id);
                    Kind::List(Box::new(kind))
                }
                _ => Kind::Other(format!("list of {}", child.kind)),
            },
            _ => return Err(damaged(format!("the list `{name}` has no items"))),
        },
        kind => Kind::parse(kind, MAX_DEPTH),
    };
    found.push(Column { name: name.to_owned(), kind, field: field.id, item });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_parsed_from_their_names() {
        let kind = |name| Kind::parse(name, MAX_DEPTH);
        assert_eq!(kind("uint16"), Kind::Int { bits: 16, signed: false });
        let nested = kind("fixed_size_list:fixed_size_list:double:3:2");
        assert_eq!((nested.shape(), nested.to_string()), (Some((8, 6)), "2 of 3 of float64".to_owned()));
        for name in [
            "date32:day",
            "fixed_size_list:string:2x",
            "fixed_size_list:int8:0",
            "",
            "fixed_size_list:int8:999999999",
        ] {
            assert_eq!(kind(name), Kind::Other(name.to_owned()));
        }
        let deep = format!("{}int8{}", "fixed_size_list:".repeat(9), ":1".repeat(9));
        assert!(matches!(kind(&deep), Kind::Fixed(..)) == kind(&deep).shape().is_some());
    }
}
