//! Fetching to a place of one's own, and copies in the cache.

use std::path::Path;
use std::sync::atomic::Ordering;

use super::super::fetch::fetch_from;
use super::super::testing::Fault;
use super::*;

#[test]
fn fetching_continues_and_refuses_what_is_there() {
    let whole = bytes((2 << 20) + 9);
    let test = Test::http(&[("/a/x.h5", whole.clone())]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("mine.h5");
    let path = test.at("/a/x.h5?token=SECRET");
    let fetch = || fetch_from(&test.remote, &path, Some(&out));
    // The first block, and half of the rest; then nothing more.
    test.server.fail(&[Fault::Slow, Fault::Cut]);
    drop(test.server.state.faults.lock().unwrap().splice(0..0, vec![Fault::Status(503); 4]));
    let message = fetch().unwrap_err();
    assert!(message.to_string().contains("503") && !format!("{message:?}").contains("SECRET"), "{message:?}");
    assert!(!out.exists());
    let parts = std::fs::read_dir(folder.path()).unwrap().flatten();
    let part = parts
        .map(|entry| entry.path())
        .find(|path| path.extension().is_some_and(|end| end == "part"))
        .unwrap();
    assert!(std::fs::metadata(&part).unwrap().len() > 1 << 20, "what was fetched is kept");
    test.server.state.asked.lock().unwrap().clear();
    let fetched = fetch().unwrap();
    assert_eq!((fetched.bytes, fetched.files, std::fs::read(&out).unwrap()), (whole.len() as u64, 1, whole));
    let asked = test.server.state.asked.lock().unwrap().clone();
    assert!(asked.len() == 2 && !asked[1].1.as_ref().unwrap().starts_with("bytes=0-"), "{asked:?}");
    assert!(!part.exists());
    let message = fetch().unwrap_err();
    assert!(message.to_string().contains("exists already"), "{message}");
}

#[test]
fn whole_folders_are_fetched_and_checked() {
    let test = of_hub(&[], None);
    put_all(&test.server, "dinowm_pusht_noise", "/noise");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("noise");
    let fetched = fetch_from(&test.remote, Path::new("hf://datasets/user/repo/noise"), Some(&out)).unwrap();
    assert_eq!(sorted(files_of(&out, "")), sorted(files_of(&golden("dinowm_pusht_noise"), "")));
    assert_eq!(fetched.files, files_of(&out, "").len());
    // A list that names a place outside is not followed.
    test.server.put("/bad/../../x", bytes(3));
    let error =
        fetch_from(&test.remote, Path::new("hf://datasets/user/repo/bad"), Some(&folder.path().join("bad")));
    assert!(error.unwrap_err().to_string().contains("has a name that no file can have"));
}

fn sorted(mut files: Vec<(String, Vec<u8>)>) -> Vec<(String, Vec<u8>)> {
    files.sort();
    files
}

#[test]
fn a_folder_that_was_interrupted_is_continued() {
    let test = of_hub(&[], None);
    put_all(&test.server, "dinowm_pusht_noise", "/noise");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("noise");
    let fetch = || fetch_from(&test.remote, Path::new("hf://datasets/user/repo/noise"), Some(&out));
    let files = files_of(&golden("dinowm_pusht_noise"), "").len();
    // The revision, the pages of the list, and some of the files.
    test.server.state.answers.store(1 + files.div_ceil(2) + 3, Ordering::Relaxed);
    let message = fetch().unwrap_err().to_string();
    assert!(message.contains("503") && !out.exists(), "{message}");
    test.server.state.answers.store(usize::MAX, Ordering::Relaxed);
    test.server.state.asked.lock().unwrap().clear();
    fetch().unwrap();
    assert_eq!(sorted(files_of(&out, "")), sorted(files_of(&golden("dinowm_pusht_noise"), "")));
    let asked = test.server.state.asked.lock().unwrap();
    let fetched = asked.iter().filter(|(path, _)| path.contains("/resolve/")).count();
    assert!(fetched < files, "{fetched} of {files} files are fetched again");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no part is left");
}

#[test]
fn what_changed_meanwhile_is_not_continued() {
    let old = bytes((2 << 20) + 9);
    let test = Test::http(&[("/x.h5", old)]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x.h5");
    let fetch = || fetch_from(&test.remote, &test.at("/x.h5"), Some(&out));
    test.server.fail(&[Fault::Slow, Fault::Cut]);
    test.server.state.faults.lock().unwrap().splice(0..0, vec![Fault::Status(503); 4]);
    fetch().unwrap_err();
    let new = vec![5; (2 << 20) + 9];
    test.server.put("/x.h5", new.clone());
    fetch().unwrap();
    assert!(std::fs::read(&out).unwrap() == new, "nothing of the old version is in it");
}
