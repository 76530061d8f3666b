//! Datasets on a server of this machine: which are read by position, which are fetched as a whole, and what is shown where that fails.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use swm_files::remote::testing::{Fault, Hosted, Server, files_of};
use tempfile::TempDir;

use crate::format::built_in;
use crate::testing::elsewhere::{open_hosted, rows, same};
use crate::testing::mutations::seed;
use crate::{DataError, Dataset, FORMATS, OpenOptions, open};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field").join(name)
}

struct Test {
    hosted: Hosted,
    cache: TempDir,
}

impl Test {
    fn of(hosted: impl FnOnce(&Path) -> Hosted) -> Self {
        let cache = tempfile::tempdir().unwrap();
        Self { hosted: hosted(cache.path()), cache }
    }

    fn http(files: &[(&str, Vec<u8>)]) -> Self {
        Self::of(|cache| Hosted::http(files, cache))
    }

    fn s3() -> Self {
        Self::of(|cache| Hosted::s3(cache, None))
    }

    fn server(&self) -> &Server {
        &self.hosted.server
    }

    fn at(&self, path: &str) -> PathBuf {
        PathBuf::from(format!("{}{path}", self.server().url))
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        open_hosted(&self.hosted, built_in(), path, &OpenOptions::default())
    }
}

#[test]
fn our_formats_are_read_from_a_store() {
    let test = Test::s3();
    let folder = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let name = format!("mine.{}", format.extensions[0]);
        let here = folder.path().join(&name);
        seed(&here);
        match here.is_dir() {
            true => {
                for (path, content) in files_of(&here, &format!("/bucket/{name}")) {
                    test.server().put(&path, content);
                }
            }
            false => test.server().put(&format!("/bucket/{name}"), std::fs::read(&here).unwrap()),
        }
        let path = PathBuf::from(format!("s3://bucket/{name}"));
        let mut dataset = test.open(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        let expected = rows(open(&here).unwrap().as_mut()).unwrap();
        assert!(same(&rows(dataset.as_mut()).unwrap(), &expected), "{name}");
        assert_eq!((dataset.path(), dataset.info().format), (path.as_path(), format.name));
        let is_by_position = dataset.info().notes.iter().any(|note| note.contains("by position"));
        assert_eq!(is_by_position, format.name == "mcap", "{name}");
        // Threads of a loader share what is open.
        assert!(same(&rows(dataset.share().as_mut()).unwrap(), &expected), "{name}");
    }
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
                let other = Hosted::http(&[], cache);
                let mut dataset = open_hosted(&other, built_in(), &address, &OpenOptions::default()).unwrap();
                rows(dataset.as_mut()).unwrap();
            });
        }
    });
    let asked = test.server().state.asked.lock().unwrap();
    let whole = asked.iter().filter(|(_, range)| range.as_deref() != Some("bytes=0-1048575"));
    assert!(whole.count() <= 1, "{asked:?}");
}

#[test]
fn a_copy_above_the_limit_is_refused_before_it_is_fetched() {
    let name = "robomimic_can.hdf5";
    let files = [("/robomimic_can.hdf5", std::fs::read(golden(name)).unwrap())];
    let test = Test::of(|cache| Hosted::limited(&files, cache, 1000));
    let message = test.open(&test.at("/robomimic_can.hdf5")).err().unwrap().to_string();
    assert!(message.contains("whole copy") && message.contains("SWM_CACHE_GB"), "{message}");
    assert_eq!(test.server().count(), 1, "nothing but the first block is fetched");
}

#[test]
fn what_does_not_work_is_named_with_its_fix() {
    let test = Test::http(&[("/x.npz", vec![7; 100]), ("/empty.npz", Vec::new())]);
    let message = |path: &str| test.open(&test.at(path)).err().unwrap().to_string();
    for (faults, path, reasons) in [
        (vec![], "/none.npz", ["nothing is there (404)", "check the address"]),
        (vec![Fault::Status(403); 3], "/x.npz", ["access is denied (403)", "wants a login"]),
        (vec![Fault::Status(503); 5], "/x.npz", ["answers 503, 5 times", "what was fetched is kept"]),
        (vec![Fault::Status(416)], "/x.npz", ["416", "another server"]),
        (vec![Fault::Status(418)], "/x.npz", ["418", "check the address"]),
        (vec![], "/empty.npz", ["the file is empty", ""]),
        (vec![], "/x.npz", ["not a dataset", ""]),
    ] {
        test.server().fail(&faults);
        let message = message(path);
        test.server().state.faults.lock().unwrap().clear();
        assert!(reasons.iter().all(|reason| message.contains(reason)), "{message}");
        assert!(message.contains(path.trim_start_matches('/')) && !message.contains("damaged"), "{message}");
    }
    let none = test.open(Path::new("http://127.0.0.1:9/x.npz")).err().unwrap().to_string();
    assert!(none.contains("5 times") && none.contains("http://127.0.0.1:9/x.npz"), "{none}");
}

#[test]
fn a_file_of_another_kind_is_named_by_its_address() {
    let test = Test::http(&[("/x.h5", b"\x89HDF\r\n\x1a\n and nothing more".to_vec())]);
    let message = test.open(&test.at("/x.h5")).err().unwrap().to_string();
    assert!(message.contains(&format!("{}/x.h5", test.server().url)), "{message}");
    assert!(!message.contains("copies"), "{message}");
}

#[test]
fn a_bucket_without_credentials_names_the_variables() {
    let test = Test::s3();
    *test.server().state.wants.lock().unwrap() = Some("AWS4");
    let message = test.open(Path::new("s3://bucket/x.h5")).err().unwrap().to_string();
    assert!(message.contains("s3://bucket/x.h5") && message.contains("set AWS_ACCESS_KEY_ID"), "{message}");
    *test.server().state.wants.lock().unwrap() = None;
    let message = test.open(Path::new("s3://bucket/x.h5")).err().unwrap().to_string();
    assert!(message.contains("nothing is there (404)"), "{message}");
}

#[test]
fn servers_without_ranges_or_tags() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path().join("p.mcap");
    seed(&here);
    let test = Test::http(&[("/p.mcap", std::fs::read(&here).unwrap())]);
    test.server().state.has_no_ranges.store(true, Ordering::Relaxed);
    let expected = rows(open(&here).unwrap().as_mut()).unwrap();
    let found = rows(test.open(&test.at("/p.mcap")).unwrap().as_mut()).unwrap();
    assert!(same(&found, &expected), "it is one block");
    test.server().state.has_no_tags.store(true, Ordering::Relaxed);
    assert!(test.open(&test.at("/p.mcap")).is_ok());
}
