//! A dataset as a folder: numpy archives, and images as JPEG files (`folder`) or H.264 videos (`video`), in the layout
//! of the reference, which reads our folders and whose folders are read here. For the layout see `layout`; how a
//! recording survives a crash, see `writer`.

mod image_writer;
mod images;
mod layout;
mod reader;
mod repair;
mod writer;

use std::path::Path;

use crate::entry::{Format, StoredImages};
use crate::recording::BackendWriter;
use images::Store;
use writer::FolderBackend;

/// The entry of single images in the table of formats.
pub(crate) const FOLDER: Format = Format::new(
    "folder",
    "a folder of numpy arrays and JPEG images; any tool opens it; lossy images",
    |path| is_dataset(path) && !has_videos(path),
    |path| Ok(Box::new(reader::FolderDataset::open(path, FOLDER.name, Store::Jpeg)?)),
)
.extensions(&["folder"])
.images(StoredImages::Lossy)
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, storage(&FOLDER, Store::Jpeg))?)))
.repairer(|path, apply| repair::repair(path, FOLDER.name, Store::Jpeg, apply));

/// The entry of videos in the table of formats.
#[cfg(feature = "video")]
pub(crate) const VIDEO: Format = Format::new(
    "video",
    "a folder of numpy arrays and H.264 videos; the smallest, plays in any player; lossy images",
    |path| is_dataset(path) && has_videos(path),
    |path| Ok(Box::new(reader::FolderDataset::open(path, VIDEO.name, Store::Video)?)),
)
.extensions(&["video"])
.images(StoredImages::Video)
.writer(|path, options| Ok(Box::new(BackendWriter::new(path, options, storage(&VIDEO, Store::Video))?)))
.repairer(|path, apply| repair::repair(path, VIDEO.name, Store::Video, apply));

fn storage(format: &Format, store: Store) -> FolderBackend {
    FolderBackend { format: format.name, store }
}

/// Either file may be gone after an incomplete copy, which is then told by its name.
fn is_dataset(path: &Path) -> bool {
    path.is_dir()
        && [layout::MANIFEST, "ep_len.npz", "ep_offset.npz"].iter().any(|name| path.join(name).is_file())
}

/// Whether the folder says so, or a subfolder holds a video.
fn has_videos(path: &Path) -> bool {
    if let Ok(Some(manifest)) = layout::Manifest::read(path) {
        return manifest.format == "video";
    }
    let folders = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    folders.filter(|path| path.is_dir()).any(|folder| {
        let mut files = std::fs::read_dir(folder).into_iter().flatten().flatten();
        files.any(|file| file.path().extension().is_some_and(|extension| extension == "mp4"))
    })
}
