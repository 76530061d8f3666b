//! What is recorded is what is read: whole episodes, windows, strides, metadata; and equal content makes equal files.

use std::fs;

use proptest::prelude::*;
use swm_core::{Batch, Column, Dtype, Field, FieldKind, Metadata, Schema, SliceMut};
use swm_data::{Steps, WriteMode, create, open};

use crate::support::{assert_same, bits, contents, episode, metadata, record, rows_of, schema};

#[test]
fn episodes_come_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    assert_eq!(record(&path, WriteMode::Error, 0..5).unwrap(), 0);
    let read = contents(&path);
    assert_eq!(read.len(), 5);
    for (index, batch) in read.iter().enumerate() {
        assert_same(&episode(&schema(), index, rows_of(index)), batch);
        assert!(batch.get::<i32>("ep_idx").unwrap().iter().all(|&value| value == index as i32));
    }
}

#[test]
fn the_file_says_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..1).unwrap();
    let dataset = open(&path).unwrap();
    assert_eq!(dataset.info().format, "hdf5");
    assert_eq!(dataset.metadata(), Some(&metadata()));
    let names: Vec<_> = dataset.schema().fields().iter().map(|field| field.name.as_str()).collect();
    let given = schema();
    assert_eq!(names[..names.len() - 1], given.fields().iter().map(|f| f.name.as_str()).collect::<Vec<_>>());
    assert_eq!(names.last(), Some(&"ep_idx"));
    let goal = &dataset.schema().fields()[dataset.schema().index("goal").unwrap()];
    assert_eq!((goal.kind, &goal.shape[..]), (FieldKind::Episode, &[40, 40, 3][..]));
}

#[test]
fn equal_content_makes_equal_files_and_no_other_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a.h5", "b.h5"].map(|name| folder.path().join(name));
    record(&a, WriteMode::Append, 0..4).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1100));
    record(&b, WriteMode::Append, 0..4).unwrap();
    assert!(fs::read(&a).unwrap() == fs::read(&b).unwrap());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn windows_and_strides_of_every_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..5).unwrap();
    let mut dataset = open(&path).unwrap();
    let mut other = dataset.share();
    let schema = dataset.schema().clone();
    for index in 0..5 {
        let rows = rows_of(index);
        let whole = &contents(&path)[index];
        for (column, field) in schema.fields().iter().enumerate() {
            for (first, count, stride) in
                [(0, 1, 1), (rows / 2, rows - rows / 2, 1), (rows / 3, rows.div_ceil(9), 5)]
            {
                let steps = Steps { first, count, stride };
                if steps.end().unwrap() > rows {
                    continue;
                }
                let mut out = Column::zeros(field.dtype, count * field.dim());
                dataset.read_column(column, index, steps, out.as_slice_mut()).unwrap();
                let mut expected = Column::zeros(field.dtype, 0);
                for step in 0..count {
                    let row = whole.row(first + step * stride).at(column);
                    assert!(expected.extend(row));
                }
                assert!(bits(&out) == bits(&expected), "`{}` of episode {index}, {steps:?}", field.name);
                let mut again = Column::zeros(field.dtype, count * field.dim());
                other.read_column(column, index, steps, again.as_slice_mut()).unwrap();
                assert!(bits(&again) == bits(&out));
            }
        }
    }
}

#[test]
fn requests_for_what_is_not_there_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data.h5");
    record(&path, WriteMode::Append, 0..1).unwrap();
    let mut dataset = open(&path).unwrap();
    let reward = dataset.schema().index("reward").unwrap();
    let mut out = Column::zeros(Dtype::F64, 3);
    let mut ask = |column, episode, first, count, stride| {
        let steps = Steps { first, count, stride };
        dataset.read_column(column, episode, steps, out.as_slice_mut()).unwrap_err().to_string()
    };
    assert!(ask(reward, 1, 0, 3, 1).contains("episode 1 of 1"));
    assert!(ask(reward, 0, 3, 3, 1).contains("has 5 rows"));
    assert!(ask(reward, 0, 0, 3, usize::MAX).contains("has 5 rows"));
    assert!(ask(reward, 0, 0, 3, 0).contains("stride of 0"));
    assert!(ask(99, 0, 0, 3, 1).contains("column 99"));
    assert!(ask(reward, 0, 0, 2, 1).contains("cannot hold 2 rows"));
    assert!(ask(0, 0, 0, 3, 1).contains("3 values of float64 cannot hold 3 rows"));

    let wanted = Schema::new(vec![Field::step("rewards", Dtype::F64, &[])]).unwrap();
    let message = dataset.read(0, 0..1, &mut Batch::new(wanted, 0)).unwrap_err().to_string();
    assert!(message.contains("`rewards`") && message.contains("`reward`"), "{message}");
    let wanted = Schema::new(vec![Field::step("reward", Dtype::F32, &[])]).unwrap();
    let message = dataset.read(0, 0..1, &mut Batch::new(wanted, 0)).unwrap_err().to_string();
    assert!(message.contains("holds float64"), "{message}");
}

#[test]
fn a_recorded_dataset_can_be_copied() {
    let folder = tempfile::tempdir().unwrap();
    let [path, copy] = ["a.h5", "b.hdf5"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Append, 0..3).unwrap();
    let dataset = open(&path).unwrap();
    let mut writer = create(&copy, WriteMode::Error, None).unwrap();
    writer.begin(dataset.schema(), dataset.metadata().unwrap()).unwrap();
    for batch in contents(&path) {
        writer.write_episode(&batch).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    assert!(fs::read(&path).unwrap() == fs::read(&copy).unwrap());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Flat, striped and noisy images; elements of one, four and eight bytes, which are shuffled.
    #[test]
    fn any_images_survive_compression(
        frames in proptest::collection::vec((proptest::collection::vec(any::<u8>(), 1..40), 0usize..3000), 1..6),
        side in 40usize..70,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data.h5");
        let shape = [side, side, 3];
        let image = |name, dtype| Field::step(name, dtype, &shape);
        let fields = vec![image("pixels", Dtype::U8), image("depth", Dtype::F32), image("field", Dtype::F64)];
        let schema = Schema::new(fields).unwrap();
        let mut batch = Batch::new(schema.clone(), frames.len());
        let values: Vec<u8> = frames.iter().flat_map(|(pattern, noisy)| {
            let noise = (0..*noisy).map(|at| (at * at * 31 + at * 7) as u8);
            noise.chain(pattern.iter().copied().cycle()).take(side * side * 3)
        }).collect();
        let SliceMut::U8(out) = batch.column_mut(0) else { unreachable!() };
        out.copy_from_slice(&values);
        let SliceMut::F32(out) = batch.column_mut(1) else { unreachable!() };
        out.iter_mut().zip(&values).for_each(|(out, &value)| *out = f32::from(value) / 7.0);
        let SliceMut::F64(out) = batch.column_mut(2) else { unreachable!() };
        out.iter_mut().zip(&values).for_each(|(out, &value)| *out = f64::from(value).sqrt());

        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        writer.begin(&schema, &Metadata::default()).unwrap();
        writer.write_episode(&batch).unwrap();
        writer.finish().unwrap();
        assert_same(&batch, &contents(&path)[0]);
    }
}
