//! The file formats, by name; how each is written stands in its own module.

use std::fmt;

/// A file format for images or videos.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// An image, without loss.
    Png,
    /// A video of at most 256 colors a frame.
    Gif,
    /// An H.264 video.
    Mp4,
    /// An image with loss; of datasets, not of clips.
    #[cfg(feature = "jpeg")]
    Jpeg,
}

impl Format {
    /// All formats that a clip can be saved in.
    pub const ALL: [Self; 3] = [Self::Png, Self::Gif, Self::Mp4];

    /// The extension without its dot: `gif`.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Gif => "gif",
            Self::Mp4 => "mp4",
            #[cfg(feature = "jpeg")]
            Self::Jpeg => "jpeg",
        }
    }

    /// Whether this build can write it; all but [`Format::Mp4`] always can.
    pub const fn is_built(self) -> bool {
        !matches!(self, Self::Mp4) || cfg!(feature = "mp4")
    }

    /// The extensions for an error message: `*.png, *.gif, *.mp4`.
    pub(crate) fn known() -> String {
        Self::ALL.map(|format| format!("*.{}", format.extension())).join(", ")
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Png => "PNG",
            Self::Gif => "GIF",
            Self::Mp4 => "MP4",
            #[cfg(feature = "jpeg")]
            Self::Jpeg => "JPEG",
        })
    }
}
