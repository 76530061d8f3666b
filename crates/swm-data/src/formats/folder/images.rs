//! Columns of images: one JPEG file per row, or one H.264 video per episode. The values in between are `[H, W, C]`
//! with C being 1 or 3. Reading, and what files there are; writing is `image_writer`.

use std::fs;
#[cfg(feature = "video")]
use std::fs::File;
#[cfg(feature = "video")]
use std::io::BufReader;
use std::path::{Path, PathBuf};

use crc32fast::Hasher;
use swm_core::{Dtype, Field};
#[cfg(feature = "video")]
use swm_files::open_regular;
use swm_files::read_regular;
use swm_media::jpeg;
#[cfg(feature = "video")]
use swm_media::mp4::Mp4Reader;

use crate::dataset::Steps;
#[cfg(feature = "video")]
use crate::error::invalid;
use crate::error::{At as _, Result, wrong_type};
#[cfg(feature = "video")]
use crate::video::{self, VideoReader};

/// How images are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Store {
    /// `ep_<i>_step_<j>.jpeg`.
    Jpeg,
    /// `ep_<i>.mp4`.
    #[cfg(feature = "video")]
    Video,
}

impl Store {
    /// Whether a column's rows are images that this store takes; other columns become arrays.
    pub(super) fn takes(self, field: &Field) -> bool {
        let (Dtype::U8, &[height, width, 1 | 3]) = (field.dtype, &field.shape[..]) else { return false };
        match self {
            Self::Jpeg => height.max(width) <= 16_384,
            #[cfg(feature = "video")]
            Self::Video => video::takes(field),
        }
    }

    /// The shape of the images in the files of another program.
    pub(super) fn shape(self, folder: &Path, episode: u64) -> Result<[usize; 3]> {
        match self {
            Self::Jpeg => {
                let (bytes, _) = read_jpeg(folder, episode, 0)?;
                Ok(jpeg::shape(&bytes)?)
            }
            #[cfg(feature = "video")]
            Self::Video => {
                let (height, width) = open_video(&video_path(folder, episode))?.size();
                Ok([height, width, 3])
            }
        }
    }

    /// The checksum of an episode's files.
    pub(super) fn checksum(self, folder: &Path, episode: u64, rows: usize) -> Result<u32> {
        match self {
            Self::Jpeg => {
                let mut checksum = Hasher::new();
                for row in 0..rows {
                    checksum.update(&read_jpeg(folder, episode, row)?.0);
                }
                Ok(checksum.finalize())
            }
            #[cfg(feature = "video")]
            Self::Video => {
                let path = video_path(folder, episode);
                Ok(crc32fast::hash(&read_regular(&path).at(path.display())?))
            }
        }
    }

    /// Removes the files of episodes from `first` on: what an interrupted recording left.
    pub(super) fn forget(self, folder: &Path, first: u64) -> std::io::Result<()> {
        files_from(folder, first)?.into_iter().try_for_each(fs::remove_file)
    }

    /// The number of files of episodes from `first` on; none in the folder of another dataset.
    pub(super) fn leftovers(self, folder: &Path, first: u64) -> std::io::Result<usize> {
        if fs::symlink_metadata(folder)?.is_symlink() {
            return Ok(0);
        }
        Ok(files_from(folder, first)?.len())
    }
}

/// The episode of an image or video, by its name.
fn episode_of(name: &str) -> Option<u64> {
    let (stem, extension) = name.strip_prefix("ep_")?.rsplit_once('.')?;
    let episode = match (extension, stem.split_once("_step_")) {
        ("jpeg" | "jpg", Some((episode, row))) if row.parse::<u64>().is_ok() => episode,
        ("mp4", None) => stem,
        _ => return None,
    };
    episode.parse().ok()
}

/// The images and videos of episodes from `first` on.
fn files_from(folder: &Path, first: u64) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_str().and_then(episode_of).is_some_and(|episode| episode >= first) {
            files.push(entry.path());
        }
    }
    Ok(files)
}

/// Reads images; keeps what the next rows of the same episode need.
#[derive(Debug, Default)]
pub(super) struct ImageReader {
    #[cfg(feature = "video")]
    video: Option<(PathBuf, VideoReader)>,
}

impl ImageReader {
    /// Reads rows of an episode into `out`, `[steps.count, H, W, C]`. A `checksum` guards the decoder of videos.
    pub(super) fn read(
        &mut self,
        store: Store,
        folder: &Path,
        episode: u64,
        (field, steps): (&Field, Steps),
        #[cfg_attr(
            not(feature = "video"),
            expect(unused_variables, reason = "no videos, no decoder to guard")
        )]
        checksum: Option<u32>,
        out: &mut [u8],
    ) -> Result<()> {
        let &[height, width, channels] = &field.shape[..] else { return Err(wrong_type("no images")) };
        match store {
            Store::Jpeg => {
                for (at, frame) in out.chunks_exact_mut(height * width * channels).enumerate() {
                    let (bytes, path) = read_jpeg(folder, episode, steps.first + at * steps.stride)?;
                    jpeg::decode_into(&bytes, [height, width, channels], frame).at(path.display())?;
                }
                Ok(())
            }
            #[cfg(feature = "video")]
            Store::Video => {
                let path = video_path(folder, episode);
                if self.video.as_ref().is_none_or(|(open, _)| *open != path) {
                    self.video = None;
                    let bytes = read_regular(&path).at(path.display())?;
                    if checksum.is_some_and(|checksum| checksum != crc32fast::hash(&bytes)) {
                        let changed = invalid("its checksum is wrong, the file was changed");
                        return Err(changed.at(path.display()));
                    }
                    self.video = Some((path.clone(), VideoReader::new(bytes).at(path.display())?));
                }
                let Some((_, video)) = &mut self.video else { return Ok(()) };
                video.read([height, width, channels], steps, out).at(path.display())
            }
        }
    }
}

pub(super) fn jpeg_path(folder: &Path, episode: u64, row: usize, extension: &str) -> PathBuf {
    folder.join(format!("ep_{episode}_step_{row}.{extension}"))
}

fn read_jpeg(folder: &Path, episode: u64, row: usize) -> Result<(Vec<u8>, PathBuf)> {
    let path = jpeg_path(folder, episode, row, "jpeg");
    match read_regular(&path) {
        Ok(bytes) => Ok((bytes, path)),
        Err(error) => {
            let other = jpeg_path(folder, episode, row, "jpg");
            read_regular(&other).map(|bytes| (bytes, other)).map_err(|_| error).at(path.display())
        }
    }
}

#[cfg(feature = "video")]
pub(super) fn video_path(folder: &Path, episode: u64) -> PathBuf {
    folder.join(format!("ep_{episode}.mp4"))
}

#[cfg(feature = "video")]
fn open_video(path: &Path) -> Result<Mp4Reader<BufReader<File>>> {
    let file = open_regular(path).at(path.display())?;
    Mp4Reader::new(BufReader::new(file)).at(path.display())
}
