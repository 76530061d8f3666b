//! Foreign bytes in every reader of this crate.

use std::fs;

use crate::{FORMATS, mutate, open, seed};

#[test]
fn no_reader_of_ours_trips_over_foreign_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = folder.path().join("seed").with_extension(format.extensions[0]);
        seed(&path);
        mutate(format.name, &path);
    }
}

#[test]
fn no_reader_of_other_programs_folders_trips_over_foreign_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for format in FORMATS.iter().filter(|format| ["folder", "video"].contains(&format.name)) {
        let path = folder.path().join("seed").with_extension(format.extensions[0]);
        seed(&path);
        // Without what is ours, the folder is read as another program's.
        for ours in ["ep_len.json", "ep_len.index"] {
            fs::remove_file(path.join(ours)).unwrap();
        }
        if format.name == "video" {
            assert_eq!(open(&path).unwrap().info().format, "video");
        }
        mutate(&format!("foreign {}", format.name), &path);
    }
}
