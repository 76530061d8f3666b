//! What lies at an address, and what is open of it in this process.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError, Weak};

use sha2::{Digest as _, Sha256};
use swm_core::dataset::DataError;

use super::address::Address;
use super::blocks::Blocks;
use super::client::{Auth, Client, Link};
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::folder::Folder;
use super::hub::Repository;
use super::list;
use super::object::Object;
use super::s3;
use super::settings::Settings;
use super::sign::hex;

/// Everything that lies elsewhere, with what is set for it.
#[derive(Debug)]
pub struct Remote {
    pub(super) client: Client,
    pub(super) blocks: Blocks,
}

/// What lies at an address.
#[derive(Clone, Debug)]
pub enum Found {
    /// One object, or file.
    Object(Arc<Object>),
    /// A folder of them.
    Folder(Arc<Folder>),
}

/// What is open, by its path: all that read it read the same version.
#[derive(Debug)]
enum Open {
    Object(Weak<Object>),
    Folder(Weak<Folder>),
}

static OPEN: LazyLock<Mutex<HashMap<PathBuf, Open>>> = LazyLock::new(Mutex::default);

/// What is open at a path.
fn opened(path: &Path) -> Option<Found> {
    let open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    match open.get(path)? {
        Open::Object(object) => object.upgrade().map(Found::Object),
        Open::Folder(folder) => folder.upgrade().map(Found::Folder),
    }
}

/// The folder of objects that is open at a path, for readers of formats and layouts: its files are read one by one.
#[must_use]
pub fn folder(path: &Path) -> Option<Arc<Folder>> {
    match opened(path)? {
        Found::Folder(folder) => Some(folder),
        Found::Object(_) => None,
    }
}

/// Extensions of folders, whose names look like those of files.
const FOLDERS: [&str; 6] = ["zarr", "lerobot", "folder", "video", "lance", "lance-video"];

impl Remote {
    pub(super) fn new(settings: Settings) -> Result<Arc<Self>, RemoteError> {
        let blocks = Blocks::new(settings.cache.as_deref(), settings.cache_bytes);
        Ok(Arc::new(Self { client: Client::new(settings)?, blocks }))
    }

    /// As the variables of this process set it.
    ///
    /// # Errors
    ///
    /// What they name cannot be used: a file of certificates.
    pub fn global() -> Result<Arc<Self>, RemoteError> {
        static GLOBAL: OnceLock<Result<Arc<Remote>, RemoteError>> = OnceLock::new();
        GLOBAL.get_or_init(|| Self::new(Settings::from_environment())).clone()
    }

    /// How an address is asked for. One of the Hub has a commit.
    pub(super) fn link(&self, address: &Address) -> Result<Link, RemoteError> {
        match address {
            Address::Http { url, plain } => {
                Ok(Link { name: plain.clone(), url: url.clone(), auth: Auth::None })
            }
            Address::S3 { bucket, key } => Ok(s3::object(&self.client.settings.s3, bucket, key)),
            Address::Hub { repo, revision, path } => {
                let name = address.name();
                Repository::at(&self.client, &name, repo, revision.as_deref())?.file(
                    &self.client,
                    &name,
                    path,
                )
            }
        }
    }

    /// What lies at a path, and the path that names it without a query: what is open there, or else found now. All that read it then read this
    /// version, as long as it is open.
    ///
    /// # Errors
    ///
    /// The path is no address, or its server cannot be reached, lacks it or denies it.
    pub fn open(self: &Arc<Self>, path: &Path) -> Result<(PathBuf, Found), RemoteError> {
        let address = Address::of(path)?;
        let path = PathBuf::from(address.name());
        let found = match opened(&path) {
            Some(found) => found,
            None => self.find(&address)?,
        };
        found.remember(&path);
        Ok((path, found))
    }

    /// What lies at an address.
    pub(super) fn find(self: &Arc<Self>, address: &Address) -> Result<Found, RemoteError> {
        match address {
            Address::Http { .. } => match Object::probe(self, self.link(address)?, None) {
                Ok(object) => Ok(Found::Object(Arc::new(object))),
                Err(error) if error.kind == Kind::Missing || error.kind == Kind::Denied => {
                    match Folder::consolidated(self, address)? {
                        Some(folder) => Ok(Found::Folder(Arc::new(folder))),
                        None => Err(error),
                    }
                }
                Err(error) => Err(error),
            },
            Address::S3 { bucket, key } => self.in_bucket(address, bucket, key),
            Address::Hub { repo, revision, path } => self.in_hub(address, repo, revision.as_deref(), path),
        }
    }

    fn in_bucket(self: &Arc<Self>, address: &Address, bucket: &str, key: &str) -> Result<Found, RemoteError> {
        let list = || -> Result<Option<Found>, RemoteError> {
            let files = list::of_bucket(&self.client, bucket, key)?;
            Ok((!files.is_empty())
                .then(|| Found::Folder(Arc::new(Folder::listed(self, address.clone(), files)))))
        };
        if key.is_empty() {
            let empty = || {
                RemoteError::new(Kind::Missing, &address.name(), "the bucket is empty", "check the address")
            };
            return list()?.ok_or_else(empty);
        }
        match Object::probe(self, self.link(address)?, None) {
            Ok(object) => Ok(Found::Object(Arc::new(object))),
            // Who may not list a bucket is denied what is not there.
            Err(error) if error.kind == Kind::Missing || error.kind == Kind::Denied => match list() {
                Ok(Some(folder)) => Ok(folder),
                Err(of_list) if error.kind == Kind::Missing => Err(of_list),
                _ => Err(error),
            },
            Err(error) => Err(error),
        }
    }

    fn in_hub(
        self: &Arc<Self>,
        address: &Address,
        repo: &str,
        revision: Option<&str>,
        path: &str,
    ) -> Result<Found, RemoteError> {
        let name = address.name();
        let repository = Repository::at(&self.client, &name, repo, revision)?;
        let commit = repository.commit.clone();
        let pinned =
            Address::Hub { repo: repo.to_owned(), revision: Some(commit.clone()), path: path.to_owned() };
        let file = || -> Result<Found, RemoteError> {
            let link = repository.file(&self.client, &name, path)?;
            Object::probe(self, link, Some(&commit)).map(|object| Found::Object(Arc::new(object)))
        };
        let folder = || -> Result<Found, RemoteError> {
            let files = repository.files(&self.client, &name, path)?;
            let folder = (!files.is_empty()).then(|| Folder::listed(self, pinned.clone(), files));
            let empty = || RemoteError::new(Kind::Missing, &name, "the folder is empty", "check the address");
            folder.map(|folder| Found::Folder(Arc::new(folder))).ok_or_else(empty)
        };
        let extension = Path::new(path).extension().and_then(|extension| extension.to_str());
        let is_missing = |error: &RemoteError| matches!(error.kind, Kind::Missing | Kind::Answer);
        match (path.is_empty(), extension.is_some_and(|extension| !FOLDERS.contains(&extension))) {
            (true, _) => folder(),
            (false, true) => match file() {
                Err(error) if is_missing(&error) => folder().map_err(|_| error),
                found => found,
            },
            (false, false) => match folder() {
                Err(error) if is_missing(&error) => file(),
                found => found,
            },
        }
    }
}

impl Found {
    /// What is at a path: what is open there, or else found now.
    ///
    /// # Errors
    ///
    /// As of [`Remote::open`].
    pub fn at(path: &Path) -> io::Result<Self> {
        match opened(path) {
            Some(found) => Ok(found),
            None => Ok(Remote::global().and_then(|remote| remote.find(&Address::of(path)?))?),
        }
    }

    /// Lets all that read this path read this version, as long as it is open.
    fn remember(&self, path: &Path) {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|_, open| match open {
            Open::Object(object) => object.strong_count() > 0,
            Open::Folder(folder) => folder.strong_count() > 0,
        });
        let weak = match self {
            Self::Object(object) => Open::Object(Arc::downgrade(object)),
            Self::Folder(folder) => Open::Folder(Arc::downgrade(folder)),
        };
        open.insert(path.to_owned(), weak);
    }

    /// What tells its version from all others; `None` if nothing does.
    pub(super) fn key(&self) -> Option<String> {
        match self {
            Self::Object(object) => object.is_versioned.then(|| object.key.clone()),
            Self::Folder(folder) => folder.key(),
        }
    }
}

/// Where something about what is open at a path is kept, under this name: in the cache. `None`: nothing is open there, nothing tells its
/// versions apart, or there is no cache.
#[must_use]
pub fn side_file(path: &Path, suffix: &str) -> Option<PathBuf> {
    let found = opened(path)?;
    let folder = found.settings().cache.as_ref()?.join("beside");
    std::fs::create_dir_all(&folder).ok()?;
    Some(folder.join(format!("{}{suffix}", found.key()?)))
}

/// A digest of the version of a dataset that lies elsewhere, in place of one of its bytes: SHA-256 of its address, its length and its
/// `ETag` or commit, of every file. Nothing but a few bytes is fetched.
///
/// # Errors
///
/// It cannot be reached, or its server gives nothing that tells versions apart.
pub fn digest(path: &Path) -> Result<String, DataError> {
    version(path).map_err(|error| error.while_trying("read"))
}

fn version(path: &Path) -> Result<String, RemoteError> {
    let found = match opened(path) {
        Some(found) => found,
        None => Remote::global()?.find(&Address::of(path)?)?,
    };
    match found.key() {
        Some(key) => Ok(hex(&Sha256::digest(key))),
        None => Err(RemoteError::new(
            Kind::Answer,
            &Address::of(path)?.name(),
            "its server gives neither an ETag nor a date, by which a version is told",
            "fetch it (`swm fetch`), and use the file",
        )),
    }
}
