//! The description of a recording, in attributes of the file's root: columns with their kinds, and metadata of the
//! runs that were recorded into it. Files of the reference have none.

use std::fs;

use hdf5_metno::types::{FixedAscii, FixedUnicode, TypeDescriptor, VarLenUnicode};
use hdf5_metno::{Attribute, File};
use swm_core::{Field, Metadata};

use super::handles::library_error;
use super::heap::{self, Heap};
use super::layout::{COLUMNS_ATTRIBUTE, METADATA_ATTRIBUTE};
use super::{ffi, library};
use crate::error::{At as _, Result, invalid, unsupported};
use crate::formats::element;

/// Bytes of the longest text of fixed length.
const MAX_FIXED: usize = 4096;

/// The attributes of a file that describe its recording.
#[derive(Clone, Debug, Default)]
pub(super) struct Attributes {
    /// The columns that the writer was given, in order; `None` in files of other programs.
    pub(super) columns: Option<Vec<Field>>,
    /// Metadata of each run, with the first episode that it recorded; in that order.
    pub(super) runs: Vec<(u64, Metadata)>,
}

impl Attributes {
    /// Reads them; `Err` if ours are there but not readable. `bytes` is the same file.
    pub(super) fn read(file: &File, bytes: &fs::File) -> Result<Self> {
        let mut found = Self::default();
        for name in file.attr_names().map_err(library_error)? {
            if name == COLUMNS_ATTRIBUTE {
                found.columns = Some(read_json(file, bytes, &name)?);
            } else if let Some(rest) = name.strip_prefix(METADATA_ATTRIBUTE) {
                let first = match rest.strip_prefix('_') {
                    None if rest.is_empty() => 0,
                    Some(number) if number.parse::<u64>().is_ok() => number.parse().unwrap_or_default(),
                    _ => continue,
                };
                found.runs.push((first, read_json(file, bytes, &name)?));
            }
        }
        found.runs.sort_by_key(|&(first, _)| first);
        Ok(found)
    }
}

/// Writes the columns and the first run's metadata into a new file.
pub(super) fn write(file: &File, columns: &[Field], metadata: &Metadata) -> Result<()> {
    write_json(file, COLUMNS_ATTRIBUTE, columns)?;
    write_json(file, METADATA_ATTRIBUTE, metadata)
}

/// What has to change in the attributes so that `metadata` is the record of the run that goes on at an episode.
#[derive(Debug)]
pub(super) struct RunChange<'a> {
    name: String,
    /// A run that was killed before its first episode left an attribute of this name.
    replaces: bool,
    metadata: Option<&'a Metadata>,
}

impl<'a> RunChange<'a> {
    /// `None` if the run goes on as the one before it, and the file says so already.
    pub(super) fn plan(known: &[(u64, Metadata)], first: u64, metadata: &'a Metadata) -> Option<Self> {
        let stale = known.iter().find(|&&(at, _)| at == first);
        let before = known.iter().rfind(|&&(at, _)| at < first);
        let wanted = before.is_none_or(|(_, earlier)| earlier != metadata);
        let right = match stale {
            Some((_, there)) => wanted && there == metadata,
            None => !wanted,
        };
        let name = match first {
            0 => METADATA_ATTRIBUTE.to_owned(),
            first => format!("{METADATA_ATTRIBUTE}_{first}"),
        };
        (!right).then_some(Self { name, replaces: stale.is_some(), metadata: wanted.then_some(metadata) })
    }

    /// Makes the change.
    pub(super) fn apply(&self, file: &File) -> Result<()> {
        if self.replaces {
            file.delete_attr(&self.name).map_err(library_error)?;
        }
        self.metadata.map_or(Ok(()), |metadata| write_json(file, &self.name, metadata))
    }
}

fn read_json<T: serde::de::DeserializeOwned>(file: &File, bytes: &fs::File, name: &str) -> Result<T> {
    let place = format_args!("attribute `{name}`");
    let attribute = file.attr(name).map_err(library_error).at(place)?;
    let text = text(&attribute, bytes).at(place)?.ok_or(invalid("it is no text")).at(place)?;
    serde_json::from_slice(text.as_bytes()).at(place)
}

/// The text of an attribute of the file `bytes`; `None` if it is none. Text of any length is read by its reference, with bounds, and not by the
/// library.
pub(super) fn text(attribute: &Attribute, bytes: &fs::File) -> Result<Option<String>> {
    let kind = attribute.dtype().and_then(|dtype| dtype.to_descriptor()).map_err(library_error)?;
    let fixed = match kind {
        TypeDescriptor::VarLenUnicode | TypeDescriptor::VarLenAscii => {
            if !heap::is_common(attribute).map_err(library_error)? {
                return Err(unsupported(library::UNCOMMON));
            }
            let reference = ffi::reference(attribute).map_err(library_error)?;
            return element::text(Heap::default().get(bytes, &reference)?).map(Some);
        }
        TypeDescriptor::FixedAscii(size) if size <= MAX_FIXED => {
            attribute.read_scalar::<FixedAscii<MAX_FIXED>>().map(|text| text.to_string())
        }
        TypeDescriptor::FixedUnicode(size) if size <= MAX_FIXED => {
            attribute.read_scalar::<FixedUnicode<MAX_FIXED>>().map(|text| text.to_string())
        }
        _ => return Ok(None),
    };
    fixed.map(Some).map_err(library_error)
}

fn write_json(file: &File, name: &str, value: &(impl serde::Serialize + ?Sized)) -> Result<()> {
    let text = serde_json::to_string(value)?;
    let text: VarLenUnicode = text.parse().map_err(|_| invalid("metadata contains the character NUL"))?;
    let attribute = file.new_attr::<VarLenUnicode>().create(name);
    attribute.and_then(|attribute| attribute.write_scalar(&text)).map_err(library_error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_recorded_when_it_differs_from_the_one_before() {
        let run = |policy: &str| Metadata { policy: policy.to_owned(), ..Metadata::default() };
        let known = [(0, run("a")), (5, run("b"))];
        let plan = |first, policy| {
            let metadata = run(policy);
            let change = RunChange::plan(&known, first, &metadata)?;
            Some((change.name, change.replaces, change.metadata.is_some()))
        };
        assert_eq!(plan(9, "b"), None);
        assert_eq!(plan(9, "a"), Some(("swm_metadata_9".to_owned(), false, true)));
        // The run at episode 5 was killed before it wrote anything.
        assert_eq!(plan(5, "b"), None);
        assert_eq!(plan(5, "a"), Some(("swm_metadata_5".to_owned(), true, false)));
        assert_eq!(plan(5, "c"), Some(("swm_metadata_5".to_owned(), true, true)));
        assert_eq!(plan(0, "c"), Some(("swm_metadata".to_owned(), true, true)));
    }
}
