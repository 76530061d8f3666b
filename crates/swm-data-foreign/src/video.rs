//! A video for each episode.

use std::path::PathBuf;

use swm_data::error::Result;

use super::array::Shared;

/// The videos of episodes of so many rows, opened one by one when they are read; the first is opened now.
#[cfg(not(feature = "video"))]
pub(super) fn files(_files: impl Iterator<Item = (PathBuf, usize)>) -> Result<Vec<Shared>> {
    Err(swm_data::error::unsupported(
        "its images are videos, which this build does not read; build it with the feature `video`",
    ))
}

#[cfg(feature = "video")]
pub(super) use mp4::files;

#[cfg(feature = "video")]
mod mp4 {
    use std::fs::File;
    use std::io::BufReader;
    use std::sync::Arc;

    use swm_core::{Dtype, SliceMut};
    use swm_data::dataset::Steps;
    use swm_data::error::{At as _, invalid, wrong_type};
    use swm_files::open_regular;
    use swm_media::mp4::Mp4Reader;

    use super::*;
    use crate::array::{Array, Scratch, new_key};

    /// A video may show so many frames more than the episode has rows: encoders and cutters leave one.
    const SPARE_FRAMES: usize = 1;

    /// The videos of episodes of so many rows, opened one by one when they are read; the first is opened now.
    pub(crate) fn files(files: impl Iterator<Item = (PathBuf, usize)>) -> Result<Vec<Shared>> {
        let mut size = None;
        let mut arrays: Vec<Shared> = Vec::new();
        for (path, rows) in files {
            let [height, width] = match size {
                Some(size) => size,
                None => {
                    let (height, width) = reader(&path)?.size();
                    *size.insert([height, width])
                }
            };
            arrays.push(Arc::new(Video { path, key: new_key(), rows, shape: [height, width, 3] }));
        }
        Ok(arrays)
    }

    type Reader = Mp4Reader<BufReader<File>>;

    fn reader(path: &std::path::Path) -> Result<Reader> {
        Ok(Mp4Reader::new(BufReader::new(open_regular(path)?))?)
    }

    #[derive(Debug)]
    struct Video {
        path: PathBuf,
        key: usize,
        rows: usize,
        shape: [usize; 3],
    }

    impl Array for Video {
        fn dtype(&self) -> Dtype {
            Dtype::U8
        }

        fn rows(&self) -> usize {
            self.rows
        }

        fn shape(&self) -> &[usize] {
            &self.shape
        }

        fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
            let SliceMut::U8(out) = out else { return Err(wrong_type("images hold bytes")) };
            let open = |_: &mut Scratch| {
                let video = reader(&self.path)?;
                let (frames, (height, width)) = (video.frames(), video.size());
                if frames < self.rows || frames > self.rows + SPARE_FRAMES {
                    return Err(invalid(format!(
                        "it shows {frames} frames, and the episode has {} rows",
                        self.rows
                    )));
                }
                if [height, width, 3] != self.shape {
                    return Err(invalid(format!(
                        "its frames are {height}x{width}, unlike in the first episode"
                    )));
                }
                // What a decoder keeps: some frames.
                Ok((video, 16 * self.dim()))
            };
            let video: &mut Reader = scratch.part((self.key, 0), open).at(self.path.display())?;
            video.read(rows.first, rows.stride, out).at(self.path.display())
        }
    }
}
