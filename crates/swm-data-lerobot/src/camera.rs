//! The images of a camera: the frame of its video that is shown at the time of a row, as LeRobot finds them.
//!
//! Counting would give other images: videos hide images by an edit list, lack some, and hold those of several episodes with gaps between.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use swm_core::Column;
use swm_data::dataset::Steps;
use swm_data::error::{At as _, Result, invalid, missing, wrong_type};
use swm_media::mp4::Mp4Reader;

use super::contents::video;

/// How far the time of a frame may be from that of its row, in seconds: LeRobot's `tolerance_s`.
const TOLERANCE: f64 = 1e-4;

/// Times of rows in seconds since the beginning of their episode, in LeRobot's tables.
pub(super) const TIMESTAMP: &str = "timestamp";

/// When the rows of an episode are, in seconds since its beginning.
pub(super) enum Times<'a> {
    /// The column [`TIMESTAMP`] of its table, and the row of it at which the episode begins.
    Table(&'a Column, usize),
    /// Without that column: rows per second.
    Rate(f64),
}

impl Times<'_> {
    fn of(&self, row: usize) -> Result<f64> {
        let at = |first: usize| first.checked_add(row);
        let time = match self {
            Self::Rate(rate) => Some(row as f64 / rate),
            Self::Table(Column::F32(times), first) => {
                at(*first).and_then(|at| times.get(at)).map(|&time| f64::from(time))
            }
            Self::Table(Column::F64(times), first) => at(*first).and_then(|at| times.get(at)).copied(),
            Self::Table(other, _) => return Err(wrong_type(format!("`timestamp` holds {}", other.dtype()))),
        };
        time.filter(|time| time.is_finite()).ok_or_else(|| missing(format!("row {row} has no `timestamp`")))
    }
}

/// An open video of a camera.
pub(super) struct Camera {
    path: PathBuf,
    video: Mp4Reader<BufReader<File>>,
    /// The frames of the rows that are being read.
    frames: Vec<usize>,
}

impl Camera {
    pub(super) fn open(path: &Path) -> Result<Self> {
        Ok(Self { path: path.to_owned(), video: video(path)?, frames: Vec::new() })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn size(&self) -> (usize, usize) {
        self.video.size()
    }

    /// Reads rows of an episode into `out`, `[steps.count, H, W, 3]`. The episode begins at some seconds in the video; without, row n is
    /// frame n.
    pub(super) fn read(
        &mut self,
        begin: Option<(f64, &Times<'_>)>,
        steps: Steps,
        out: &mut [u8],
    ) -> Result<()> {
        let Some((begin, times)) = begin else {
            return self.video.read(steps.first, steps.stride, out).at(self.path.display());
        };
        let mut frames = std::mem::take(&mut self.frames);
        frames.clear();
        for at in 0..steps.count {
            let row = steps.first + at * steps.stride;
            let frame = times.of(row).and_then(|time| self.frame(row, begin + time));
            frames.push(frame.at(self.path.display())?);
        }
        let read = self.video.read_each(&|at| frames.get(at).copied().unwrap_or(usize::MAX), out);
        self.frames = frames;
        read.at(self.path.display())
    }

    fn frame(&self, row: usize, time: f64) -> Result<usize> {
        let frame = self.video.nearest(time);
        let Some((frame, shown)) = frame.and_then(|frame| Some((frame, self.video.time(frame)?))) else {
            return Err(missing("it shows no image"));
        };
        // Times of rows have 24 bits.
        let tolerance = TOLERANCE.max(4.0 * f64::from(f32::EPSILON) * time.abs());
        match (shown - time).abs() <= tolerance {
            true => Ok(frame),
            false => Err(invalid(format!(
                "row {row} is at {time:.4} s, and the nearest image is shown at {shown:.4} s; LeRobot allows {TOLERANCE} s"
            ))),
        }
    }
}
