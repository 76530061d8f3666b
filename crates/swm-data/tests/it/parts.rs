//! Parts of a divided recording: what `arrange` refuses, and folders of them as one dataset.

use std::path::Path;
use std::sync::Arc;

use swm_core::{Metadata, RecordingPart};
use swm_data::tools::copy::{all, copy};
use swm_data::tools::parts::{arrange, beside_parts, range};
use swm_data::tools::verify::verify;
use swm_data::{Dataset, MemoryDataset, WriteMode};

use crate::support::{episode, metadata, schema};

/// Part `shard` of `of` of a recording of `total` episodes, which holds `held` of its episodes.
fn part(shard: u64, of: u64, total: u64, held: u64) -> Box<dyn Dataset> {
    part_of(metadata(), shard, of, total, held)
}

fn part_of(metadata: Metadata, shard: u64, of: u64, total: u64, held: u64) -> Box<dyn Dataset> {
    let schema = schema();
    let range = range(shard, of, total);
    let episodes = (range.start..range.start + held).map(|at| Arc::new(episode(&schema, at as usize, 3)));
    let part = RecordingPart { shard, of, first: range.start, end: range.end, total };
    let metadata = Metadata { part: Some(part), ..metadata };
    Box::new(MemoryDataset::new(&format!("part{shard}"), schema.clone(), Some(metadata), episodes).unwrap())
}

fn refused(datasets: Vec<Box<dyn Dataset>>, wanted: &[&str]) {
    let message = arrange(datasets).err().expect("it is refused").to_string();
    for wanted in wanted {
        assert!(message.contains(wanted), "`{wanted}` is not in: {message}");
    }
}

#[test]
fn complete_parts_are_put_in_order() {
    let parts = vec![part(3, 3, 7, 3), part(1, 3, 7, 2), part(2, 3, 7, 2)];
    let arranged = arrange(parts).unwrap();
    let paths: Vec<&Path> = arranged.iter().map(Dataset::path).collect();
    assert_eq!(paths, ["part1", "part2", "part3"].map(Path::new));
    // Parts without episodes may be missing.
    assert_eq!(arrange(vec![part(4, 4, 1, 1)]).unwrap().len(), 1);
}

#[test]
fn incomplete_and_foreign_parts_are_refused() {
    let missing = vec![part(1, 4, 8, 2), part(3, 4, 8, 1)];
    refused(
        missing,
        &[
            "part 2/4 (episodes 2 to 3) is missing",
            "part 3/4 (part3) holds 1 of its 2 episodes",
            "part 4/4 (episodes 6 to 7) is missing",
            "env=swm/Test-v1, seed=7, total=8, shard=2/4, mode=append; `partial` merges without these",
        ],
    );
    refused(vec![part(1, 2, 8, 5), part(2, 2, 8, 4)], &["part 1/2 (part1) holds 5 of its 4 episodes"]);
    refused(vec![part(1, 2, 8, 4), part(1, 2, 8, 4)], &["part 1/2, as is part1"]);
    refused(
        vec![part(1, 2, 8, 4), part(2, 2, 9, 5)],
        &["part2: it is part 2/2 of 9 episodes", "part 1/2 of 8"],
    );
    refused(vec![part(1, 2, 8, 4), part(2, 4, 8, 2)], &["part 2/4 of 8 episodes", "part 1/2 of 8"]);
    let other = part_of(Metadata { seed: 8, ..metadata() }, 2, 2, 8, 4);
    refused(vec![part(1, 2, 8, 4), other], &["another recording than part1: seed 8, not 7"]);
}

#[test]
fn datasets_that_are_no_parts_stay_in_their_order() {
    let plain = |name: &str| -> Box<dyn Dataset> {
        let schema = schema();
        let episodes = [Arc::new(episode(&schema, 0, 3))];
        Box::new(MemoryDataset::new(name, schema.clone(), Some(metadata()), episodes).unwrap())
    };
    let arranged = arrange(vec![plain("b"), plain("a")]).unwrap();
    assert_eq!(arranged.iter().map(Dataset::path).collect::<Vec<_>>(), ["b", "a"].map(Path::new));
    assert!(beside_parts(&arranged).is_empty());
    assert_eq!(beside_parts(&[part(1, 1, 2, 2), plain("c")]), [Path::new("c")]);
}

#[test]
fn a_folder_of_parts_is_one_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().join("parts");
    std::fs::create_dir(&parts).unwrap();
    let write = |dataset: Box<dyn Dataset>, to: &Path| {
        let mut sources = [dataset];
        let pieces = all(&sources);
        copy(&mut sources, &pieces, to, (None, &WriteMode::Error.into()), &mut |_| {}).unwrap();
    };
    // Names do not say the order.
    write(part(1, 2, 5, 2), &parts.join("b.h5"));
    write(part(2, 2, 5, 1), &parts.join("a.h5"));
    std::fs::write(parts.join("a.h5.new"), "unfinished").unwrap();
    let held = swm_data::open(&parts.join("b.h5")).unwrap();
    assert_eq!(held.metadata().unwrap().part.unwrap().shard, 1, "a copy of a part is that part");
    drop(held);
    for path in [folder.path(), &parts] {
        let mut whole = swm_data::open(path).unwrap();
        assert_eq!((whole.path(), whole.num_episodes()), (path, 3));
        assert_eq!(whole.info().runs.to_vec(), [(0, metadata())]);
        let report = verify(whole.as_mut(), &mut |_| {});
        assert!(report.has_checksums, "{report:?}");
        let mut rows = swm_core::Batch::new(whole.schema().clone(), 0);
        for index in 0..3 {
            whole.read(index, 0..3, &mut rows).unwrap();
            let column = whole.schema().index("reward").unwrap();
            let schema = schema();
            let expected = episode(&schema, index, 3);
            assert_eq!(rows.column(column), expected.column(schema.index("reward").unwrap()));
        }
    }
    // So are datasets that are no parts, unless the folder is one of those.
    let plain = parts.join("d.h5");
    let schema = schema();
    let one = MemoryDataset::new("d", schema.clone(), Some(metadata()), [Arc::new(episode(&schema, 0, 3))]);
    write(Box::new(one.unwrap()), &plain);
    let message = swm_data::open(folder.path()).err().unwrap().to_string();
    assert!(message.contains("d.h5: it lies among the parts"), "{message}");
    std::fs::rename(&plain, parts.join("0.h5")).unwrap();
    let message = swm_data::open(folder.path()).err().unwrap().to_string();
    assert!(message.contains("no known format"), "{message}");
    std::fs::remove_file(parts.join("0.h5")).unwrap();
    // Another recording in the folder is refused.
    write(part_of(Metadata { seed: 9, ..metadata() }, 1, 2, 5, 2), &parts.join("c.h5"));
    let message = swm_data::open(folder.path()).err().unwrap().to_string();
    assert!(message.contains("another recording"), "{message}");
}
