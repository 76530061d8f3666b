//! The manifest of a table: one version of it, with its columns and the files of its rows.

use std::collections::{BTreeMap, BTreeSet};

use crate::deletions::DeletionFile;
use crate::error::{At as _, Result, damaged, unsupported};
use crate::kind::{Column, Stored, columns};
use crate::proto::fields;
use crate::store::{Extent, Store, read};

const VERSIONS: &str = "_versions";
const MAGIC: &[u8] = b"LANC";
/// Position of the manifest, version of the file, magic number.
const FOOTER: usize = 16;
/// Digits of a name that counts down.
const DIGITS: usize = 20;

/// Features that a reader has to support. These change nothing for this one, or are checked in the fragments.
const KNOWN_FEATURES: u64 =
    DELETIONS | STABLE_ROW_IDS | V2 | CONFIG | BASE_PATHS | NO_TRANSACTIONS | MIXED_VERSIONS;
const DELETIONS: u64 = 1;
const STABLE_ROW_IDS: u64 = 1 << 1;
const V2: u64 = 1 << 2;
const CONFIG: u64 = 1 << 3;
const BASE_PATHS: u64 = 1 << 4;
const NO_TRANSACTIONS: u64 = 1 << 5;
const MIXED_VERSIONS: u64 = 1 << 8;

/// One version of a table.
#[derive(Debug, Default)]
pub(crate) struct Manifest {
    pub(crate) version: u64,
    pub(crate) columns: Vec<Column>,
    pub(crate) fragments: Vec<Fragment>,
    /// Texts that describe the table.
    pub(crate) metadata: BTreeMap<String, String>,
}

/// Rows of a table that are in the same files.
#[derive(Debug, Default)]
pub(crate) struct Fragment {
    pub(crate) id: u64,
    /// With those that are deleted.
    pub(crate) rows: u64,
    pub(crate) files: Vec<FileEntry>,
    pub(crate) deletions: Option<DeletionFile>,
}

/// A file, and which columns it has.
#[derive(Debug, Default)]
pub(crate) struct FileEntry {
    /// Relative to the table.
    pub(crate) path: String,
    /// Of each column of the file, the field of the schema.
    fields: Vec<i32>,
    /// Of each field, the column of the file; negative where it has none.
    columns: Vec<i32>,
    /// 0 if the manifest does not have it.
    pub(crate) size: u64,
}

impl FileEntry {
    /// Whether the file has a field, and the column of it.
    pub(crate) fn column(&self, field: i32) -> Option<usize> {
        let at = self.fields.iter().position(|&there| there == field)?;
        // Files of the first writers have no such list: a column for each field.
        let Some(&column) = self.columns.get(at) else { return self.columns.is_empty().then_some(at) };
        usize::try_from(column).ok()
    }
}

/// The newest version. Detached ones, which are named `d…`, are of nobody's history.
pub(crate) fn newest(store: &dyn Store) -> Result<Manifest> {
    let names = store.names(VERSIONS).at(VERSIONS)?;
    let newest = names.iter().filter_map(|name| Some((version(name)?, name))).max();
    let (version, name) = newest.ok_or_else(|| damaged("it has no manifest in `_versions`"))?;
    let path = format!("{VERSIONS}/{name}");
    let manifest = open(store, &path).at(&path)?;
    match manifest.version == version {
        true => Ok(manifest),
        false => Err(damaged(format!("{path}: it is of version {}", manifest.version))),
    }
}

/// The version that a manifest is named after: `12.manifest`, or 20 digits that count down.
fn version(name: &str) -> Option<u64> {
    let digits = name.strip_suffix(".manifest")?;
    if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let number: u64 = digits.parse().ok()?;
    Some(if digits.len() == DIGITS { u64::MAX - number } else { number })
}

fn open(store: &dyn Store, path: &str) -> Result<Manifest> {
    let file = store.open(path)?;
    let whole = Extent { at: 0, size: file.length() };
    let end = whole.size.checked_sub(FOOTER as u64).ok_or_else(|| damaged("it is cut"))?;
    let footer = read(file.as_ref(), whole.part(end, FOOTER as u64)?)?;
    if !footer.ends_with(MAGIC) {
        return Err(damaged("it does not end as a manifest; it may be cut"));
    }
    let position = footer.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    let size = read(file.as_ref(), whole.part(position, 4)?)?;
    let size = size.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
    let message = read(file.as_ref(), whole.part(position + 4, size.into())?)?;
    parse(&message)
}

fn parse(message: &[u8]) -> Result<Manifest> {
    let mut manifest = Manifest::default();
    let mut stored = Vec::new();
    for field in fields(message) {
        let (number, value) = field?;
        match number {
            1 => stored.push(Stored::parse(value.bytes()?)?),
            2 => manifest.fragments.push(fragment(value.bytes()?)?),
            3 => manifest.version = value.number()?,
            5 | 19 => {
                let (key, text) = entry(value.bytes()?)?;
                manifest.metadata.insert(key, text);
            }
            9 => {
                let unknown = value.number()? & !KNOWN_FEATURES;
                if unknown != 0 {
                    return Err(unsupported(format!(
                        "the table needs features of readers that this one lacks (flags {unknown:#x})"
                    )));
                }
            }
            22 => return Err(unsupported("its fragments are in a tree of other files")),
            _ => {}
        }
    }
    manifest.columns = columns(&stored)?;
    let rows = manifest.fragments.iter().try_fold(0u64, |rows, fragment| rows.checked_add(fragment.rows));
    match rows.is_some_and(|rows| rows <= i64::MAX as u64) {
        true => Ok(manifest),
        false => Err(damaged("it claims more rows than can be counted")),
    }
}

/// An entry of a map.
fn entry(message: &[u8]) -> Result<(String, String)> {
    let (mut key, mut text) = (String::new(), String::new());
    for field in fields(message) {
        match field? {
            (1, value) => key = value.text()?,
            (2, value) => text = String::from_utf8_lossy(value.bytes()?).into_owned(),
            _ => {}
        }
    }
    Ok((key, text))
}

fn fragment(message: &[u8]) -> Result<Fragment> {
    let mut fragment = Fragment::default();
    for field in fields(message) {
        let (number, value) = field?;
        match number {
            1 => fragment.id = value.number()?,
            2 => fragment.files.push(file(value.bytes()?)?),
            3 => fragment.deletions = Some(DeletionFile::parse(value.bytes()?)?),
            4 => fragment.rows = value.number()?,
            11 => return Err(unsupported("values of it were overwritten (data overlay files)")),
            _ => {}
        }
    }
    let mut seen = BTreeSet::new();
    let is_twice = |field: &&i32| **field >= 0 && !seen.insert(**field);
    match fragment.files.iter().flat_map(|file| &file.fields).find(is_twice) {
        Some(field) => Err(damaged(format!("two files have its field {field}"))),
        None => Ok(fragment),
    }
}

fn file(message: &[u8]) -> Result<FileEntry> {
    let mut entry = FileEntry::default();
    let (mut all_fields, mut all_columns) = (Vec::new(), Vec::new());
    for field in fields(message) {
        let (number, value) = field?;
        match number {
            1 => {
                let name = value.text()?;
                if name.starts_with('/') || name.contains('\\') || name.split('/').any(|part| part == "..") {
                    return Err(damaged(format!("its file `{name}` is not in its folder")));
                }
                entry.path = format!("data/{name}");
            }
            2 => value.numbers(&mut all_fields)?,
            3 => value.numbers(&mut all_columns)?,
            6 => entry.size = value.number()?,
            7 => return Err(unsupported("some of its files are in other folders (base paths)")),
            _ => {}
        }
    }
    entry.fields = all_fields.into_iter().map(|field| field as i32).collect();
    entry.columns = all_columns.into_iter().map(|column| column as i32).collect();
    Ok(entry)
}

#[cfg(test)]
mod tests {
    use super::version;

    #[test]
    fn both_names_of_manifests_are_known() {
        assert_eq!(version("12.manifest"), Some(12));
        assert_eq!(version("18446744073709551614.manifest"), Some(1));
        for name in ["d18446744073709551614.manifest", "latest_version_hint.json", ".manifest", "1x.manifest"]
        {
            assert_eq!(version(name), None, "{name}");
        }
    }
}
