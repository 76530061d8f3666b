//! The table of dataset formats: how a file is recognized, opened and created. A new format is one folder below
//! `formats/` that exports one [`Format`], and one line in [`FORMATS`]. Formats of other crates stand in a [`Registry`]
//! beside them:
//!
//! ```text
//! let registry = swm::registry().with(&[my_crate::FORMAT]);
//! let dataset = swm_data::open_in(&registry, path)?;
//! ```

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use swm_core::Registry;
use swm_core::registry::Absent;
use swm_files::remote;

use crate::adapt::Resized;
use crate::dataset::{Dataset, DatasetWriter, WriteMode, WriteOptions, row_bytes};
use crate::error::DataError;
use crate::foreign;
use crate::formats;
use crate::open_options::OpenOptions;
use crate::tools::part_folder;

pub use crate::entry::{Create, Detect, Format, Layout, Open, OpenWith, Opened, Repair, StoredImages};

/// Every format of this crate.
pub const FORMATS: &[Format] = &[
    formats::hdf5::FORMAT,
    formats::folder::FOLDER,
    #[cfg(feature = "video")]
    formats::folder::VIDEO,
    formats::mcap::FORMAT,
];

/// What a crate that depends on this one does for the formats that its build lacks.
const ABSENT: &[Absent] = &[
    Absent::of::<Format>(
        "lance",
        "lance",
        "add the crate `swm-data-lance`, and its formats to the registry that reads",
    ),
    Absent::of::<Format>(
        "lerobot",
        "lerobot",
        "add the crate `swm-data-lerobot`, and its formats to the registry that reads",
    ),
    Absent::of::<Format>("video", "video", "add `video` to the features of `swm-data` in Cargo.toml"),
];

/// The formats of this crate, as a registry.
pub fn built_in() -> &'static Registry {
    static BUILT_IN: LazyLock<Registry> = LazyLock::new(|| Registry::new().with(FORMATS).with(ABSENT));
    &BUILT_IN
}

/// The format called `name`; names and file extensions both count.
///
/// # Errors
///
/// [`DataError::UnknownFormat`], with the nearest name and all that there are.
pub fn by_name(registry: &Registry, name: &str) -> Result<&'static Format, DataError> {
    registry.find::<Format>(name).map_err(|unknown| DataError::UnknownFormat {
        hint: unknown.fix.map(|fix| format!("; {fix}")).unwrap_or_default(),
        name: unknown.name,
        nearest: unknown.nearest,
        known: known(registry),
    })
}

/// Opens a dataset of any format of this crate, which its content tells. For formats of other crates: [`open_in`].
///
/// # Errors
///
/// Nothing is there, it is of no known format, or it is damaged or from a newer version.
pub fn open(path: &Path) -> Opened<dyn Dataset> {
    open_in(built_in(), path)
}

/// Opens a dataset of any format of a registry, which its content tells, or a folder of the parts of one recording.
///
/// # Errors
///
/// As of [`open`].
pub fn open_in(registry: &Registry, path: &Path) -> Opened<dyn Dataset> {
    open_with(registry, path, &OpenOptions::default())
}

/// As [`open_in`], with options: what the files of another program do not hold, or hold in several forms.
///
/// # Errors
///
/// As of [`open`]; [`DataError::Option`]: an option is wrong, or would not act.
pub fn open_with(registry: &Registry, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
    options.check()?;
    let Some(size) = options.image_size else { return open_stored(registry, path, options) };
    let stored = open_stored(registry, path, &options.of_stored())?;
    Ok(Box::new(Resized::new(stored, size, options.fit)?.opened_with(options)))
}

/// As [`open_with`], with images as they are stored.
fn open_stored(registry: &Registry, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
    if remote::is_remote(path) {
        #[cfg(feature = "remote")]
        return crate::elsewhere::open(registry, path, options);
        #[cfg(not(feature = "remote"))]
        return Err(remote::not_built_in(path));
    }
    let metadata = fs::metadata(path).map_err(|source| DataError::io(path, "open", source))?;
    if !metadata.is_file() && !metadata.is_dir() {
        return Err(DataError::not_a_dataset(path, "it is neither a regular file nor a folder"));
    }
    // A file that may not be read is of no format.
    let opened =
        if metadata.is_dir() { fs::read_dir(path).map(drop) } else { fs::File::open(path).map(drop) };
    opened.map_err(|source| DataError::io(path, "open", source))?;
    if metadata.is_file() && metadata.len() == 0 {
        return Err(DataError::not_a_dataset(path, "the file is empty"));
    }
    match detect(registry, path) {
        Some(format) => {
            let dataset = match format.open_with(path, options) {
                // An HDF5 file without our index may have the layout of another program.
                Err(error @ DataError::NotADataset { .. }) => {
                    let other = open_layout(registry, path, options);
                    other.unwrap_or_else(|| Err(foreign::unread(registry, path).unwrap_or(error)))?
                }
                opened => opened?,
            };
            check_rows(dataset.as_ref())?;
            Ok(dataset)
        }
        None if let Some(opened) = open_layout(registry, path, options) => {
            let dataset = opened?;
            check_rows(dataset.as_ref())?;
            Ok(dataset)
        }
        None if let Some(error) = foreign::unread(registry, path) => Err(error),
        None if path.join("meta/info.json").is_file() => {
            Err(unread(registry, path, "lerobot", "it is a LeRobot dataset"))
        }
        None if let Some(reason) = foreign::recognize(path) => Err(DataError::not_a_dataset(path, reason)),
        None if let Some(parts) = part_folder::open(registry, path)? => Ok(parts),
        None => {
            let named = path.extension().and_then(|extension| extension.to_str());
            let named = named.and_then(|extension| by_name(registry, extension).ok());
            let is_file = path.is_file();
            let reason = match (named, other_content(path)) {
                (_, Some(what)) if is_file => what.to_owned(),
                (Some(format), _) if format.name == "lerobot" && !is_file => {
                    "its name is that of a LeRobot dataset, but meta/info.json is missing, which describes every such dataset; copy \
                     the folder again, with its subfolders"
                        .to_owned()
                }
                (Some(format), _) => format!(
                    "its name is that of the format {}, but its content is not, nor of another known one ({}); it may be cut short \
                     or another file",
                    format.name,
                    known(registry)
                ),
                (None, _) => format!("its content is of no known format ({})", known(registry)),
            };
            Err(DataError::not_a_dataset(path, reason))
        }
    }
}

/// Opens a dataset of another program; `None` if it is of no layout of the registry.
pub(crate) fn open_layout(
    registry: &Registry,
    path: &Path,
    options: &OpenOptions,
) -> Option<Opened<dyn Dataset>> {
    let layout = registry.all::<Layout>().find(|layout| layout.detect(path))?;
    Some(layout.open(path, options))
}

/// What comes in place of a dataset when it is downloaded, by its first bytes.
fn other_content(path: &Path) -> Option<&'static str> {
    use std::io::Read as _;

    let mut start = Vec::new();
    fs::File::open(path).ok()?.take(64).read_to_end(&mut start).ok()?;
    let start = start.trim_ascii_start().to_ascii_lowercase();
    if start.starts_with(b"version https://git-lfs") {
        return Some("it is a pointer of Git LFS and not the file itself, which `git lfs pull` fetches");
    }
    let is_page = start.starts_with(b"<!doctype html") || start.starts_with(b"<html");
    is_page.then_some("it is a web page, as a download gives in place of a file that it did not find")
}

/// Rows above this size are compared with the size of their dataset…
const LARGE_ROW: usize = 64 << 20;
/// …of which no compression of images makes more than so many times its bytes: PNG and gzip 1,032, JPEG 1,365.
const MAX_RATIO: u64 = 2048;

/// Refuses a dataset that claims larger rows than its bytes can hold: a head of a few bytes can claim an image of 800 MB.
fn check_rows(dataset: &dyn Dataset) -> Result<(), DataError> {
    check_rows_of(dataset, || {
        swm_files::size(dataset.path()).map_err(|source| DataError::io(dataset.path(), "open", source))
    })
}

/// As [`check_rows`], where the bytes that it has are asked for.
pub(crate) fn check_rows_of(
    dataset: &dyn Dataset,
    held: impl FnOnce() -> Result<u64, DataError>,
) -> Result<(), DataError> {
    let fields = dataset.schema().fields();
    let Some(largest) = fields.iter().max_by_key(|field| row_bytes(std::slice::from_ref(field))) else {
        return Ok(());
    };
    let claimed = row_bytes(std::slice::from_ref(largest));
    if claimed <= LARGE_ROW || (0..dataset.num_episodes()).all(|episode| dataset.episode_len(episode) == 0) {
        return Ok(());
    }
    let (path, held) = (dataset.path(), held()?);
    match claimed as u64 / MAX_RATIO > held {
        true => Err(DataError::damaged(
            path,
            format!(
                "a row of column `{}` claims {} MB ({} {:?}), more than {held} bytes can hold",
                largest.name,
                claimed / 1_000_000,
                largest.dtype,
                largest.shape
            ),
        )),
        false => Ok(()),
    }
}

/// The format of an existing dataset, by its content.
pub fn detect(registry: &Registry, path: &Path) -> Option<&'static Format> {
    // A pipe would wait for its writer.
    let there = fs::metadata(path).is_ok_and(|there| there.is_file() || there.is_dir());
    registry.all::<Format>().find(|format| there && format.detect(path))
}

/// Whether there is a dataset of another program, in no format of ours, that [`open_with`] reads by a layout of the registry.
pub fn is_of_other_program(registry: &Registry, path: &Path) -> bool {
    let there = fs::metadata(path).is_ok_and(|there| there.is_file() || there.is_dir());
    there && registry.all::<Layout>().any(|layout| layout.detect(path))
}

/// Opens a dataset for recording in a format of this crate. `format: None` goes by the file extension, or by the content
/// where it has none. For formats of other crates, and all options: [`create_in`].
///
/// # Errors
///
/// No format has this name or extension, something is there that `mode` does not allow for, another writer has it, or
/// the place cannot be written to.
pub fn create(path: &Path, mode: WriteMode, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_in(built_in(), path, &mode.into(), format)
}

/// As [`create`], with all options.
///
/// # Errors
///
/// As of [`create`].
pub fn create_with(path: &Path, options: &WriteOptions, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_in(built_in(), path, options, format)
}

/// As [`create_with`], in any format of a registry.
///
/// # Errors
///
/// As of [`create`].
pub fn create_in(
    registry: &Registry,
    path: &Path,
    options: &WriteOptions,
    format: Option<&str>,
) -> Opened<dyn DatasetWriter> {
    if remote::is_remote(path) {
        let reason =
            "datasets that lie elsewhere are read, not written; write to a file here, and copy it there";
        return Err(DataError::request(path, reason));
    }
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let format = match (by_name(registry, format.unwrap_or(extension)), detect(registry, path)) {
        (Err(_), Some(there)) if format.is_none() => there,
        (named, _) => named?,
    };
    format.create(path, options)
}

/// `hdf5 (.h5, .hdf5)`, …
fn known(registry: &Registry) -> String {
    let one = |format: &Format| {
        let extensions: Vec<_> = format.extensions.iter().map(|extension| format!(".{extension}")).collect();
        format!("{} ({})", format.name, extensions.join(", "))
    };
    registry.all::<Format>().map(one).collect::<Vec<_>>().join(", ")
}

/// What is at `path` is of a format that the registry lacks.
fn unread(registry: &Registry, path: &Path, format: &str, what: &str) -> DataError {
    let fix = registry.find::<Format>(format).err().and_then(|unknown| unknown.fix);
    let fix = fix.unwrap_or_else(|| "no format of this registry reads it".to_owned());
    DataError::not_a_dataset(path, format!("{what}; {fix}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_found_by_name_and_by_extension() {
        for format in FORMATS {
            assert_eq!(by_name(built_in(), format.name).unwrap().name, format.name);
            for extension in format.extensions {
                assert_eq!(by_name(built_in(), extension).unwrap().name, format.name);
            }
        }
    }

    #[test]
    fn formats_of_other_crates_stand_in_the_registry() {
        const MORE: &[Format] =
            &[Format::new("more", "for this test", |_| true, |path| Err(DataError::request(path, "opened")))
                .extensions(&["more", "mr"])];
        let registry = Registry::new().with(MORE).with(FORMATS);
        assert_eq!(by_name(&registry, "mr").unwrap().name, "more");
        assert!(by_name(built_in(), "mr").is_err());
        let folder = tempfile::tempdir().unwrap();
        assert!(open_in(&registry, folder.path()).err().unwrap().to_string().contains("opened"));
        let message = create_in(&registry, Path::new("a.mr"), &WriteMode::Error.into(), None).err().unwrap();
        assert!(message.to_string().contains("read, not written"), "{message}");
    }

    #[test]
    #[should_panic(expected = "`else`: `hdf5` has its name already")]
    fn file_extensions_are_names() {
        const SAME: &[Format] =
            &[Format::new("else", "", |_| false, |path| Err(DataError::request(path, "")))
                .extensions(&["h5"])];
        let _ = Registry::new().with(FORMATS).with(SAME);
    }

    #[test]
    fn options_that_would_not_act_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let message = |file: &str, options: &WriteOptions| {
            create_with(&folder.path().join(file), options, None).err().map(|error| error.to_string())
        };
        let (quality, period) =
            (WriteOptions::default().quality(Some(50)), WriteOptions::default().key_frame_period(Some(5)));
        for file in ["a.h5", "a.mcap"] {
            assert!(message(file, &quality).unwrap().contains("`quality`: the format `"), "{file}");
            assert!(message(file, &period).unwrap().contains("has no videos"), "{file}");
        }
        assert_eq!(message("a.folder", &quality), None);
        assert!(message("a.folder", &period).is_some());
        #[cfg(feature = "video")]
        assert_eq!((message("a.video", &quality), message("b.video", &period)), (None, None));
        assert!(!folder.path().join("a.h5").exists(), "nothing is left behind");
    }

    #[test]
    fn an_unknown_format_names_the_nearest() {
        let message = |name| by_name(built_in(), name).unwrap_err().to_string();
        assert!(message("hdf").contains("`hdf`") && message("hdf").contains("did you mean `hdf5`"));
        assert!(message("lance").contains("the crate `swm-data-lance`"), "{}", message("lance"));
        let message = create(Path::new("data.xyz"), WriteMode::Append, None).err().unwrap().to_string();
        assert!(message.contains("`xyz`") && message.contains("hdf5 (.h5, .hdf5)"), "{message}");
    }
}
