//! Images in the tables.

use std::fs;
use std::path::Path;

use swm_core::Batch;
use swm_data::Steps;

use crate::copied;
use crate::golden;
use crate::{mutate, open};

/// A folder of version 3.0 with its images in its table, `file(row)` each; the table's row groups cut through its episodes of 4 and 6 rows.
fn with_images_in_tables(path: &Path, shape: [usize; 3], file: impl Fn(usize) -> Option<Vec<u8>>) {
    with_images(path, shape, file, |row| format!("{row}.png"));
}

/// As [`with_images_in_tables`], where `path(row)` is the path of the image of a row.
fn with_images(
    path: &Path,
    shape: [usize; 3],
    file: impl Fn(usize) -> Option<Vec<u8>>,
    place: impl Fn(usize) -> String,
) {
    use parquet::basic::{ConvertedType, Repetition, Type as Physical};
    use parquet::data_type::{ByteArray, ByteArrayType, Int64Type};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::types::Type;

    const CAMERA: &str = "observation.images.top";
    copied(&golden("lerobot_v3.0"), path);
    let info = fs::read_to_string(path.join("meta/info.json")).unwrap();
    let mut info: serde_json::Value = serde_json::from_str(&info).unwrap();
    info["features"] = serde_json::json!({
        CAMERA: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]},
        "frame_index": {"dtype": "int64", "shape": [1], "names": null},
    });
    fs::write(path.join("meta/info.json"), info.to_string()).unwrap();
    let leaf = |name: &str, physical, converted| {
        let leaf = Type::primitive_type_builder(name, physical).with_converted_type(converted);
        std::sync::Arc::new(leaf.with_repetition(Repetition::OPTIONAL).build().unwrap())
    };
    let bytes = leaf("bytes", Physical::BYTE_ARRAY, ConvertedType::NONE);
    let name = leaf("path", Physical::BYTE_ARRAY, ConvertedType::UTF8);
    let image =
        Type::group_type_builder(CAMERA).with_repetition(Repetition::OPTIONAL).with_fields(vec![bytes, name]);
    let step = leaf("frame_index", Physical::INT64, ConvertedType::NONE);
    let schema = Type::group_type_builder("schema").with_fields(vec![image.build().unwrap().into(), step]);
    let out = fs::File::create(path.join("data/chunk-000/file-000.parquet")).unwrap();
    let mut writer =
        SerializedFileWriter::new(out, schema.build().unwrap().into(), std::sync::Arc::default()).unwrap();
    for rows in [0..3, 3..10] {
        let mut group = writer.next_row_group().unwrap();
        let files: Vec<Option<Vec<u8>>> = rows.clone().map(&file).collect();
        let depths: Vec<i16> = files.iter().map(|file| if file.is_some() { 2 } else { 1 }).collect();
        let files: Vec<ByteArray> = files.into_iter().flatten().map(ByteArray::from).collect();
        let names: Vec<ByteArray> = rows.clone().map(|row| place(row).as_str().into()).collect();
        for (values, depths) in [(&files, depths), (&names, vec![2; rows.len()])] {
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<ByteArrayType>().write_batch(values, Some(&depths), None).unwrap();
            column.close().unwrap();
        }
        let mut column = group.next_column().unwrap().unwrap();
        // Counted in each episode.
        let steps: Vec<i64> = rows.map(|row| if row < 4 { row } else { row - 4 } as i64).collect();
        column.typed::<Int64Type>().write_batch(&steps, Some(&vec![1; steps.len()]), None).unwrap();
        column.close().unwrap();
        group.close().unwrap();
    }
    writer.close().unwrap();
}

/// An image of 6 x 8 pixels in one color.
fn plain(row: usize) -> Vec<u8> {
    [20 * row as u8, 100, 7].repeat(6 * 8)
}

#[test]
fn images_in_tables_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    with_images_in_tables(&path, [6, 8, 3], |row| {
        Some(match row % 2 {
            0 => swm_media::png::encode(6, 8, &plain(row)).unwrap(),
            _ => swm_media::jpeg::encode(6, 8, 3, &plain(row), 100).unwrap(),
        })
    });
    let mut dataset = open(&path).unwrap();
    assert!(dataset.info().skipped.is_empty(), "{:?}", dataset.info().skipped);
    let pixels = dataset.schema().index("pixels").expect("the first camera");
    assert_eq!(dataset.schema().fields()[pixels].shape, [6, 8, 3]);
    let is_near = |found: &[u8], row: usize| {
        let apart = found.iter().zip(plain(row)).map(|(&a, b)| a.abs_diff(b)).max();
        assert!(apart <= Some(if row.is_multiple_of(2) { 0 } else { 3 }), "row {row}: {apart:?}");
    };
    for (episode, first, rows) in [(0, 0, 4), (1, 4, 6), (0, 0, 4)] {
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        dataset.read(episode, 0..rows, &mut batch).unwrap();
        let images = batch.get::<u8>("pixels").unwrap().chunks_exact(6 * 8 * 3);
        images.enumerate().for_each(|(at, image)| is_near(image, first + at));
        assert_eq!(batch.get::<i64>("frame_index").unwrap()[..2], [0, 1]);
    }
    let mut out = vec![0; 2 * 6 * 8 * 3];
    let steps = Steps { first: 1, count: 2, stride: 3 };
    dataset.read_column(pixels, 1, steps, swm_core::SliceMut::U8(&mut out)).unwrap();
    out.chunks_exact(6 * 8 * 3).zip([5, 8]).for_each(|(image, row)| is_near(image, row));
    mutate("images in tables", &path);
}

/// While it records, LeRobot keeps images in files, and their paths on its machine in the table.
#[test]
fn images_in_files_are_read_by_their_paths() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let name = |row: usize| format!("images/observation.images.top/episode-000000/frame-{row:06}.png");
    let png = |row| swm_media::png::encode(6, 8, &plain(row)).unwrap();
    // Some are embedded, and some paths begin elsewhere.
    let place = |row: usize| match row % 3 {
        0 => name(row),
        _ => format!("/data/images/lerobot/{}", name(row)),
    };
    with_images(&path, [6, 8, 3], |row| (row == 2).then(|| png(row)), place);
    let message = open(&path).err().unwrap().to_string();
    for part in
        ["observation.images.top", &name(0), "which is not in the folder of the dataset", "embed_images"]
    {
        assert!(message.contains(part), "{part}: {message}");
    }
    fs::create_dir_all(path.join(name(0)).parent().unwrap()).unwrap();
    for row in (0..10).filter(|&row| row != 2) {
        fs::write(path.join(name(row)), png(row)).unwrap();
    }
    let mut dataset = open(&path).unwrap();
    assert!(dataset.info().skipped.is_empty(), "{:?}", dataset.info().skipped);
    for (episode, first, rows) in [(0, 0, 4), (1, 4, 6)] {
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        dataset.read(episode, 0..rows, &mut batch).unwrap();
        let expected: Vec<u8> = (first..first + rows).flat_map(plain).collect();
        assert!(batch.get::<u8>("pixels").unwrap() == expected, "episode {episode}");
    }
    fs::remove_file(path.join(name(7))).unwrap();
    let mut batch = Batch::new(dataset.schema().clone(), 0);
    let message = dataset.read(1, 0..6, &mut batch).unwrap_err().to_string();
    for part in ["`pixels`", "episode 1", "row 3", &name(7), "not in the folder of the dataset"] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn images_in_tables_that_cannot_be_read_are_told_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let told = |name: &str, shape, file: &dyn Fn(usize) -> Option<Vec<u8>>| {
        let path = folder.path().join(name);
        with_images_in_tables(&path, shape, file);
        match open(&path) {
            Err(error) => (false, error.to_string()),
            Ok(dataset) => {
                let skipped = dataset.info().skipped.clone();
                assert_eq!((skipped.len(), skipped[0].0.as_str()), (1, "observation.images.top"));
                (true, skipped[0].1.clone())
            }
        }
    };
    let png = |row| Some(swm_media::png::encode(6, 8, &plain(row)).unwrap());
    let (opens, reason) = told("size", [8, 8, 3], &png);
    assert!(!opens && reason.contains("[6, 8, 3], not [8, 8, 3]"), "{reason}");
    let (opens, reason) = told("depth", [6, 8, 1], &png);
    assert!(opens && reason.contains("not 3 colors"), "{reason}");
    // Another camera would become `pixels`.
    let (opens, reason) = told("outside", [6, 8, 3], &|_| None);
    assert!(!opens && reason.contains("observation.images.top: ") && reason.contains("`0.png`"), "{reason}");
    let (opens, reason) = told("damaged", [6, 8, 3], &|_| Some(b"no image".to_vec()));
    assert!(opens && reason.contains("neither PNG nor JPEG"), "{reason}");
}
