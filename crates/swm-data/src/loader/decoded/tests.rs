//! Files of decoded images: where they are put, what is in them, and who waits for them.

use swm_core::{Batch, Cancel, Field};

use super::*;
use crate::adapt::Watched;
use crate::{ClipOptions, MemoryDataset};

/// Episodes of images of 80 x 80, every byte of which depends on episode, row and place.
fn in_memory(lengths: &[usize]) -> MemoryDataset {
    let schema = Schema::new(vec![Field::step("pixels", Dtype::U8, &[80, 80, 3])]).unwrap();
    let episodes = lengths.iter().enumerate().map(|(episode, &len)| {
        let mut batch = Batch::new(schema.clone(), len);
        let SliceMut::U8(pixels) = batch.column_mut(0) else { panic!() };
        pixels.iter_mut().enumerate().for_each(|(at, byte)| *byte = (at / 19_200 * 7 + at + episode) as u8);
        Arc::new(batch)
    });
    MemoryDataset::new("memory", schema.clone(), None, episodes).unwrap()
}

fn source(dataset: &dyn Dataset, folders: Vec<PathBuf>) -> (Source<'_>, Target) {
    let plan = Plan::new(dataset, &ClipOptions::default()).unwrap();
    let origin = dataset.origin().unwrap_or_default();
    let state = state::state(dataset.info(), &origin).unwrap();
    let source = Source { dataset, origin, state, folders, threads: 3 };
    let (column, convert) = images(dataset.info(), &plan)[0];
    let target = source.target(column, convert);
    (source, target)
}

#[test]
fn folders_are_beside_the_dataset_else_among_caches() {
    let options = CacheOptions::default();
    let caches = || Some(PathBuf::from("/caches"));
    let [near, far] = &folders(Path::new("/data/a.mp4"), &options, caches())[..] else { panic!() };
    assert_eq!(near, Path::new("/data/a.mp4.decoded"));
    assert!(far.to_string_lossy().starts_with("/caches/decoded/a.mp4-"), "{far:?}");
    let [only] = &folders(Path::new("https://host/a.npz"), &options, caches())[..] else { panic!() };
    assert!(only.starts_with("/caches/decoded"));
    // Several datasets may have the same folder.
    let options = options.folder(Some("/x".into()));
    let [a, b] = ["/data/a.mp4", "/data/b.mp4"].map(|path| folders(Path::new(path), &options, caches()));
    assert!(a[0].starts_with("/x") && a.len() == 1 && a != b, "{a:?} {b:?}");
}

#[test]
fn a_folder_that_cannot_be_written_to_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    crate::testing::record(&path, crate::WriteMode::Append, 0..2).unwrap();
    let dataset = crate::open(&path).unwrap();
    // A file where the folder would be made: also an administrator cannot write there.
    let (closed, far) = (beside(&path, ".decoded"), folder.path().join("far"));
    fs::write(&closed, "").unwrap();
    let (mut source, target) = source(dataset.as_ref(), vec![closed.clone(), far.clone()]);
    let (kept, seconds) = source.make(&target).unwrap();
    assert!(kept.path.starts_with(&far) && seconds.is_some(), "{:?}", kept.path);
    source.folders = vec![closed];
    let refused = source.make(&target).err().unwrap();
    assert!(refused.to_string().contains("data.h5.decoded"), "{refused}");
}

#[test]
fn images_are_in_the_order_of_rows() {
    let folder = tempfile::tempdir().unwrap();
    // Several runs and pieces in an episode, and an episode without rows.
    let lengths = [1100, 0, 3];
    let mut dataset = in_memory(&lengths);
    let (source, target) = source(&dataset, vec![folder.path().join("decoded")]);
    assert!(target.per_piece() < RUN && RUN < lengths[0]);
    let (kept, _) = source.make(&target).unwrap();
    let bytes = fs::read(&kept.path).unwrap();
    let mut wanted = target.header.clone();
    for (episode, &count) in lengths.iter().enumerate() {
        let mut images = vec![0; count * target.dim];
        let steps = Steps { first: 0, count, stride: 1 };
        dataset.read_column(0, episode, steps, SliceMut::U8(&mut images)).unwrap();
        wanted.extend(images);
    }
    assert!(bytes == wanted && bytes.len() as u64 == target.bytes());
}

#[test]
fn waiting_for_another_writer_can_be_interrupted() {
    let (folder, cancel) = (tempfile::tempdir().unwrap(), Cancel::new());
    let dataset = Watched::new(Box::new(in_memory(&[2])), cancel.clone());
    let (source, target) = source(&dataset, vec![folder.path().to_owned()]);
    let _writer = WriterLock::take(&folder.path().join(&target.name)).unwrap();
    let interrupt = thread::spawn(move || {
        thread::sleep(2 * PAUSE);
        cancel.cancel();
    });
    let refused = source.make(&target).err().unwrap().to_string();
    assert!(refused.contains("interrupted"), "{refused}");
    interrupt.join().unwrap();
}
