//! The entries of registries: a format (how a file is recognized, opened, recorded and repaired), and a layout of another program (how
//! it is recognized and opened).

use std::path::Path;

use swm_core::Entry;

use crate::adapt;
use crate::dataset::{Dataset, DatasetWriter, WriteOptions};
use crate::error::DataError;
use crate::open_options::OpenOptions;
use crate::recording;

/// What opening gives: a reader or a writer of whatever format.
pub type Opened<T> = Result<Box<T>, DataError>;

/// Whether the content of an existing file or folder is of a format.
pub type Detect = fn(&Path) -> bool;
/// Opens a dataset for reading.
pub type Open = fn(&Path) -> Opened<dyn Dataset>;
/// Opens a dataset for reading, with options.
pub type OpenWith = fn(&Path, &OpenOptions) -> Opened<dyn Dataset>;
/// Opens a dataset for recording. Takes the file for itself until the writer is dropped; changes nothing before `begin`.
pub type Create = fn(&Path, &WriteOptions) -> Opened<dyn DatasetWriter>;
/// Says what has to be done about a dataset whose recording was interrupted, one line each, and does it if told to.
pub type Repair = fn(&Path, bool) -> Result<Vec<String>, DataError>;

/// How a format keeps images, which says what of [`WriteOptions`] acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StoredImages {
    /// Every pixel as it was.
    Exact,
    /// Each by itself, with loss: `quality` acts.
    Lossy,
    /// As a video, with loss: `quality` and `key_frame_period` act. Such a format is of little use without images.
    Video,
}

/// One way of storing a dataset.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Format {
    /// Its name, as on the command line.
    pub name: &'static str,
    /// One line on what it is good for.
    pub about: &'static str,
    /// File extensions without the dot, the preferred one first.
    pub extensions: &'static [&'static str],
    /// How it keeps images.
    pub images: StoredImages,
    /// Whether it can leave the last row of an episode out of its tables, so that [`WriteOptions::last_row`] acts.
    pub drops_last_row: bool,
    detect: Detect,
    open: Open,
    open_with: Option<OpenWith>,
    create: Create,
    repair: Repair,
}

impl Format {
    /// A format that is read and not written, without file extensions, with exact images.
    pub const fn new(name: &'static str, about: &'static str, detect: Detect, open: Open) -> Self {
        let create: Create =
            |path, _| Err(DataError::request(path, "datasets of this format are read, not written"));
        let (extensions, images): (&[&str], _) = (&[], StoredImages::Exact);
        let repair: Repair = |_, _| Ok(Vec::new());
        let drops_last_row = false;
        Self {
            name,
            about,
            extensions,
            images,
            drops_last_row,
            detect,
            open,
            open_with: None,
            create,
            repair,
        }
    }

    /// Its file extensions without the dot, the preferred one first.
    #[must_use]
    pub const fn extensions(mut self, extensions: &'static [&'static str]) -> Self {
        self.extensions = extensions;
        self
    }

    /// How it keeps images.
    #[must_use]
    pub const fn images(mut self, images: StoredImages) -> Self {
        self.images = images;
        self
    }

    /// It can leave the last row of an episode out of its tables.
    #[must_use]
    pub const fn drops_last_row(mut self) -> Self {
        self.drops_last_row = true;
        self
    }

    /// How it is opened, where more options act than those that name columns, a rate and an environment.
    #[must_use]
    pub const fn opener(mut self, open: OpenWith) -> Self {
        self.open_with = Some(open);
        self
    }

    /// How it is recorded.
    #[must_use]
    pub const fn writer(mut self, create: Create) -> Self {
        self.create = create;
        self
    }

    /// What an interrupted recording needs.
    #[must_use]
    pub const fn repairer(mut self, repair: Repair) -> Self {
        self.repair = repair;
        self
    }

    /// Whether the content of an existing file or folder is of this format.
    pub fn detect(&self, path: &Path) -> bool {
        (self.detect)(path)
    }

    /// Opens a dataset of this format for reading.
    ///
    /// # Errors
    ///
    /// Nothing is there, or it is damaged, of another format, or from a newer version.
    pub fn open(&self, path: &Path) -> Opened<dyn Dataset> {
        (self.open)(path)
    }

    /// As [`Format::open`], with options.
    ///
    /// # Errors
    ///
    /// As of [`Format::open`]; [`DataError::Option`]: an option is wrong, or would not act.
    pub fn open_with(&self, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
        match self.open_with {
            Some(open) => open(path, options),
            None => adapt::opened_with((self.open)(path)?, options, &[]),
        }
    }

    /// Opens a dataset of this format for recording. Takes the file for itself until the writer is dropped; changes
    /// nothing before `begin`.
    ///
    /// # Errors
    ///
    /// An option does not act in this format; something is there that the mode does not allow for, another writer has it, or
    /// the place cannot be written to.
    pub fn create(&self, path: &Path, options: &WriteOptions) -> Opened<dyn DatasetWriter> {
        self.check(options)?;
        (self.create)(path, options)
    }

    /// Refuses options that would not act.
    fn check(&self, options: &WriteOptions) -> Result<(), DataError> {
        let refuse = |option, reason: &str| {
            let reason =
                format!("the format `{}` {reason}; leave it out, or choose another format", self.name);
            Err(DataError::Option { option, reason })
        };
        if options.last_row.is_some() && !self.drops_last_row {
            return refuse("last_row", "has the last row of every episode");
        }
        match self.images {
            StoredImages::Exact if options.quality.is_some() => {
                refuse("quality", "keeps images without loss")
            }
            StoredImages::Exact | StoredImages::Lossy if options.key_frame_period.is_some() => {
                refuse("key_frames", "has no videos")
            }
            _ => Ok(()),
        }
    }

    /// Says what has to be done about a dataset whose recording was interrupted, one line each, and does it if told to
    /// `apply`.
    ///
    /// # Errors
    ///
    /// The dataset is being written, cannot be read, or cannot be repaired; or parts of it are links to other places.
    pub fn repair(&self, path: &Path, apply: bool) -> Result<Vec<String>, DataError> {
        if apply {
            recording::check_own(path)?;
        }
        (self.repair)(path, apply)
    }
}

impl Entry for Format {
    const KIND: &'static str = "dataset format";
    const COMMAND: &'static str = "convert --help";

    fn name(&self) -> &'static str {
        self.name
    }

    fn aliases(&self) -> &'static [&'static str] {
        self.extensions
    }
}

/// One way in which other programs store datasets, which is read and not written. Registries are asked for formats first, then for
/// layouts in the order in which they were added: more particular ones come first.
///
/// ```
/// use swm_core::Registry;
/// use swm_data::{DataError, Layout};
///
/// const NOTES: Layout = Layout::new(
///     "notes",
///     "a folder of notes, as a program of ours writes them",
///     |path| path.join("notes.txt").is_file(),
///     |path, _options| Err(DataError::request(path, "here the notes would become a dataset")),
/// );
/// let registry = Registry::new().with(swm_data::FORMATS).with(&[NOTES]);
/// assert!(registry.find::<Layout>("notes").is_ok());
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Layout {
    /// Its name.
    pub name: &'static str,
    /// One line on which programs write it.
    pub about: &'static str,
    detect: Detect,
    open: OpenWith,
}

impl Layout {
    /// A layout: its name, which programs write it, how it is recognized by its content, and how it is opened.
    pub const fn new(name: &'static str, about: &'static str, detect: Detect, open: OpenWith) -> Self {
        Self { name, about, detect, open }
    }

    /// Whether the content of an existing file or folder is of this layout.
    pub fn detect(&self, path: &Path) -> bool {
        (self.detect)(path)
    }

    /// Opens a dataset of this layout for reading.
    ///
    /// # Errors
    ///
    /// Nothing is there, or it is damaged or of another layout; [`DataError::Option`]: an option is wrong, or would not act.
    pub fn open(&self, path: &Path, options: &OpenOptions) -> Opened<dyn Dataset> {
        (self.open)(path, options)
    }
}

impl Entry for Layout {
    const KIND: &'static str = "layout of datasets";
    const COMMAND: &'static str = "convert --help";

    fn name(&self) -> &'static str {
        self.name
    }
}
