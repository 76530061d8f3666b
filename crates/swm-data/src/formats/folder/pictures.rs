//! Columns of pictures: one JPEG file per row, or one H.264 film per episode. The values in between are `[H, W, C]`
//! with C being 1 or 3.

use std::fs;
#[cfg(feature = "video")]
use std::fs::File;
use std::io::ErrorKind;
#[cfg(feature = "video")]
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};

use crc32fast::Hasher;
use rayon::prelude::*;
use swm_core::{Dtype, Field};
use swm_media::jpeg;
#[cfg(feature = "video")]
use swm_media::mp4::{self, Mp4Reader};

use crate::dataset::{Steps, WriteOptions};
#[cfg(feature = "video")]
use crate::formats::film::encoding;

/// Quality of JPEG files if none is asked for.
const JPEG_QUALITY: u8 = 95;

/// How pictures are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Store {
    /// `ep_<i>_step_<j>.jpeg`.
    Jpeg,
    /// `ep_<i>.mp4`.
    #[cfg(feature = "video")]
    Film,
}

impl Store {
    /// Whether a column's rows are pictures that this store takes; other columns become arrays.
    pub(super) fn takes(self, field: &Field) -> bool {
        let (Dtype::U8, &[height, width, 1 | 3]) = (field.dtype, &field.shape[..]) else { return false };
        match self {
            Self::Jpeg => height.max(width) <= 16_384,
            #[cfg(feature = "video")]
            Self::Film => height.min(width) >= mp4::SIDES[0] && height.max(width) <= mp4::SIDES[1],
        }
    }

    /// Writes the rows of an episode, `[T, H, W, C]`, and returns the checksum of its files.
    pub(super) fn write(
        self,
        folder: &Path,
        episode: u64,
        field: &Field,
        rows: &[u8],
        options: &WriteOptions,
    ) -> Result<u32, String> {
        let &[height, width, channels] = &field.shape[..] else { return Err("no pictures".to_owned()) };
        let frames: Vec<&[u8]> = rows.chunks_exact(height * width * channels).collect();
        match self {
            Self::Jpeg => write_jpegs(folder, episode, [height, width, channels], &frames, options),
            #[cfg(feature = "video")]
            Self::Film => {
                let encoding = encoding(options);
                let film = if channels == 1 {
                    let colours: Vec<Vec<u8>> = frames
                        .iter()
                        .map(|frame| frame.iter().flat_map(|&grey| [grey; 3]).collect())
                        .collect();
                    mp4::encode_frames(colours.iter().map(Vec::as_slice), height, width, &encoding)
                } else {
                    mp4::encode_frames(frames.iter().copied(), height, width, &encoding)
                };
                let film = film.map_err(|error| error.to_string())?;
                let path = film_path(folder, episode);
                fs::write(&path, &film).map_err(|error| format!("{}: {error}", path.display()))?;
                Ok(crc32fast::hash(&film))
            }
        }
    }

    /// The shape of the pictures in the files of another program.
    pub(super) fn shape(self, folder: &Path, episode: u64) -> Result<[usize; 3], String> {
        match self {
            Self::Jpeg => {
                let (bytes, _) = read_jpeg(folder, episode, 0)?;
                jpeg::shape(&bytes).map_err(|error| error.to_string())
            }
            #[cfg(feature = "video")]
            Self::Film => {
                let (height, width) = open_film(&film_path(folder, episode))?.size();
                Ok([height, width, 3])
            }
        }
    }

    /// The checksum of an episode's files.
    pub(super) fn checksum(self, folder: &Path, episode: u64, rows: usize) -> Result<u32, String> {
        match self {
            Self::Jpeg => {
                let mut checksum = Hasher::new();
                for row in 0..rows {
                    checksum.update(&read_jpeg(folder, episode, row)?.0);
                }
                Ok(checksum.finalize())
            }
            #[cfg(feature = "video")]
            Self::Film => {
                let path = film_path(folder, episode);
                fs::read(&path)
                    .map(|bytes| crc32fast::hash(&bytes))
                    .map_err(|e| format!("{}: {e}", path.display()))
            }
        }
    }

    /// Removes the files of episodes from `first` on: what an interrupted recording left.
    pub(super) fn forget(self, folder: &Path, first: u64) -> std::io::Result<()> {
        files_from(folder, first)?.into_iter().try_for_each(fs::remove_file)
    }

    /// The number of files of episodes from `first` on.
    pub(super) fn leftovers(self, folder: &Path, first: u64) -> std::io::Result<usize> {
        Ok(files_from(folder, first)?.len())
    }
}

/// The files `ep_<i>…` with i at least `first`.
fn files_from(folder: &Path, first: u64) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| name.strip_prefix("ep_")).and_then(|rest| {
            let end = rest.find(|c: char| !c.is_ascii_digit())?;
            rest[..end].parse::<u64>().ok()
        });
        if number.is_some_and(|episode| episode >= first) {
            files.push(entry.path());
        }
    }
    Ok(files)
}

/// Reads pictures; keeps what the next rows of the same episode need.
#[derive(Debug, Default)]
pub(super) struct PictureReader {
    #[cfg(feature = "video")]
    film: Option<(PathBuf, Mp4Reader<Cursor<Vec<u8>>>)>,
    #[cfg(feature = "video")]
    colours: Vec<u8>,
}

impl PictureReader {
    /// Reads rows of an episode into `out`, `[steps.count, H, W, C]`. A `checksum` guards the decoder of films.
    pub(super) fn read(
        &mut self,
        store: Store,
        folder: &Path,
        episode: u64,
        (field, steps): (&Field, Steps),
        #[cfg_attr(
            not(feature = "video"),
            expect(unused_variables, reason = "no films, no decoder to guard")
        )]
        checksum: Option<u32>,
        out: &mut [u8],
    ) -> Result<(), String> {
        let &[height, width, channels] = &field.shape[..] else { return Err("no pictures".to_owned()) };
        match store {
            Store::Jpeg => {
                for (at, frame) in out.chunks_exact_mut(height * width * channels).enumerate() {
                    let (bytes, path) = read_jpeg(folder, episode, steps.first + at * steps.stride)?;
                    let decoded = jpeg::decode_into(&bytes, [height, width, channels], frame);
                    decoded.map_err(|error| format!("{}: {error}", path.display()))?;
                }
                Ok(())
            }
            #[cfg(feature = "video")]
            Store::Film => {
                let path = film_path(folder, episode);
                if self.film.as_ref().is_none_or(|(open, _)| *open != path) {
                    self.film = None;
                    let bytes = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
                    if checksum.is_some_and(|checksum| checksum != crc32fast::hash(&bytes)) {
                        return Err(format!(
                            "{}: its checksum is wrong, the file was changed",
                            path.display()
                        ));
                    }
                    let film = Mp4Reader::new(Cursor::new(bytes));
                    let film = film.map_err(|error| format!("{}: {error}", path.display()))?;
                    self.film = Some((path.clone(), film));
                }
                let Some((_, film)) = &mut self.film else { return Ok(()) };
                let (found, expected) = (film.size(), (height, width));
                // Odd sides were grown by one pixel.
                if (found.0 & !1, found.1 & !1) != ((expected.0 + 1) & !1, (expected.1 + 1) & !1) {
                    return Err(format!(
                        "{}: it has pictures of {found:?}, not {expected:?}",
                        path.display()
                    ));
                }
                if channels == 3 && found == expected {
                    let read = film.read(steps.first, steps.stride, out);
                    return read.map_err(|error| format!("{}: {error}", path.display()));
                }
                self.colours.resize(steps.count * found.0 * found.1 * 3, 0);
                let read = film.read(steps.first, steps.stride, &mut self.colours);
                read.map_err(|error| format!("{}: {error}", path.display()))?;
                let frames = self.colours.chunks_exact(found.0 * found.1 * 3);
                for (out, frame) in out.chunks_exact_mut(height * width * channels).zip(frames) {
                    for (out, row) in
                        out.chunks_exact_mut(width * channels).zip(frame.chunks_exact(found.1 * 3))
                    {
                        if channels == 3 {
                            out.copy_from_slice(&row[..width * 3]);
                        } else {
                            out.iter_mut()
                                .zip(row.iter().skip(1).step_by(3))
                                .for_each(|(out, &grey)| *out = grey);
                        }
                    }
                }
                Ok(())
            }
        }
    }
}

/// Pictures that equal the one before are links to its file, where the file system has links: a goal costs one file.
fn write_jpegs(
    folder: &Path,
    episode: u64,
    [height, width, channels]: [usize; 3],
    frames: &[&[u8]],
    options: &WriteOptions,
) -> Result<u32, String> {
    let quality = options.quality.unwrap_or(JPEG_QUALITY);
    let same = |row: usize| row > 0 && frames[row] == frames[row - 1];
    let encode = |row: usize| {
        if same(row) {
            return Ok(Vec::new());
        }
        jpeg::encode(height, width, channels, frames[row], quality).map_err(|error| error.to_string())
    };
    let files: Vec<Vec<u8>> = (0..frames.len()).into_par_iter().map(encode).collect::<Result<_, _>>()?;
    let (mut checksum, mut last) = (Hasher::new(), 0);
    for row in 0..files.len() {
        let path = jpeg_path(folder, episode, row, "jpeg");
        let failed = |error: std::io::Error| format!("{}: {error}", path.display());
        if same(row) {
            // What an interrupted recording left.
            match fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(error)),
                _ => {}
            }
            let linked = fs::hard_link(jpeg_path(folder, episode, last, "jpeg"), &path);
            linked.or_else(|_| fs::write(&path, &files[last])).map_err(failed)?;
        } else {
            last = row;
            fs::write(&path, &files[row]).map_err(failed)?;
        }
        checksum.update(&files[last]);
    }
    Ok(checksum.finalize())
}

fn jpeg_path(folder: &Path, episode: u64, row: usize, extension: &str) -> PathBuf {
    folder.join(format!("ep_{episode}_step_{row}.{extension}"))
}

fn read_jpeg(folder: &Path, episode: u64, row: usize) -> Result<(Vec<u8>, PathBuf), String> {
    let path = jpeg_path(folder, episode, row, "jpeg");
    match fs::read(&path) {
        Ok(bytes) => Ok((bytes, path)),
        Err(error) => {
            let other = jpeg_path(folder, episode, row, "jpg");
            fs::read(&other).map(|bytes| (bytes, other)).map_err(|_| format!("{}: {error}", path.display()))
        }
    }
}

#[cfg(feature = "video")]
fn film_path(folder: &Path, episode: u64) -> PathBuf {
    folder.join(format!("ep_{episode}.mp4"))
}

#[cfg(feature = "video")]
fn open_film(path: &Path) -> Result<Mp4Reader<BufReader<File>>, String> {
    let file = File::open(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Mp4Reader::new(BufReader::new(file)).map_err(|error| format!("{}: {error}", path.display()))
}
