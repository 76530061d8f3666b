//! Paths that the program chooses. They hold for the whole process, so one test asks for them in order.

use swm_mujoco::{Library, MujocoError, assets};

#[test]
fn a_program_chooses_library_folder_and_fix() {
    let installed = assets::library_path().expect("it was set up");
    let folder = tempfile::tempdir().unwrap();
    assets::set_folder(folder.path());
    assets::set_fix("reinstall the package `example`");
    assert_eq!(assets::data_folder().as_deref(), Some(folder.path()));
    let missing = assets::suite_model("cheetah.xml").unwrap_err().to_string();
    let path = folder.path().join("dm_control");
    assert!(missing.contains(path.to_str().unwrap()), "{missing}");
    assert!(missing.ends_with("; reinstall the package `example`"), "{missing}");

    // A failure is not final: the next choice is tried.
    assets::set_library(folder.path().join("libmujoco.so")).unwrap();
    let missing = Library::get().err().expect("the folder is empty").to_string();
    assert!(missing.contains("libmujoco.so (no such file); reinstall"), "{missing}");
    assets::set_library(&installed).unwrap();
    assert_eq!(Library::get().unwrap().version(), assets::MUJOCO_VERSION);
    assets::set_library(&installed).unwrap();
    let refused = assets::set_library("another.so").unwrap_err();
    assert!(matches!(&refused, MujocoError::Loaded { path } if *path == installed), "{refused}");
}
