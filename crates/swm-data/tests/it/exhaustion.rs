//! Small files that claim to be large, and files without an end: an error in a short time, without the memory that they
//! ask for.

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use swm_core::Batch;
use swm_data::{ReplayBuffer, WriteMode, open};
use zip::CompressionMethod;
use zip::write::SimpleFileOptions;

use crate::support::record;

#[test]
fn a_small_file_cannot_ask_for_more_than_it_can_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let file = hdf5_metno::File::create(&path).unwrap();
    file.new_dataset::<f64>().shape((1usize << 40, 4)).chunk((1024, 4)).create("state").unwrap();
    file.new_dataset_builder().with_data(&[1_750_000_000i32]).create("ep_len").unwrap();
    file.new_dataset_builder().with_data(&[0i64]).create("ep_offset").unwrap();
    drop(file);
    assert!(fs::metadata(&path).unwrap().len() < 10_000);
    let mut dataset = open(&path).unwrap();
    let rows = dataset.episode_len(0);
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    let message = dataset.read(0, 0..rows, &mut batch).unwrap_err().to_string();
    assert!(message.contains("52 GB, more than a file of"), "{message}");
    assert_eq!(batch.rows(), 0);
    assert!(dataset.read(0, 0..rows + 1, &mut batch).unwrap_err().to_string().contains("too few"));
    assert!(ReplayBuffer::load(dataset.as_mut(), usize::MAX).is_err());
    // A part of it is zeros, as before.
    dataset.read(0, rows - 3..rows, &mut batch).unwrap();
    assert_eq!(batch.get::<f64>("state").unwrap(), [0.0; 12]);
}

#[test]
fn a_row_is_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let file = hdf5_metno::File::create(&path).unwrap();
    let wide = 1usize << 30;
    file.new_dataset::<u8>().shape((5, wide)).chunk((1, wide)).deflate(1).create("wide").unwrap();
    file.new_dataset_builder().with_data(&[5i32]).create("ep_len").unwrap();
    file.new_dataset_builder().with_data(&[0i64]).create("ep_offset").unwrap();
    drop(file);
    let message = open(&path).err().unwrap().to_string();
    assert!(message.contains("a row of column `wide` has the shape"), "{message}");
}

#[test]
fn an_image_cannot_claim_more_than_its_dataset_can_hold() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |path: &Path, megabytes: &str| {
        let message = open(path).err().unwrap().to_string();
        assert!(
            message.contains("a row of column `pixels` claims") && message.contains(megabytes),
            "{message}"
        );
    };
    let path = folder.path().join("data.folder");
    // One row: some 20 kB.
    record(&path, WriteMode::Error, 1..2).unwrap();
    let manifest = fs::read_to_string(path.join("ep_len.json")).unwrap();
    let mut edited: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    edited["columns"][0]["shape"] = serde_json::json!([6000, 6000, 3]);
    fs::write(path.join("ep_len.json"), edited.to_string()).unwrap();
    refused(&path, "108 MB");
    fs::write(path.join("ep_len.json"), manifest).unwrap();
    assert!(open(&path).is_ok());
}

/// Makes an archive of zeros that are compressed away.
fn bomb(path: &Path, descriptor: &str, rows: u64, bytes: u64) {
    let mut archive = zip::ZipWriter::new(fs::File::create(path).unwrap());
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .compression_level(Some(1))
        .large_file(true);
    archive.start_file("arr_0.npy", options).unwrap();
    let text = format!("{{'descr': '{descriptor}', 'fortran_order': False, 'shape': ({rows},), }}");
    archive.write_all(b"\x93NUMPY\x01\x00\x76\x00").unwrap();
    archive.write_all(format!("{text:<117}\n").as_bytes()).unwrap();
    std::io::copy(&mut std::io::repeat(0).take(bytes), &mut archive).unwrap();
    archive.finish().unwrap();
}

#[test]
fn archives_that_unpack_to_more_than_memory_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.folder");
    fs::create_dir(&path).unwrap();
    let start = Instant::now();
    bomb(&path.join("ep_len.npz"), "<i4", 1 << 25, 1 << 27);
    bomb(&path.join("ep_offset.npz"), "<i8", 1, 8);
    bomb(&path.join("state.npz"), "<f8", 1, 8);
    let message = open(&path).err().unwrap().to_string();
    assert!(message.contains("ep_len.npz") && message.contains("claims 33554432 episodes"), "{message}");
    bomb(&path.join("ep_len.npz"), "<i4", 1, 4);
    bomb(&path.join("state.npz"), "<f8", 1 << 28, 1 << 31);
    let dataset = open(&path);
    let said = match &dataset {
        Ok(dataset) => dataset.info().skipped.iter().map(|(_, reason)| reason.clone()).collect(),
        Err(error) => error.to_string(),
    };
    assert!(said.contains("2 GB of memory"), "{said}");
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
}

#[test]
fn a_trillion_bytes_without_content_are_no_archive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.folder");
    fs::create_dir(&path).unwrap();
    for (file, descriptor, bytes) in
        [("ep_len.npz", "<i4", 4), ("ep_offset.npz", "<i8", 8), ("state.npz", "<f8", 8)]
    {
        bomb(&path.join(file), descriptor, 1, bytes);
    }
    assert!(open(&path).is_ok());
    for file in ["state.npz", "ep_len.npz"] {
        fs::File::create(path.join(file)).unwrap().set_len(1 << 40).unwrap();
        let start = Instant::now();
        let said = match open(&path) {
            Ok(dataset) => dataset.info().skipped.iter().map(|(_, reason)| reason.clone()).collect(),
            Err(error) => error.to_string(),
        };
        assert!(said.contains("zip archive"), "{file}: {said}");
        assert!(start.elapsed() < Duration::from_secs(20), "{file}: {:?}", start.elapsed());
    }
}

#[test]
fn pipes_and_devices_are_no_files_of_a_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe.h5");
    if !Command::new("mkfifo").arg(&pipe).status().unwrap().success() {
        return;
    }
    let start = Instant::now();
    let message = open(&pipe).err().unwrap().to_string();
    assert!(message.contains("neither a regular file nor a folder"), "{message}");
    assert!(record(&pipe, WriteMode::Append, 0..1).is_err());
    let path = folder.path().join("data.folder");
    record(&path, WriteMode::Error, 0..2).unwrap();
    for (part, target) in [
        ("pixels/ep_1_step_0.jpeg", pipe.as_path()),
        ("state.npz", &pipe),
        ("ep_len.index", Path::new("/dev/zero")),
        ("ep_len.json", Path::new("/dev/zero")),
    ] {
        let (here, kept) = (path.join(part), folder.path().join("kept"));
        fs::rename(&here, &kept).unwrap();
        symlink(target, &here).unwrap();
        let read = open(&path).and_then(|mut dataset| dataset.check_episode(1));
        let message = read.unwrap_err().to_string();
        assert!(message.contains("no regular file"), "{part}: {message}");
        fs::remove_file(&here).unwrap();
        fs::rename(&kept, &here).unwrap();
    }
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}
