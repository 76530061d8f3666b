//! The table of dataset formats: how a file is recognized, opened and created. A new format is one folder below
//! `formats/` that exports one [`Format`], and one line in [`FORMATS`]. A format of another crate is registered by
//! whoever wants it, with one line in its program:
//!
//! ```text
//! swm_data::format::register(&my_crate::FORMAT)?;
//! ```

use std::fs;
use std::path::Path;
use std::sync::{PoisonError, RwLock};

use swm_core::error::nearest;

use crate::dataset::{Dataset, DatasetWriter, WriteMode, WriteOptions};
use crate::error::DataError;
use crate::formats;

/// Every format that this crate knows.
pub const FORMATS: &[Format] = &[
    formats::hdf5::FORMAT,
    formats::folder::FOLDER,
    #[cfg(feature = "video")]
    formats::folder::VIDEO,
    formats::mcap::FORMAT,
    #[cfg(feature = "lerobot")]
    formats::lerobot::FORMAT,
];

/// What opening gives: a reader or a writer of whatever format.
pub type Opened<T> = Result<Box<T>, DataError>;

/// One way of storing a dataset.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// Its name, as on the command line.
    pub name: &'static str,
    /// File extensions without the dot, the preferred one first.
    pub extensions: &'static [&'static str],
    /// One line on what it is good for.
    pub about: &'static str,
    /// Whether the content of an existing file or folder is of this format.
    pub detect: fn(&Path) -> bool,
    /// Opens for reading.
    pub open: fn(&Path) -> Opened<dyn Dataset>,
    /// Opens for recording. Takes the file for itself until the writer is dropped; changes nothing before `begin`.
    pub create: fn(&Path, &WriteOptions) -> Opened<dyn DatasetWriter>,
    /// Says what has to be done about a dataset whose recording was interrupted, one line each, and does it if told to.
    pub repair: fn(&Path, bool) -> Result<Vec<String>, DataError>,
}

/// Formats of other crates.
static REGISTERED: RwLock<Vec<&'static Format>> = RwLock::new(Vec::new());

/// Makes a format of another crate known to this process: from then on it is opened, created, converted and verified
/// like those of this crate. Registering it again changes nothing.
///
/// # Errors
///
/// Another format has its name or one of its file extensions.
pub fn register(format: &'static Format) -> Result<(), DataError> {
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    if registered.iter().any(|known| std::ptr::eq(*known, format)) {
        return Ok(());
    }
    let names = |format: &Format| format.extensions.iter().copied().chain([format.name]).collect::<Vec<_>>();
    let mut all = FORMATS.iter().chain(registered.iter().copied());
    if let Some(known) = all.find(|known| names(known).iter().any(|name| names(format).contains(name))) {
        return Err(DataError::FormatTaken { name: format.name, known: known.name });
    }
    registered.push(format);
    Ok(())
}

/// Every known format: those of this crate, then those that were registered.
pub fn all() -> impl Iterator<Item = &'static Format> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner).clone();
    FORMATS.iter().chain(registered)
}

/// The format called `name`; names and file extensions both count.
///
/// # Errors
///
/// [`DataError::UnknownFormat`], with the nearest name and all that there are.
pub fn by_name(name: &str) -> Result<&'static Format, DataError> {
    let called = |format: &&Format| format.name == name || format.extensions.contains(&name);
    all().find(called).ok_or_else(|| {
        let names = all().flat_map(|format| format.extensions.iter().copied().chain([format.name]));
        let (name, nearest) = (name.to_owned(), nearest(name, names));
        DataError::UnknownFormat { hint: built_without(&name), name, nearest, known: known() }
    })
}

/// Opens a dataset of any format, which its content tells.
///
/// # Errors
///
/// Nothing is there, it is of no known format, or it is damaged or from a newer version.
pub fn open(path: &Path) -> Opened<dyn Dataset> {
    let metadata = fs::metadata(path).map_err(|source| DataError::io(path, "open", source))?;
    if metadata.is_file() && metadata.len() == 0 {
        return Err(DataError::not_a_dataset(path, "the file is empty"));
    }
    match detect(path) {
        Some(format) => (format.open)(path),
        None if path.join("_versions").is_dir() => {
            let reason = "it is a Lance table; this program was built without the feature `lance`";
            Err(DataError::not_a_dataset(path, reason))
        }
        None => {
            Err(DataError::not_a_dataset(path, format!("its content is of no known format ({})", known())))
        }
    }
}

/// The format of an existing dataset, by its content.
pub fn detect(path: &Path) -> Option<&'static Format> {
    all().find(|format| (format.detect)(path))
}

/// Opens a dataset for recording. `format: None` goes by the file extension, or by the content where it has none.
///
/// # Errors
///
/// No format has this name or extension, something is there that `mode` does not allow for, another writer has it, or
/// the place cannot be written to.
pub fn create(path: &Path, mode: WriteMode, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_with(path, &mode.into(), format)
}

/// As [`create`], with all options.
///
/// # Errors
///
/// As of [`create`].
pub fn create_with(path: &Path, options: &WriteOptions, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let format = match (by_name(format.unwrap_or(extension)), detect(path)) {
        (Err(_), Some(there)) if format.is_none() => there,
        (named, _) => named?,
    };
    (format.create)(path, options)
}

/// `hdf5 (.h5, .hdf5)`, …
fn known() -> String {
    let one = |format: &Format| {
        let extensions: Vec<_> = format.extensions.iter().map(|extension| format!(".{extension}")).collect();
        format!("{} ({})", format.name, extensions.join(", "))
    };
    all().map(one).collect::<Vec<_>>().join(", ")
}

/// Formats that not every build has, and the feature that brings them.
const OPTIONAL: [(&str, &str); 4] =
    [("lance", "lance"), ("lance-video", "lance"), ("lerobot", "lerobot"), ("video", "mp4")];

/// What is said of a format that exists, to whom it is unknown.
fn built_without(name: &str) -> String {
    let feature = OPTIONAL.iter().find(|(known, _)| *known == name).map(|(_, feature)| feature);
    feature
        .map(|feature| {
            format!("; this program was built without `{name}`, which the feature `{feature}` brings")
        })
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_found_by_name_and_by_extension() {
        for format in FORMATS {
            assert_eq!(by_name(format.name).unwrap().name, format.name);
            for extension in format.extensions {
                assert_eq!(by_name(extension).unwrap().name, format.name);
            }
        }
    }

    #[test]
    fn formats_of_other_crates_are_registered_once_and_under_names_of_their_own() {
        const MORE: Format = Format { name: "more", extensions: &["more"], detect: |_| false, ..FORMATS[0] };
        static OTHER: Format = MORE;
        static SAME: Format = Format { name: "else", ..MORE };
        register(&OTHER).unwrap();
        register(&OTHER).unwrap();
        assert_eq!(by_name("more").unwrap().name, "more");
        assert_eq!(all().filter(|format| format.name == "more").count(), 1);
        let message = register(&SAME).unwrap_err().to_string();
        assert!(message.contains("`else`") && message.contains("`more`"), "{message}");
        assert!(register(&FORMATS[0]).is_err());
    }

    #[test]
    fn an_unknown_format_names_the_nearest() {
        let message = by_name("hdf").unwrap_err().to_string();
        assert!(message.contains("`hdf`") && message.contains("did you mean `hdf5`"), "{message}");
        let message = by_name("lance").unwrap_err().to_string();
        assert!(message.contains("the feature `lance`"), "{message}");
        let message = create(Path::new("data.xyz"), WriteMode::Append, None).err().unwrap().to_string();
        assert!(message.contains("`xyz`") && message.contains("hdf5 (.h5, .hdf5)"), "{message}");
    }
}
