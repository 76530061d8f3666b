//! A folder on a server of this machine: fetched as a whole.

use std::fs;
use std::path::Path;

use swm_data::OpenOptions;
use swm_data::testing::elsewhere::open_hosted;
use swm_data::testing::mutations::{files, seed_in};
use swm_files::remote::testing::Hosted;

use crate::support::contents;
use crate::{open, registry};

#[test]
fn a_folder_is_read_from_a_store() {
    let [folder, cache] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let hosted = Hosted::s3(cache.path(), None);
    let here = folder.path().join("mine.lerobot");
    seed_in(registry(), &here);
    for file in files(&here) {
        let below = file.strip_prefix(folder.path()).unwrap().to_str().unwrap();
        hosted.server.put(&format!("/bucket/{below}"), fs::read(&file).unwrap());
    }
    let path = Path::new("s3://bucket/mine.lerobot");
    let dataset = open_hosted(&hosted, registry(), path, &OpenOptions::default()).unwrap();
    assert_eq!((dataset.path(), dataset.info().format), (path, "lerobot"));
    assert_eq!(dataset.info().lengths, open(&here).unwrap().info().lengths);
    assert!(dataset.info().notes.iter().any(|note| note.contains("fetched as a whole")));
    assert!(!contents(&here).is_empty());
}
