//! Datasets: the crate `swm_data`, with functions that know every format and layout of this build in place of those that know its own.

use std::path::Path;
use std::sync::LazyLock;

use swm_core::Registry;
use swm_data::format::Opened;
pub use swm_data::*;

/// Every format and layout of this build.
fn built() -> &'static Registry {
    static BUILT: LazyLock<Registry> = LazyLock::new(crate::registry);
    &BUILT
}

/// Opens a dataset of any format of this build, or of another program, which its content tells. For formats and layouts of other
/// crates: [`open_in`].
///
/// # Errors
///
/// Nothing is there, it is of no known format, or it is damaged or from a newer version.
pub fn open(path: &Path) -> Opened<dyn Dataset> {
    open_in(built(), path)
}

/// Opens a dataset for recording in a format of this build. `format: None` goes by the file extension, or by the content where it has
/// none. For formats of other crates, and all options: [`create_in`].
///
/// # Errors
///
/// No format has this name or extension, something is there that `mode` does not allow for, another writer has it, or
/// the place cannot be written to.
pub fn create(path: &Path, mode: WriteMode, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_in(built(), path, &mode.into(), format)
}

/// As [`create`], with all options.
///
/// # Errors
///
/// As of [`create`].
pub fn create_with(path: &Path, options: &WriteOptions, format: Option<&str>) -> Opened<dyn DatasetWriter> {
    create_in(built(), path, options, format)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datasets_of_other_programs_and_formats_of_this_build_are_opened() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden");
        let dataset = open(&golden.join("field/pusht_cchi_v7_replay.zarr")).unwrap();
        assert!(dataset.schema().index("action").is_some());
        match open(&golden.join("datasets/lerobot_v3.0")) {
            Ok(dataset) => assert_eq!(dataset.info().format, "lerobot"),
            Err(error) => {
                assert!(!cfg!(feature = "lerobot") && error.to_string().contains("lerobot"), "{error}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        for format in built().all::<Format>() {
            let path = folder.path().join("a").with_extension(format.extensions[0]);
            assert!(create(&path, WriteMode::Error, None).is_ok(), "{}", format.name);
        }
    }
}
