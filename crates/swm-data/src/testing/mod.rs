//! What every format must stand, as public functions that panic: a downstream crate tests its own format with them. Made-up
//! episodes of every type, and writing and reading whole datasets, are here; [`kills`] stops recordings, [`mutations`]
//! changes bytes.

#![expect(clippy::unwrap_used, clippy::missing_panics_doc, reason = "helpers of tests panic as tests do")]

#[cfg(any(feature = "testing", all(test, feature = "remote")))]
pub mod elsewhere;
pub mod kills;
pub mod mutations;

use std::fs;
use std::path::Path;
use std::sync::Arc;

use crate::format::built_in;
use crate::{WriteMode, create_in, open_in};
use swm_core::error::BoxError;
use swm_core::{Batch, Column, Dtype, Field, Metadata, Registry, Schema, SliceMut};

/// How often a test tries: `few` times in a usual run, `many` times where the variable `SWM_ENDURE` is 1, as `cargo xtask
/// endure` sets it.
pub fn rounds(few: usize, many: usize) -> usize {
    if std::env::var_os("SWM_ENDURE").is_some_and(|value| value == "1") { many } else { few }
}

/// Copies a folder with all that is below it.
pub fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copied(&entry.path(), &target),
            false => drop(fs::copy(entry.path(), target).unwrap()),
        }
    }
}

/// A schema with every type, images, and an episode column.
pub fn schema() -> Arc<Schema> {
    Schema::new(vec![
        Field::step("pixels", Dtype::U8, &[40, 40, 3]),
        Field::step("action", Dtype::F32, &[2]),
        Field::step("state", Dtype::F64, &[7]),
        Field::step("reward", Dtype::F64, &[]),
        Field::step("terminated", Dtype::Bool, &[]),
        Field::step("step_idx", Dtype::I64, &[]),
        Field::step("heights", Dtype::F64, &[30, 30]),
        Field::step("task", Dtype::Str, &[]),
        Field::episode("goal", Dtype::U8, &[40, 40, 3]),
        Field::episode("variation.block.color", Dtype::U8, &[3]),
    ])
    .unwrap()
}

/// What is said to be known of them.
pub fn metadata() -> Metadata {
    Metadata {
        version: 1,
        env: "swm/Test-v1".into(),
        seed: 7,
        policy: "random".into(),
        ..Metadata::default()
    }
}

/// Rows of `schema` whose values are a function of (`episode`, row, value).
pub fn episode(schema: &Arc<Schema>, episode: usize, rows: usize) -> Batch {
    let mut batch = Batch::new(schema.clone(), rows);
    for (index, field) in schema.fields().iter().enumerate() {
        let width = field.dim();
        let value = |at: usize| (episode * 7919 + at / width * 31 + at % width / 11) as u64;
        match batch.column_mut(index) {
            SliceMut::Bool(out) => fill(out, |at| value(at) % 3 == 0),
            SliceMut::U8(out) => fill(out, |at| (value(at) % 251) as u8),
            SliceMut::I32(out) => fill(out, |at| value(at) as i32),
            SliceMut::I64(out) => fill(out, |at| value(at) as i64 - 5),
            SliceMut::F32(out) => fill(out, |at| if at == 3 { f32::NAN } else { value(at) as f32 / 3.0 }),
            SliceMut::F64(out) => fill(out, |at| (value(at) as f64).sqrt()),
            SliceMut::Str(out) => fill(out, |at| format!("épisode {episode}, {at}")),
        }
    }
    batch
}

fn fill<T>(out: &mut [T], value: impl Fn(usize) -> T) {
    for (at, target) in out.iter_mut().enumerate() {
        *target = value(at);
    }
}

/// Lengths of the episodes of the tests: different ones, so that chunks begin anywhere.
pub fn rows_of(episode: usize) -> usize {
    [5, 1, 300, 17, 800][episode % 5]
}

/// Records episodes of this range.
///
/// # Errors
///
/// Whatever writing may meet.
pub fn record(path: &Path, mode: WriteMode, episodes: std::ops::Range<usize>) -> Result<u64, BoxError> {
    record_in(built_in(), path, mode, episodes)
}

/// As [`record`], in a format of a registry.
///
/// # Errors
///
/// As of [`record`].
pub fn record_in(
    registry: &Registry,
    path: &Path,
    mode: WriteMode,
    episodes: std::ops::Range<usize>,
) -> Result<u64, BoxError> {
    let schema = schema();
    let mut writer = create_in(registry, path, &mode.into(), None)?;
    let there = writer.begin(&schema, &metadata())?;
    for index in episodes {
        writer.write_episode(&episode(&schema, index, rows_of(index)))?;
    }
    writer.finish()?;
    Ok(there)
}

/// Fails before the first episode of a new dataset at `path`, and of one that it replaces: nothing is left in the folder around it, and
/// another recording begins as if nothing had been. One that was continued keeps its episodes.
pub fn fail_before_the_first_episode(registry: &Registry, path: &Path) {
    let around = path.parent().unwrap();
    let fail = |mode: WriteMode, rows: usize| {
        let schema = schema();
        let mut writer = create_in(registry, path, &mode.into(), None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        if rows > 0 {
            writer.write_rows(&episode(&schema, 0, rows)).unwrap();
        }
    };
    let left =
        || -> Vec<_> { fs::read_dir(around).unwrap().map(|entry| entry.unwrap().file_name()).collect() };
    assert!(left().is_empty());
    for mode in WriteMode::ALL {
        fail(mode, 0);
        assert_eq!(left(), [] as [&str; 0], "{}", mode.name());
        fail(mode, 3);
        assert_eq!(left(), [] as [&str; 0], "{}", mode.name());
    }
    // A caller may end what failed.
    let mut writer = create_in(registry, path, &WriteMode::Error.into(), None).unwrap();
    writer.begin(&schema(), &metadata()).unwrap();
    let other = Schema::new(vec![Field::step("other", Dtype::F32, &[])]).unwrap();
    assert!(writer.write_episode(&episode(&other, 0, 2)).is_err());
    drop(writer.finish());
    drop(writer);
    record_in(registry, path, WriteMode::Overwrite, 0..2).unwrap();
    fail(WriteMode::Append, 3);
    assert_eq!(contents_in(registry, path).len(), 2);
    fail(WriteMode::Overwrite, 3);
    assert!(open_in(registry, path).is_err());
    record_in(registry, path, WriteMode::Append, 0..1).unwrap();
    assert_eq!(contents_in(registry, path).len(), 1);
    // That it holds none was meant.
    record_in(registry, path, WriteMode::Overwrite, 0..0).unwrap();
    assert_eq!(contents_in(registry, path).len(), 0);
}

/// Every column of every episode.
pub fn contents(path: &Path) -> Vec<Batch> {
    contents_in(built_in(), path)
}

/// As [`contents`], in a format of a registry.
pub fn contents_in(registry: &Registry, path: &Path) -> Vec<Batch> {
    let mut dataset = open_in(registry, path).unwrap();
    let schema = dataset.schema().clone();
    (0..dataset.num_episodes())
        .map(|episode| {
            let mut batch = Batch::new(schema.clone(), 0);
            dataset.read(episode, 0..dataset.episode_len(episode), &mut batch).unwrap();
            batch
        })
        .collect()
}

/// Bit equality: NaN equals NaN.
pub fn assert_same(left: &Batch, right: &Batch) {
    assert_eq!(left.rows(), right.rows());
    for field in left.schema().fields() {
        let column =
            |batch: &Batch| bits(&batch.column(batch.schema().require(&field.name).unwrap()).to_column());
        assert!(column(left) == column(right), "column `{}` differs", field.name);
    }
}

/// As [`assert_same`], but images only look alike if they were stored with loss.
pub fn assert_alike(left: &Batch, right: &Batch) {
    assert_eq!(left.rows(), right.rows());
    for field in left.schema().fields() {
        let column = |batch: &Batch| batch.column(batch.schema().require(&field.name).unwrap()).to_column();
        match (column(left), column(right)) {
            (Column::U8(left), Column::U8(right)) if field.shape.len() == 3 => {
                let found = psnr(&left, &right);
                assert!(found > 24.0, "column `{}`: {found} dB", field.name);
            }
            (left, right) => assert!(bits(&left) == bits(&right), "column `{}` differs", field.name),
        }
    }
}

/// Peak signal-to-noise ratio, in dB.
pub fn psnr(left: &[u8], right: &[u8]) -> f64 {
    assert_eq!(left.len(), right.len());
    let squares: f64 = left.iter().zip(right).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    10.0 * (255.0_f64.powi(2) * left.len() as f64 / squares.max(1e-9)).log10()
}

/// The values as little-endian bytes (text as it is).
pub fn bits(column: &Column) -> Vec<u8> {
    match column {
        Column::Bool(values) => values.iter().map(|&value| u8::from(value)).collect(),
        Column::U8(values) => values.clone(),
        Column::I32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        Column::I64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        Column::F32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        Column::F64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        Column::Str(values) => values.join("\0").into_bytes(),
    }
}
