//! A dataset as a folder: numpy archives, and pictures as JPEG files (`folder`) or H.264 films (`video`), in the layout
//! of the reference, which reads our folders and whose folders are read here. For the layout see `layout`; how a
//! recording survives a crash, see `writer`.

mod layout;
mod picture_writer;
mod pictures;
mod reader;
mod repair;
mod writer;

use std::path::Path;

use crate::format::Format;
use crate::recording::Recorder;
use pictures::Store;
use writer::FolderStorage;

/// The entry of single pictures in the table of formats.
pub(crate) const FOLDER: Format = Format {
    name: "folder",
    extensions: &["folder"],
    about: "a folder of numpy arrays and JPEG pictures; any tool opens it; lossy pictures",
    detect: |path| is_dataset(path) && !has_films(path),
    open: |path| Ok(Box::new(reader::FolderDataset::open(path, FOLDER.name, Store::Jpeg)?)),
    create: |path, options| Ok(Box::new(Recorder::new(path, options, storage(&FOLDER, Store::Jpeg))?)),
    repair: |path, apply| repair::repair(path, FOLDER.name, Store::Jpeg, apply),
};

/// The entry of films in the table of formats.
#[cfg(feature = "video")]
pub(crate) const VIDEO: Format = Format {
    name: "video",
    extensions: &["video"],
    about: "a folder of numpy arrays and H.264 films; the smallest, plays in any player; lossy pictures",
    detect: |path| is_dataset(path) && has_films(path),
    open: |path| Ok(Box::new(reader::FolderDataset::open(path, VIDEO.name, Store::Film)?)),
    create: |path, options| Ok(Box::new(Recorder::new(path, options, storage(&VIDEO, Store::Film))?)),
    repair: |path, apply| repair::repair(path, VIDEO.name, Store::Film, apply),
};

fn storage(format: &Format, store: Store) -> FolderStorage {
    FolderStorage { format: format.name, store }
}

fn is_dataset(path: &Path) -> bool {
    path.is_dir() && path.join("ep_len.npz").is_file()
}

/// Whether the folder says so, or a subfolder holds a film.
fn has_films(path: &Path) -> bool {
    if let Ok(Some(manifest)) = layout::Manifest::read(path) {
        return manifest.format == "video";
    }
    let folders = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    folders.filter(|path| path.is_dir()).any(|folder| {
        let mut files = std::fs::read_dir(folder).into_iter().flatten().flatten();
        files.any(|file| file.path().extension().is_some_and(|extension| extension == "mp4"))
    })
}
