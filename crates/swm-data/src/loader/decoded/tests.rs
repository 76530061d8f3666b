//! Where files of decoded images are put.

use super::*;

#[test]
fn folders_are_beside_the_dataset_else_among_caches() {
    let options = CacheOptions::default();
    let caches = || Some(PathBuf::from("/caches"));
    let [near, far] = &folders(Path::new("/data/a.mp4"), &options, caches())[..] else { panic!() };
    assert_eq!(near, Path::new("/data/a.mp4.decoded"));
    assert!(far.to_string_lossy().starts_with("/caches/decoded/a.mp4-"), "{far:?}");
    let [only] = &folders(Path::new("https://host/a.npz"), &options, caches())[..] else { panic!() };
    assert!(only.starts_with("/caches/decoded"));
    assert_eq!(
        folders(Path::new("/data/a.mp4"), &options.folder(Some("/x".into())), None),
        [Path::new("/x")]
    );
}

#[test]
fn a_folder_that_cannot_be_written_to_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    crate::testing::record(&path, crate::WriteMode::Append, 0..2).unwrap();
    let dataset = crate::open(&path).unwrap();
    let plan = Plan::new(dataset.as_ref(), &crate::ClipOptions::default()).unwrap();
    let origin = dataset.origin().unwrap();
    let state = state::state(dataset.info(), &origin).unwrap();
    let target = &targets(dataset.as_ref(), &plan, &origin, &state)[0];
    // A file where the folder would be made: also an administrator cannot write there.
    let (closed, far) = (beside(&path, ".decoded"), folder.path().join("far"));
    fs::write(&closed, "").unwrap();
    let folders = [closed.clone(), far.clone()];
    let (kept, seconds) = make(dataset.as_ref(), target, &folders, &origin, &state, 2).unwrap();
    assert!(kept.path.starts_with(&far) && seconds.is_some(), "{:?}", kept.path);
    let refused = make(dataset.as_ref(), target, &folders[..1], &origin, &state, 2).err().unwrap();
    assert!(refused.to_string().contains("data.h5.decoded"), "{refused}");
}
