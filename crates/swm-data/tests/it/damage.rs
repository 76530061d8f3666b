//! Files that are no datasets, or damaged ones: an error that names the file, never a panic or a hang.

use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};
use std::{fs, io};

use swm_core::{Batch, Column, SliceMut};
use swm_data::error::FormatError;
use swm_data::{DataError, Steps, WriteMode, open};

use crate::support::{contents, record};

fn message(path: &Path) -> String {
    open(path).err().expect("the file must be refused").to_string()
}

#[test]
fn files_that_are_no_datasets() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    assert!(message(&path).contains("cannot open"));
    fs::write(&path, "").unwrap();
    assert!(message(&path).contains("data.h5") && message(&path).contains("empty"));
    fs::write(&path, "episode,reward\n0,1.0\n").unwrap();
    assert!(message(&path).contains("its name is that of the format hdf5, but its content is not"));
    assert!(message(folder.path()).contains("no known format"));

    let file = hdf5_metno::File::create(&path).unwrap();
    file.new_dataset::<f64>().shape((4,)).create("temperature").unwrap();
    drop(file);
    assert!(message(&path).contains("no `ep_len`"), "{}", message(&path));
}

/// The error itself and everything that it names as its cause.
fn chain<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |&error| error.source())
}

#[test]
fn errors_keep_what_is_wrong_and_its_cause() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.folder");
    record(&path, WriteMode::Error, 0..2).unwrap();
    let mut dataset = open(&path).unwrap();
    fs::remove_file(path.join("pixels/ep_1_step_0.jpeg")).unwrap();
    let error = dataset.check_episode(1).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("is damaged: column `pixels`, episode 1: "), "{message}");
    let DataError::Damaged { column: Some(column), episode: Some(1), .. } = &error else {
        panic!("{error:?}")
    };
    assert_eq!(column, "pixels");
    let io = chain(&error).find_map(|error| error.downcast_ref::<io::Error>()).expect("the system's reason");
    assert_eq!(io.kind(), io::ErrorKind::NotFound);

    fs::write(path.join("state.npz"), "no archive").unwrap();
    let error = open(&path).err().expect("the file must be refused");
    let wrong = chain(&error).find_map(|error| error.downcast_ref::<FormatError>());
    assert!(matches!(wrong, Some(FormatError::Invalid(_))), "{error:?}");
}

#[test]
fn columns_that_contradict_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let make = |rows: usize, lengths: &[i32], offsets: &[i64]| {
        let file = hdf5_metno::File::create(&path).unwrap();
        file.new_dataset_builder().with_data(&vec![0.5; rows]).create("reward").unwrap();
        file.new_dataset_builder().with_data(lengths).create("ep_len").unwrap();
        file.new_dataset_builder().with_data(offsets).create("ep_offset").unwrap();
    };
    make(10, &[4, 6], &[0, 4]);
    assert_eq!(contents(&path).len(), 2);
    make(10, &[4, 7], &[0, 4]);
    assert!(message(&path).contains("episode 1 has 7 rows from row 4"), "{}", message(&path));
    make(10, &[4], &[0, 4]);
    assert_eq!(contents(&path).len(), 1);
    make(10, &[-4], &[0]);
    assert!(message(&path).contains("episode 0 has -4 rows"), "{}", message(&path));
}

#[test]
fn columns_of_unknown_types_are_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let file = hdf5_metno::File::create(&path).unwrap();
    file.new_dataset_builder().with_data(&[1i8, -2]).create("small").unwrap();
    file.new_dataset_builder().with_data(&ndarray::arr2(&[[1u16, 2], [3, 65535]])).create("pairs").unwrap();
    file.new_dataset::<hdf5_metno::types::VarLenArray<f32>>().shape((2,)).create("lists").unwrap();
    file.new_dataset::<f64>().shape(()).create("scalar").unwrap();
    file.create_group("notes").unwrap();
    file.new_dataset_builder().with_data(&[2i32]).create("ep_len").unwrap();
    file.new_dataset_builder().with_data(&[0i64]).create("ep_offset").unwrap();
    drop(file);
    let dataset = open(&path).unwrap();
    let names: Vec<_> = dataset.schema().fields().iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names, ["pairs", "small"]);
    let skipped: Vec<_> = dataset.info().skipped.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(skipped, ["lists", "scalar"]);
    assert_eq!(contents(&path)[0].get::<i32>("small").unwrap(), [1, -2]);
    assert_eq!(contents(&path)[0].get::<i32>("pairs").unwrap(), [1, 2, 3, 65535]);
}

#[test]
fn files_with_any_filter_are_read() {
    use hdf5_metno::filters::BloscShuffle;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let values = ndarray::Array2::from_shape_fn((200, 50), |(row, at)| (row * 50 + at) as f64 / 8.0);
    let file = hdf5_metno::File::create(&path).unwrap();
    let make = || file.new_dataset_builder().with_data(&values).chunk((64, 50));
    make().deflate(6).create("gzip").unwrap();
    make().lzf().create("lzf").unwrap();
    make().shuffle().deflate(1).create("shuffled").unwrap();
    make().blosc_zstd(3, BloscShuffle::Bit).create("zstd").unwrap();
    make().blosc_zlib(3, BloscShuffle::Byte).create("zlib").unwrap();
    make().blosc_lz4(9, BloscShuffle::None).create("lz4").unwrap();
    make().blosc_lz4hc(5, BloscShuffle::Byte).create("lz4hc").unwrap();
    file.new_dataset_builder().with_data(&values).chunk((64, 20)).create("tiles").unwrap();
    file.new_dataset_builder().with_data(&values).create("contiguous").unwrap();
    file.new_dataset_builder().with_data(&[150i32, 50]).create("ep_len").unwrap();
    file.new_dataset_builder().with_data(&[0i64, 150]).create("ep_offset").unwrap();
    drop(file);
    let read = contents(&path);
    assert_eq!(read[1].schema().fields().len(), 9);
    for field in read[1].schema().fields() {
        let expected: Vec<f64> = values.iter().skip(150 * 50).copied().collect();
        assert_eq!(read[1].get::<f64>(&field.name).unwrap(), expected, "{}", field.name);
    }
}

/// As h5py cuts them where compression is asked for: along every axis, with a rest at each end.
#[test]
fn rows_in_tiles_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let images = ndarray::Array4::from_shape_fn((40, 21, 20, 3), |(row, y, x, color)| {
        (row * 31 + y * 7 + x * 3 + color) as u8
    });
    let wide = ndarray::Array2::from_shape_fn((40, 17), |(row, at)| row as i64 * 100 - at as i64);
    let half = wide.mapv(|value| value as f32 / 2.0);
    let file = hdf5_metno::File::create(&path).unwrap();
    for (name, chunk) in [("colors", (7, 8, 9, 1)), ("areas", (7, 8, 20, 3)), ("corners", (3, 21, 7, 2))] {
        file.new_dataset_builder().with_data(&images).chunk(chunk).deflate(4).create(name).unwrap();
        file.new_dataset_builder().with_data(&images).chunk(chunk).create(&*format!("plain {name}")).unwrap();
    }
    file.new_dataset_builder().with_data(&wide).chunk((13, 5)).shuffle().deflate(1).create("wide").unwrap();
    file.new_dataset_builder().with_data(&half).chunk((32, 4)).deflate(1).create("half").unwrap();
    file.new_dataset_builder().with_data(&[25i32, 15]).create("ep_len").unwrap();
    file.new_dataset_builder().with_data(&[0i64, 25]).create("ep_offset").unwrap();
    drop(file);
    let mut dataset = open(&path).unwrap();
    let steps = [(0, 0, 25, 1), (0, 3, 8, 1), (1, 1, 5, 3), (1, 14, 1, 1), (0, 24, 1, 7)];
    for (episode, first, count, stride) in steps {
        let rows: Vec<usize> = (0..count).map(|at| episode * 25 + first + at * stride).collect();
        let steps = Steps { first, count, stride };
        for (column, field) in dataset.schema().clone().fields().iter().enumerate() {
            let axis = ndarray::Axis(0);
            let mut out = Column::zeros(field.dtype, count * field.dim());
            dataset.read_column(column, episode, steps, out.as_slice_mut()).unwrap();
            let expected = match field.name.as_str() {
                "wide" => Column::I64(wide.select(axis, &rows).into_raw_vec_and_offset().0),
                "half" => Column::F32(half.select(axis, &rows).into_raw_vec_and_offset().0),
                _ => Column::U8(images.select(axis, &rows).into_raw_vec_and_offset().0),
            };
            assert_eq!(out, expected, "{} {rows:?}", field.name);
        }
    }
    // A damaged stream is named with the row.
    let mut bytes = fs::read(&path).unwrap();
    let stream = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(&[0x78, 0x5e])).collect::<Vec<_>>();
    assert!(stream.len() > 100, "{}", stream.len());
    stream.iter().for_each(|&at| bytes[at + 9] ^= 0xff);
    fs::write(&path, &bytes).unwrap();
    let mut dataset = open(&path).unwrap();
    let column = dataset.schema().fields().iter().position(|field| field.name == "colors").unwrap();
    let mut out = vec![0; 21 * 20 * 3];
    let error =
        dataset.read_column(column, 1, Steps { first: 1, count: 1, stride: 1 }, SliceMut::U8(&mut out));
    let error = error.unwrap_err().to_string();
    assert!(error.contains("colors") && error.contains("row 26"), "{error}");
}

#[test]
fn a_cut_file_is_an_error_at_every_length() {
    let folder = tempfile::tempdir().unwrap();
    let [path, cut] = ["data.h5", "cut.h5"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Append, 0..3).unwrap();
    let bytes = fs::read(&path).unwrap();
    let start = Instant::now();
    for length in (1..48).chain((48..bytes.len()).step_by(bytes.len() / 400)) {
        fs::write(&cut, &bytes[..length]).unwrap();
        let message = message(&cut);
        assert!(message.contains("cut.h5"), "{length}: {message}");
    }
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
}

#[test]
fn flipped_bytes_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let [path, bad] = ["data.h5", "bad.h5"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Append, 0..3).unwrap();
    let bytes = fs::read(&path).unwrap();
    let mut failures = 0;
    for at in (0..bytes.len()).step_by(bytes.len() / 300) {
        let mut bytes = bytes.clone();
        for byte in bytes.iter_mut().skip(at).take(3) {
            *byte ^= 0x5a;
        }
        fs::write(&bad, &bytes).unwrap();
        let Ok(mut dataset) = open(&bad) else {
            failures += 1;
            continue;
        };
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        for episode in 0..dataset.num_episodes() {
            let rows = 0..dataset.episode_len(episode).min(1000);
            failures += usize::from(dataset.read(episode, rows, &mut batch).is_err());
        }
    }
    assert!(failures > 0, "no flip was noticed");
}

#[test]
fn impossible_sizes_are_refused_or_cost_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    let make = |episodes: usize, lengths: &[i32]| {
        let file = hdf5_metno::File::create(&path).unwrap();
        file.new_dataset::<f64>().shape((1usize << 50, 3)).chunk((1024, 3)).create("state").unwrap();
        if lengths.is_empty() {
            file.new_dataset::<i32>().shape((episodes,)).chunk((1024,)).create("ep_len").unwrap();
        } else {
            file.new_dataset_builder().with_data(lengths).create("ep_len").unwrap();
        }
        file.new_dataset_builder().with_data(&[0i64]).create("ep_offset").unwrap();
    };
    make(1 << 50, &[]);
    assert!(message(&path).contains("`ep_len` has the impossible shape"), "{}", message(&path));
    // Rows that were never written are zero, however many there are said to be.
    make(1, &[i32::MAX]);
    let mut dataset = open(&path).unwrap();
    let steps = Steps { first: i32::MAX as usize - 2, count: 2, stride: 1 };
    let mut out = [1.0; 6];
    dataset.read_column(0, 0, steps, SliceMut::F64(&mut out)).unwrap();
    assert_eq!(out, [0.0; 6]);
}
