//! Where a table is: a folder of this machine, or one that lies elsewhere, whose files are read by position.

use std::fmt;
use std::path::{Path, PathBuf};
#[cfg(feature = "remote")]
use std::sync::Arc;

use swm_data::error::Result;
#[cfg(feature = "remote")]
use swm_files::remote::{self, Folder};
use swm_lance::Table;

use super::of_lance;

/// Where manifests are, and how their names end.
const VERSIONS: &str = "_versions";
const MANIFEST: &str = "manifest";

/// The place of a table that has a manifest.
#[derive(Clone, Debug)]
pub(super) enum Place {
    Here(PathBuf),
    #[cfg(feature = "remote")]
    There(Arc<Folder>),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Here(path) => path.display().fmt(f),
            #[cfg(feature = "remote")]
            Self::There(folder) => f.write_str(&folder.name()),
        }
    }
}

impl Place {
    /// `None`: there is no table.
    pub(super) fn of(path: &Path) -> Option<Self> {
        #[cfg(feature = "remote")]
        if let Some(folder) = remote::folder(path) {
            return Self::there(folder);
        }
        let frames = super::lerobot::frames(path);
        let path = frames.as_deref().unwrap_or(path);
        let names = path.join(VERSIONS).read_dir().into_iter().flatten().flatten();
        let is_manifest = |path: PathBuf| path.extension().is_some_and(|kind| kind == MANIFEST);
        names.map(|entry| entry.path()).any(is_manifest).then(|| Self::Here(path.to_owned()))
    }

    #[cfg(feature = "remote")]
    fn there(folder: Arc<Folder>) -> Option<Self> {
        let is_manifest = |path: &str| path.starts_with(VERSIONS) && path.ends_with(MANIFEST);
        let has_some = folder.names().any(is_manifest);
        has_some.then_some(Self::There(folder))
    }

    pub(super) fn table(&self) -> Result<Table> {
        Ok(match self {
            Self::Here(path) => Table::open(path).map_err(of_lance)?,
            #[cfg(feature = "remote")]
            Self::There(folder) => {
                Table::open_in(Box::new(elsewhere::Files(folder.clone()))).map_err(of_lance)?
            }
        })
    }

    /// A table whose name begins with that of this one, and ends so.
    pub(super) fn beside(&self, ending: &str) -> Result<Option<Self>> {
        match self {
            Self::Here(path) => {
                let stem = path.file_stem().and_then(|stem| stem.to_str());
                Ok(stem.and_then(|stem| Self::of(&path.with_file_name(format!("{stem}{ending}")))))
            }
            #[cfg(feature = "remote")]
            Self::There(folder) => {
                let name = folder.name();
                let stem = name.strip_suffix(".lance").unwrap_or(&name);
                Ok(folder.beside(Path::new(&format!("{stem}{ending}")))?.and_then(Self::there))
            }
        }
    }
}

#[cfg(feature = "remote")]
mod elsewhere {
    use std::io;
    use std::sync::Arc;

    use swm_lance::{Bytes, Store};

    use swm_files::remote::Folder;

    /// The files of a folder that lies elsewhere.
    #[derive(Debug)]
    pub(super) struct Files(pub(super) Arc<Folder>);

    impl Store for Files {
        fn names(&self, folder: &str) -> io::Result<Vec<String>> {
            let names = self.0.names().filter_map(|path| path.strip_prefix(folder)?.strip_prefix('/'));
            Ok(names.map(str::to_owned).collect())
        }

        fn open(&self, path: &str) -> io::Result<Box<dyn Bytes>> {
            let length = self.0.length(path)?.ok_or(io::ErrorKind::NotFound)?;
            Ok(Box::new(File { folder: self.0.clone(), path: path.to_owned(), length }))
        }
    }

    #[derive(Debug)]
    struct File {
        folder: Arc<Folder>,
        path: String,
        length: u64,
    }

    impl Bytes for File {
        fn length(&self) -> u64 {
            self.length
        }

        fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
            let end = at.checked_add(out.len() as u64).ok_or(io::ErrorKind::UnexpectedEof)?;
            let part = self.folder.part(&self.path, |_| Ok::<_, io::Error>(at..end))?;
            out.copy_from_slice(&part.ok_or(io::ErrorKind::NotFound)?);
            Ok(())
        }
    }
}
