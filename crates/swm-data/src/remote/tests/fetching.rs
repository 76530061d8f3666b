//! Fetching to a place of one's own, and copies in the cache.

use std::path::Path;
use std::sync::atomic::Ordering;

use super::super::fetch::fetch_from;
use super::super::testing::Fault;
use super::*;
use crate::testing::mutations::seed;

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

#[test]
fn two_processes_make_one_copy() {
    let (folder, path) = (tempfile::tempdir().unwrap(), "/x.h5");
    let here = folder.path().join("x.h5");
    seed(&here);
    let test = Test::http(&[(path, std::fs::read(&here).unwrap())]);
    let (cache, address) = (test.cache.path(), test.at(path));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let other = Remote::new(Settings::of_test(cache)).unwrap();
                let mut dataset = open_from(&other, built_in(), &address, &OpenOptions::default()).unwrap();
                rows(dataset.as_mut()).unwrap();
            });
        }
    });
    let asked = test.server.state.asked.lock().unwrap();
    let whole = asked.iter().filter(|(_, range)| range.as_deref() != Some("bytes=0-1048575"));
    assert!(whole.count() <= 1, "{asked:?}");
}

#[test]
fn a_copy_above_the_limit_is_refused_before_it_is_fetched() {
    let name = "robomimic_can.hdf5";
    let files = [("/robomimic_can.hdf5", std::fs::read(golden(name)).unwrap())];
    let test = Test::new(&files, |settings, _| settings.cache_bytes = 1000);
    let message = test.open(&test.at("/robomimic_can.hdf5")).err().unwrap().to_string();
    assert!(message.contains("whole copy") && message.contains("SWM_CACHE_GB"), "{message}");
    assert_eq!(test.server.count(), 1, "nothing but the first block is fetched");
}
