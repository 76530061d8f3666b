//! Writing columns of images: one JPEG file per row, or one H.264 video per episode. The other direction is `images`.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

#[cfg(feature = "video")]
use super::images::video_path;
use super::images::{Store, jpeg_path};
use crate::dataset::WriteOptions;
#[cfg(feature = "video")]
use crate::error::missing;
use crate::error::{At as _, Result, wrong_type};
use crate::recording::StepIndex;
#[cfg(feature = "video")]
use crate::video::{VideoWriter, encoding};
use crc32fast::Hasher;
use rayon::prelude::*;
use swm_core::Field;
use swm_files::{sync, write_new};
use swm_media::jpeg;

/// Quality of JPEG files if none is asked for.
const JPEG_QUALITY: u8 = 95;

/// Writes the images of one column, an episode after the other.
pub(super) struct ImageWriter {
    store: Store,
    folder: PathBuf,
    field: Field,
    options: WriteOptions,
    /// The open episode.
    episode: u64,
    /// Its last JPEG file.
    last: Option<Written>,
    /// Files that may not be on the disk yet.
    unsynced: Vec<PathBuf>,
    checksum: Hasher,
    #[cfg(feature = "video")]
    video: Option<VideoWriter>,
}

/// An image, the row that it was written for first, its file.
struct Written {
    pixels: Vec<u8>,
    row: usize,
    file: Vec<u8>,
}

impl ImageWriter {
    /// Writes into `folder`, which exists. The store takes the field.
    pub(super) fn new(store: Store, folder: PathBuf, field: &Field, options: &WriteOptions) -> Self {
        Self {
            store,
            folder,
            field: field.clone(),
            options: options.clone(),
            episode: 0,
            last: None,
            unsynced: Vec::new(),
            checksum: Hasher::new(),
            #[cfg(feature = "video")]
            video: None,
        }
    }

    /// Appends rows to the open episode, `[T, H, W, C]`.
    pub(super) fn append(&mut self, at: StepIndex, rows: &[u8]) -> Result<()> {
        self.episode = at.episode as u64;
        match self.store {
            Store::Jpeg => {
                self.append_jpegs(at.step, &rows.chunks_exact(self.field.dim()).collect::<Vec<_>>())
            }
            #[cfg(feature = "video")]
            Store::Video => {
                let video = match &mut self.video {
                    Some(video) => video,
                    None => self.video.insert(VideoWriter::new(&self.field, &encoding(&self.options))?),
                };
                video.append(rows)
            }
        }
    }

    /// Brings the files of ended episodes to the disk.
    pub(super) fn sync(&mut self) -> Result<()> {
        Ok(sync(&std::mem::take(&mut self.unsynced))?)
    }

    /// Ends the open episode, and returns the checksum of its files.
    pub(super) fn finish(&mut self) -> Result<u32> {
        match self.store {
            Store::Jpeg => {
                self.last = None;
                Ok(std::mem::take(&mut self.checksum).finalize())
            }
            #[cfg(feature = "video")]
            Store::Video => {
                let video = self.video.take().ok_or(missing("a video without frames"))?;
                let bytes = video.finish()?;
                let path = video_path(&self.folder, self.episode);
                write_new(&path, &bytes).at(path.display())?;
                self.unsynced.push(path);
                Ok(crc32fast::hash(&bytes))
            }
        }
    }

    /// Images that equal the one before are links to its file, where the file system has links: a goal costs one file.
    fn append_jpegs(&mut self, first: usize, frames: &[&[u8]]) -> Result<()> {
        let quality = self.options.quality.unwrap_or(JPEG_QUALITY);
        let &[height, width, channels] = &self.field.shape[..] else { return Err(wrong_type("no images")) };
        let before = self.last.as_ref().map(|last| last.pixels.as_slice());
        let same = |index: usize| match index {
            0 => before == Some(frames[0]),
            index => frames[index] == frames[index - 1],
        };
        let encode = |index: usize| {
            if same(index) {
                return Ok(None);
            }
            let file = jpeg::encode(height, width, channels, frames[index], quality);
            file.map(Some)
        };
        let files: Vec<Option<Vec<u8>>> =
            (0..frames.len()).into_par_iter().map(encode).collect::<Result<_, _>>()?;
        let episode = self.episode;
        for (index, file) in files.into_iter().enumerate() {
            let row = first + index;
            let path = jpeg_path(&self.folder, episode, row, "jpeg");
            if let Some(file) = file {
                write_new(&path, &file).at(path.display())?;
                self.unsynced.push(path);
                self.last = Some(Written { pixels: Vec::new(), row, file });
            } else if let Some(last) = &self.last {
                // What an interrupted recording left.
                match fs::remove_file(&path) {
                    Err(error) if error.kind() != ErrorKind::NotFound => Err(error).at(path.display())?,
                    _ => {}
                }
                let linked = fs::hard_link(jpeg_path(&self.folder, episode, last.row, "jpeg"), &path);
                linked.or_else(|_| write_new(&path, &last.file)).at(path.display())?;
            }
            if let Some(last) = &self.last {
                self.checksum.update(&last.file);
            }
        }
        if let (Some(last), Some(frame)) = (&mut self.last, frames.last()) {
            last.pixels = frame.to_vec();
        }
        Ok(())
    }
}
