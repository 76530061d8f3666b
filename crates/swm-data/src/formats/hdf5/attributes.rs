//! What a recording says of itself, in attributes of the file's root: columns with their kinds, and metadata of the
//! runs that were recorded into it. Files of the reference have none.

use hdf5_metno::File;
use hdf5_metno::types::VarLenUnicode;
use swm_core::{Field, Metadata};

use super::layout::{COLUMNS_ATTRIBUTE, METADATA_ATTRIBUTE};

/// What the attributes of a file say.
#[derive(Clone, Debug, Default)]
pub(super) struct Attributes {
    /// The columns that the writer was given, in order; `None` in files of other programs.
    pub(super) columns: Option<Vec<Field>>,
    /// Metadata of each run, with the first episode that it recorded; in that order.
    pub(super) runs: Vec<(u64, Metadata)>,
}

impl Attributes {
    /// Reads them; `Err` if ours are there but not readable.
    pub(super) fn read(file: &File) -> Result<Self, String> {
        let mut found = Self::default();
        for name in file.attr_names().map_err(|error| error.to_string())? {
            if name == COLUMNS_ATTRIBUTE {
                found.columns = Some(read_json(file, &name)?);
            } else if let Some(rest) = name.strip_prefix(METADATA_ATTRIBUTE) {
                let first = match rest.strip_prefix('_') {
                    None if rest.is_empty() => 0,
                    Some(number) if number.parse::<u64>().is_ok() => number.parse().unwrap_or_default(),
                    _ => continue,
                };
                found.runs.push((first, read_json(file, &name)?));
            }
        }
        found.runs.sort_by_key(|&(first, _)| first);
        Ok(found)
    }
}

/// Writes the columns and the first run's metadata into a new file.
pub(super) fn write(file: &File, columns: &[Field], metadata: &Metadata) -> Result<(), String> {
    write_json(file, COLUMNS_ATTRIBUTE, columns)?;
    write_json(file, METADATA_ATTRIBUTE, metadata)
}

/// Makes `metadata` the record of the run that continues the file at episode `first`. What a run that was killed
/// before its first episode has left there is replaced.
pub(super) fn set_run(
    file: &File,
    known: &[(u64, Metadata)],
    first: u64,
    metadata: &Metadata,
) -> Result<(), String> {
    let name = match first {
        0 => METADATA_ATTRIBUTE.to_owned(),
        first => format!("{METADATA_ATTRIBUTE}_{first}"),
    };
    let stale = known.iter().find(|&&(at, _)| at == first);
    let before = known.iter().rfind(|&&(at, _)| at < first);
    let wanted = before.is_none_or(|(_, earlier)| earlier != metadata);
    if wanted && stale.is_some_and(|(_, there)| there == metadata) {
        return Ok(());
    }
    if stale.is_some() {
        file.delete_attr(&name).map_err(|error| error.to_string())?;
    }
    if wanted { write_json(file, &name, metadata) } else { Ok(()) }
}

fn read_json<T: serde::de::DeserializeOwned>(file: &File, name: &str) -> Result<T, String> {
    let text: VarLenUnicode = file
        .attr(name)
        .and_then(|attribute| attribute.read_scalar())
        .map_err(|e| format!("attribute `{name}`: {e}"))?;
    serde_json::from_slice(text.as_bytes()).map_err(|error| format!("attribute `{name}`: {error}"))
}

fn write_json(file: &File, name: &str, value: &(impl serde::Serialize + ?Sized)) -> Result<(), String> {
    let text = serde_json::to_string(value).map_err(|error| error.to_string())?;
    let text: VarLenUnicode = text.parse().map_err(|_| "metadata contains the character NUL".to_owned())?;
    let attribute = file.new_attr::<VarLenUnicode>().create(name);
    attribute.and_then(|attribute| attribute.write_scalar(&text)).map_err(|error| error.to_string())
}
