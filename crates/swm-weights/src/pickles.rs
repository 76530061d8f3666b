//! The pickles of a file, wherever its container keeps them, and copies of the file in which they are changed.
//!
//! | container | its pickles |
//! |---|---|
//! | zip | `data.pkl` |
//! | the older one | at its start, one after the other: magic number, version, sizes of numbers, the object, the keys of storages |
//! | tar | at the start of each entry |
//! | none | the file |

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use tempfile::NamedTempFile;

use crate::archive;
use crate::pickle::{self, Found};

/// The longest pickles that are looked through: as the reader of tensors allows in archives.
const LONGEST: usize = 100 << 20;
/// How much of a file is read at first.
const FIRST: usize = 1 << 20;

/// The magic number of the older container, in binary and in decimal, and within how many bytes it is.
const MAGIC: (&[u8], &[u8], usize) =
    (&[0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19], b"119547037146038801333356", 64);
/// How many pickles it has.
const COUNT: usize = 5;

/// Tar archives: a block, the place of the magic, and the most entries that are looked at.
const BLOCK: usize = 512;
const USTAR: (usize, &[u8]) = (257, b"ustar");
const MOST_ENTRIES: usize = 1_000;

/// What holds the pickles of a file, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Container {
    Zip,
    Old,
    Tar,
    /// A pickle alone, or no file of PyTorch.
    Unknown,
}

impl Container {
    pub(crate) fn of(file: &mut File) -> io::Result<Self> {
        let mut head = Vec::new();
        file.seek(SeekFrom::Start(0))?;
        (&mut *file).take(BLOCK as u64).read_to_end(&mut head)?;
        let window = &head[..head.len().min(MAGIC.2)];
        let has = |magic: &[u8]| window.windows(magic.len()).any(|bytes| bytes == magic);
        Ok(match () {
            () if head.starts_with(b"PK") => Self::Zip,
            () if head.get(USTAR.0..).is_some_and(|rest| rest.starts_with(USTAR.1)) => Self::Tar,
            () if has(MAGIC.0) || has(MAGIC.1) => Self::Old,
            () => Self::Unknown,
        })
    }
}

/// The pickles of a file.
pub(crate) struct Pickles {
    place: Place,
    /// The bytes of those that may be changed.
    bytes: Vec<u8>,
    /// What is in them.
    pub(crate) found: Found,
}

enum Place {
    Archive(archive::Pickle),
    /// From the first byte of the file on.
    Start,
    /// Where they are not changed.
    Tar,
}

impl Pickles {
    /// Those of a file; `None`: it has none that can be found.
    ///
    /// # Errors
    ///
    /// The system refuses to read it; of the kind `FileTooLarge`: they are longer than those that are looked through.
    pub(crate) fn find(file: &mut File, container: Container) -> io::Result<Option<Self>> {
        let count = match container {
            Container::Zip => {
                let Some(place) = archive::find_pickle(file)? else { return Ok(None) };
                let bytes = place.read(file)?;
                let found = pickle::look_through(&bytes, 1);
                return Ok(Some(Self { place: Place::Archive(place), bytes, found }));
            }
            Container::Tar => {
                return Ok(Some(Self { place: Place::Tar, bytes: Vec::new(), found: of_tar(file)? }));
            }
            Container::Old => COUNT,
            Container::Unknown => 1,
        };
        let (all, mut len, mut bytes) = (file.metadata()?.len(), FIRST, Vec::new());
        // The numbers of the tensors come behind, and need not be read for this.
        loop {
            file.seek(SeekFrom::Start(bytes.len() as u64))?;
            (&mut *file).take((len - bytes.len()) as u64).read_to_end(&mut bytes)?;
            let found = pickle::look_through(&bytes, count);
            if !found.is_cut || bytes.len() as u64 >= all {
                bytes.truncate(found.end);
                return Ok(Some(Self { place: Place::Start, bytes, found }));
            }
            if len == LONGEST {
                let reason = "the file has pickles of more than 100 MiB, which are not looked through; save the model's `state_dict()` alone";
                return Err(io::Error::new(io::ErrorKind::FileTooLarge, reason));
            }
            len = (len * 8).min(LONGEST);
        }
    }

    /// Whether a zip archive holds it.
    pub(crate) fn is_archived(&self) -> bool {
        matches!(self.place, Place::Archive(_))
    }

    /// A copy of the file at `from` whose objects of these classes have no attributes; `None`: it is as good as the file.
    pub(crate) fn copy(&self, from: &Path, classes: &[String]) -> io::Result<Option<NamedTempFile>> {
        let Some(changed) = self.found.changed(&self.bytes, classes) else { return Ok(None) };
        let mut out = NamedTempFile::new()?;
        match &self.place {
            Place::Archive(place) if changed.len() == self.bytes.len() => {
                place.copy_with(from, out.as_file_mut(), &changed)?;
            }
            Place::Start => {
                out.write_all(&changed)?;
                let mut file = File::open(from)?;
                file.seek(SeekFrom::Start(self.bytes.len() as u64))?;
                io::copy(&mut file, &mut out)?;
            }
            Place::Archive(_) | Place::Tar => return Ok(None),
        }
        Ok(Some(out))
    }
}

/// What is in the pickles at the starts of a tar archive's entries.
fn of_tar(file: &mut File) -> io::Result<Found> {
    let (mut all, mut at, mut left) = (Found::default(), 0, LONGEST as u64);
    for _ in 0..MOST_ENTRIES {
        let mut head = Vec::new();
        file.seek(SeekFrom::Start(at))?;
        (&mut *file).take(BLOCK as u64).read_to_end(&mut head)?;
        let len = head.get(124..136).and_then(|digits| {
            let digits =
                std::str::from_utf8(digits).ok()?.trim_matches(|letter| letter == '\0' || letter == ' ');
            u64::from_str_radix(digits, 8).ok()
        });
        let Some(len) = len else { break };
        let mut bytes = Vec::new();
        (&mut *file).take(len.min(left)).read_to_end(&mut bytes)?;
        left -= bytes.len() as u64;
        all.add(pickle::look_through(&bytes, 1));
        let blocks = len.div_ceil(BLOCK as u64).saturating_add(1);
        at = blocks.saturating_mul(BLOCK as u64).saturating_add(at);
    }
    Ok(all)
}
