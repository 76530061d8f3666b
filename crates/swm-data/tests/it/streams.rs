//! Copies of episodes that do not fit in memory: what is held at once is bounded, and files do not depend on the pieces.

use std::path::{Path, PathBuf};
use std::process::Command;

use swm_core::{Batch, Dtype, Field, Schema, SliceMut};
use swm_data::tools::copy::all;
use swm_data::{DataError, Dataset, DatasetInfo, Steps, WriteMode, WriteOptions};

use crate::support::{assert_same, contents, episode, metadata, schema};
use crate::{FORMATS, copy, create, open};

/// Bytes of the long episode, and what copying it may hold.
const EPISODE_BYTES: usize = 400 << 20;
const MAX_HELD_KIB: u64 = 320 << 10;
const SIDES: [usize; 3] = [128, 128, 3];

/// One long episode whose rows are made up when they are read: few different images, for the sake of time.
#[derive(Clone)]
struct Long {
    info: DatasetInfo,
}

impl Long {
    fn new() -> Self {
        let fields = vec![Field::step("pixels", Dtype::U8, &SIDES), Field::step("state", Dtype::F64, &[4])];
        let rows = EPISODE_BYTES / SIDES.iter().product::<usize>();
        Self {
            info: DatasetInfo::new(Path::new("long"), "made up", Schema::new(fields).unwrap(), vec![rows]),
        }
    }
}

impl Dataset for Long {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        _episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let width = self.info.field(column).dim();
        match out {
            SliceMut::U8(out) => {
                for (at, frame) in out.chunks_exact_mut(width).enumerate() {
                    frame.fill(((steps.first + at) / 64) as u8);
                }
            }
            SliceMut::F64(out) => {
                out.iter_mut().enumerate().for_each(|(at, value)| *value = (steps.first * 4 + at) as f64);
            }
            _ => {}
        }
        Ok(())
    }

    fn share(&self) -> Box<dyn Dataset> {
        Box::new(self.clone())
    }
}

/// The largest memory that this process held so far, in KiB.
fn peak_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

const TARGET: &str = "SWM_DATA_TEST_COPY_TO";

/// Not a test by itself: copies the long episode, and back again, and says how much memory that took.
#[test]
fn copy_a_long_episode() {
    let Some(path) = std::env::var_os(TARGET).map(PathBuf::from) else { return };
    let before = peak_kib().unwrap();
    let convert = |source: Box<dyn Dataset>, to: &Path| {
        let mut sources = vec![source];
        let pieces = all(&sources);
        copy(&mut sources, &pieces, to, (None, &WriteOptions::default()), &mut |_| {}).unwrap()
    };
    let copied = convert(Box::new(Long::new()), &path);
    convert(open(&path).unwrap(), &path.with_extension("back.h5"));
    println!("\nrows {} held {}", copied.rows, peak_kib().unwrap() - before);
}

#[cfg(target_os = "linux")]
#[test]
fn a_copy_holds_pieces_of_an_episode_and_never_all_of_it() {
    let folder = tempfile::tempdir().unwrap();
    for format in FORMATS {
        let path = folder.path().join("long").with_extension(format.extensions[0]);
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "streams::copy_a_long_episode", "--nocapture"]).env(TARGET, &path);
        let output = command.output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        let line = text.lines().find_map(|line| line.strip_prefix("rows ")).expect("the copy ended");
        let (rows, held) = line.split_once(" held ").unwrap();
        assert_eq!(rows.parse::<usize>().unwrap(), Long::new().episode_len(0));
        let held: u64 = held.parse().unwrap();
        assert!(held < MAX_HELD_KIB, "{}: {} MiB were held", format.name, held >> 10);
        eprintln!("{}: {} MiB held", format.name, held >> 10);
    }
}

#[test]
fn an_episode_in_pieces_is_the_same_episode() {
    let folder = tempfile::tempdir().unwrap();
    let schema = schema();
    let whole = episode(&schema, 3, 97);
    for format in FORMATS {
        let [one, many] =
            ["one", "many"].map(|name| folder.path().join(name).with_extension(format.extensions[0]));
        let mut writer = create(&one, WriteMode::Error, None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        writer.write_episode(&whole).unwrap();
        writer.finish().unwrap();
        let mut writer = create(&many, WriteMode::Error, None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        for rows in [0..1, 1..44, 44..45, 45..97] {
            writer.write_rows(&part(&whole, rows)).unwrap();
        }
        assert_eq!(writer.num_episodes(), 0);
        writer.end_episode().unwrap();
        assert_eq!(writer.num_episodes(), 1);
        writer.finish().unwrap();
        let (one, many) = (contents(&one), contents(&many));
        assert_eq!((one.len(), many.len()), (1, 1), "{}", format.name);
        assert_same(&one[0], &many[0]);
    }
}

#[test]
fn what_was_not_ended_is_not_seen() {
    let folder = tempfile::tempdir().unwrap();
    let schema = schema();
    for format in FORMATS {
        let path = folder.path().join("data").with_extension(format.extensions[0]);
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        writer.write_episode(&episode(&schema, 0, 5)).unwrap();
        writer.write_rows(&episode(&schema, 1, 7)).unwrap();
        let message = writer.write_episode(&episode(&schema, 1, 7)).unwrap_err().to_string();
        assert!(message.contains("another episode is open"), "{message}");
        let message = writer.finish().unwrap_err().to_string();
        assert!(message.contains("not ended") && message.contains('1'), "{message}");
        drop(writer);
        assert_eq!(contents(&path).len(), 1, "{}", format.name);
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        assert_eq!(writer.begin(&schema, &metadata()).unwrap(), 1);
        assert!(writer.end_episode().unwrap_err().to_string().contains("without rows"));
        writer.write_episode(&episode(&schema, 1, 9)).unwrap();
        writer.finish().unwrap();
        assert_eq!(contents(&path)[1].rows(), 9, "{}", format.name);
    }
}

/// Some rows of a table.
fn part(whole: &Batch, rows: std::ops::Range<usize>) -> Batch {
    let mut part = Batch::new(whole.schema().clone(), rows.len());
    for (column, field) in whole.schema().clone().fields().iter().enumerate() {
        let values = whole.column(column).range(rows.start * field.dim(), rows.len() * field.dim());
        assert!(part.column_mut(column).copy_from(values));
    }
    part
}
