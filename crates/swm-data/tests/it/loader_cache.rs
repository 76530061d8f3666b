//! Loaders that read decoded images from files: the clips of those that decode, whatever happens to the files.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use swm_core::{Batch, ImageSize};
use swm_data::adapt::{Concat, Subset};
use swm_data::loader::{CacheOptions, ClipOptions, GoalOptions, Images, Loader};
use swm_data::testing::kills::{TARGET, child};
use swm_data::{Dataset, MemoryDataset, WriteMode};

use crate::support::{assert_same, contents, metadata, record};
use crate::{FORMATS, open};

/// The test that is the process which is killed.
const TEST: &str = "loader_cache::decode_once";

fn options() -> ClipOptions {
    let goals = GoalOptions::hindsight(&["pixels"], 4);
    ClipOptions::default().num_steps(2).frameskip(3).images(Images::ChannelsFirst).goals(Some(goals))
}

fn with_cache() -> ClipOptions {
    options().cache(Some(CacheOptions::default()))
}

fn read(loader: &Loader) -> Batch {
    let clips: Vec<usize> = (0..40).map(|at| at * 7919 % loader.len()).collect();
    let mut batch = loader.new_batch();
    loader.read(&clips, &mut batch).unwrap();
    batch
}

/// The clips with and without a cache are the same; the loader with one.
fn assert_equal(make: impl Fn() -> Box<dyn Dataset>, options: &ClipOptions) -> Loader {
    let plain = Loader::new(make(), &options.clone().cache(None)).unwrap();
    let cached = Loader::new(make(), options).unwrap();
    assert_eq!((plain.len(), plain.schema()), (cached.len(), cached.schema()));
    assert_same(&read(&plain), &read(&cached));
    cached
}

fn folder_of(path: &Path) -> PathBuf {
    PathBuf::from(format!("{}.decoded", path.display()))
}

fn files(path: &Path) -> usize {
    fs::read_dir(folder_of(path)).map_or(0, Iterator::count)
}

#[test]
fn clips_are_equal_for_every_format() {
    for format in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        let name = format.name;
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        record(&path, WriteMode::Append, 0..4).unwrap();
        let open = || open(&path).unwrap();
        let cached = assert_equal(open, &with_cache());
        let [images] = cached.cached() else { panic!("{name}: {:?}", cached.cached()) };
        assert_eq!((images.column.as_str(), images.rows), ("pixels", 323), "{name}");
        assert_eq!(images.bytes, fs::metadata(&images.path).unwrap().len());
        assert!(images.path.starts_with(folder_of(&path)) && images.seconds.is_some());
        let again = assert_equal(open, &with_cache());
        assert!(again.cached()[0].seconds.is_none(), "{name}: {}", again.cached()[0]);
        // Another size is another file, and is resized once.
        let small = with_cache().image(Some(ImageSize { height: 16, width: 20 }));
        let small = assert_equal(open, &small);
        assert_eq!(small.cached()[0].bytes, 4096 + 323 * 16 * 20 * 3);
        assert_eq!(files(&path), 2, "{name}");
    }
}

#[test]
fn parts_of_datasets_have_files_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    record(&a, WriteMode::Append, 0..4).unwrap();
    record(&b, WriteMode::Append, 1..3).unwrap();
    for episodes in [[0, 2], [2, 0], [2, 3]] {
        assert_equal(|| Box::new(Subset::new(open(&a).unwrap(), &episodes).unwrap()), &with_cache());
    }
    assert_equal(
        || Box::new(Concat::new(vec![open(&a).unwrap(), open(&b).unwrap()]).unwrap()),
        &with_cache(),
    );
    assert_equal(
        || Box::new(Concat::new(vec![open(&a).unwrap(), open(&a).unwrap()]).unwrap()),
        &with_cache(),
    );
    assert_eq!(files(&a), 5);
}

#[test]
fn files_of_a_dataset_that_was_changed_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.mcap");
    let make = || open(&path).unwrap();
    record(&path, WriteMode::Append, 0..3).unwrap();
    assert_equal(make, &with_cache());
    record(&path, WriteMode::Append, 3..4).unwrap();
    assert!(assert_equal(make, &with_cache()).cached()[0].seconds.is_some());
    // Episodes of the same lengths, with other images.
    record(&path, WriteMode::Overwrite, 5..9).unwrap();
    let cached = assert_equal(make, &with_cache());
    assert!(cached.cached()[0].seconds.is_some());
    let file = cached.cached()[0].path.clone();
    assert_eq!(files(&path), 1);
    // One that was cut.
    fs::File::options().write(true).open(&file).unwrap().set_len(9000).unwrap();
    assert!(assert_equal(make, &with_cache()).cached()[0].seconds.is_some());
}

#[test]
fn two_at_once_write_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.mcap");
    record(&path, WriteMode::Append, 0..5).unwrap();
    let make = || assert_equal(|| open(&path).unwrap(), &with_cache()).cached()[0].seconds.is_some();
    let wrote: Vec<bool> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(make)).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!((wrote.iter().filter(|wrote| **wrote).count(), files(&path)), (1, 1));
}

/// In the process that is killed.
#[test]
fn decode_once() {
    let Some(path) = std::env::var_os(TARGET) else { return };
    println!("\nbegun 0");
    Loader::new(open(Path::new(&path)).unwrap(), &with_cache()).unwrap();
    println!("written 1");
}

#[test]
fn kills_leave_nothing_that_is_read() {
    use std::io::{BufRead as _, BufReader};

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.mcap");
    record(&path, WriteMode::Append, 0..5).unwrap();
    let mut parts = 0;
    for round in 0..40 {
        let mut process = child(&path, TEST, "").spawn().unwrap();
        let output = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        output.take_while(|line| !line.starts_with("begun")).for_each(drop);
        std::thread::sleep(Duration::from_millis(round));
        process.kill().unwrap();
        process.wait().unwrap();
        let names = fs::read_dir(folder_of(&path)).into_iter().flatten();
        let names: Vec<_> = names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        parts += usize::from(names.iter().any(|name| name.ends_with(".part")));
        if names.iter().any(|name| name.ends_with(".frames")) {
            break;
        }
    }
    assert!(parts > 0, "no kill met a file that was being written");
    let cached = assert_equal(|| open(&path).unwrap(), &with_cache());
    assert_eq!(files(&path), 1, "no part and no lock is left");
    // As a kill leaves it between the two last things that are done.
    fs::write(format!("{}.lock", cached.cached()[0].path.display()), "process 4194305 on elsewhere\n")
        .unwrap();
    assert_equal(|| open(&path).unwrap(), &with_cache());
    assert_eq!(files(&path), 1, "the lock of a file in place is left");
}

#[test]
fn a_limit_is_kept_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.mcap");
    record(&path, WriteMode::Append, 0..4).unwrap();
    let needed = 4096 + 323 * 4800;
    let with = |limit| options().cache(Some(CacheOptions::default().limit(limit)));
    let refused = Loader::new(open(&path).unwrap(), &with(needed - 1)).err().unwrap().to_string();
    for part in
        ["cache_limit", &needed.to_string(), &(needed - 1).to_string(), "`pixels`: 323 images of 40 x 40"]
    {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    assert_eq!(files(&path), 0);
    Loader::new(open(&path).unwrap(), &with(needed)).unwrap();
    // What is there costs nothing.
    Loader::new(open(&path).unwrap(), &with(0)).unwrap();
}

#[test]
fn images_that_no_file_holds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..1).unwrap();
    let episodes = contents(&path);
    let schema = episodes[0].schema().clone();
    let memory =
        MemoryDataset::new("memory", schema, Some(metadata()), episodes.into_iter().map(Into::into)).unwrap();
    let options = ClipOptions::default().cache(Some(CacheOptions::default()));
    let refused = Loader::new(memory.share(), &options).err().unwrap().to_string();
    assert!(refused.contains("`cache`") && refused.contains("in memory"), "{refused}");
    // Without images, there is nothing to refuse.
    let loader = Loader::new(Box::new(memory), &options.keys(Some(vec!["action".to_owned()]))).unwrap();
    assert!(loader.cached().is_empty());
}
