//! Clips as files: the format that a path names, and the bytes of each.

use std::path::Path;

use crate::clip::Clip;
use crate::error::MediaError;
use crate::format::Format;
#[cfg(feature = "mp4")]
use crate::mp4;
use crate::{file, gif, png, sheet};

/// Columns of white between the frames of a clip saved as one image.
const SHEET_GAP: usize = 4;

impl Format {
    /// The format that the extension of `path` names, in any case.
    ///
    /// # Errors
    ///
    /// [`MediaError::UnknownFormat`], which lists the known extensions.
    pub fn from_path(path: &Path) -> Result<Self, MediaError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        Self::ALL
            .into_iter()
            .find(|format| format.extension().eq_ignore_ascii_case(extension))
            .ok_or_else(|| MediaError::UnknownFormat { path: path.to_owned() })
    }
}

impl Clip {
    /// Saves the clip in the format that the extension of `path` names: `.png`, `.gif` or `.mp4`.
    ///
    /// A PNG of several frames shows them side by side, first to last.
    ///
    /// # Errors
    ///
    /// An empty clip, a frame rate that is no rate, frames that the format cannot hold, an unknown extension, a file
    /// that cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), MediaError> {
        let path = path.as_ref();
        file::write(path, &self.encode(Format::from_path(path)?)?)
    }

    /// The bytes of the file that [`Clip::save`] writes.
    ///
    /// # Errors
    ///
    /// As [`Clip::save`], without those about the file.
    pub fn encode(&self, format: Format) -> Result<Vec<u8>, MediaError> {
        match format {
            Format::Png => self.encode_png(),
            Format::Gif => gif::encode(self),
            #[cfg(feature = "mp4")]
            Format::Mp4 => mp4::encode(self),
            #[cfg(not(feature = "mp4"))]
            Format::Mp4 => Err(MediaError::NotBuilt { format }),
            #[cfg(feature = "jpeg")]
            Format::Jpeg => Err(MediaError::UnknownFormat { path: "clip.jpeg".into() }),
        }
    }

    fn encode_png(&self) -> Result<Vec<u8>, MediaError> {
        let frames: Vec<&[u8]> = self.frames().collect();
        match frames[..] {
            [] => Err(MediaError::EmptyClip),
            [frame] => png::encode(self.height(), self.width(), frame),
            _ => {
                let (height, width, pixels) =
                    sheet::contact_sheet(&[frames], self.height(), self.width(), SHEET_GAP)?;
                png::encode(height, width, &pixels)
            }
        }
    }
}
