//! What the targets of formats of datasets do: a small dataset is recorded once, one of its files is replaced by the bytes of the fuzzer, and everything
//! is read. The first byte says which file. It is the same entry as that of the mutation tests (`swm_data::testing`), with
//! other bytes.

pub mod foreign;
#[cfg(feature = "cli")]
pub mod jobs;
pub mod results;
#[cfg(feature = "baselines")]
pub mod runs;
pub mod sample;
pub mod tables;
#[cfg(feature = "baselines")]
pub mod weights;

use std::cell::RefCell;
use std::fs;
use std::path::PathBuf;

use swm_core::Registry;
use swm_data::Format;
use swm_data::testing::mutations;
use tempfile::TempDir;

/// The formats that have a target.
pub const FORMATS: &[&str] = &[
    "hdf5",
    "folder",
    "video",
    "mcap",
    "lerobot",
    #[cfg(feature = "lance")]
    "lance",
    #[cfg(feature = "lance")]
    "lance-video",
];

/// The formats, and the layouts of other programs.
pub fn registry() -> Registry {
    let registry = Registry::new().with(swm_data::FORMATS).with(swm_data_lerobot::FORMATS);
    let registry = registry.with(swm_data_foreign::LAYOUTS);
    #[cfg(feature = "lance")]
    let registry = registry.with(swm_data_lance::FORMATS);
    registry
}

/// A dataset, and what its files held.
pub struct Seed {
    _folder: TempDir,
    path: PathBuf,
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl Seed {
    /// Records one.
    pub fn new(format: &str) -> Self {
        let folder = TempDir::new().expect("there is room for temporary files");
        let extension = registry().find::<Format>(format).expect("a format").extensions[0];
        let path = folder.path().join("seed").with_extension(extension);
        mutations::seed_in(&registry(), &path);
        let files = mutations::files(folder.path()).into_iter();
        let files = files.map(|file| (file.clone(), fs::read(&file).expect("it was just written"))).collect();
        Self { _folder: folder, path, files }
    }

    /// The inputs that change nothing.
    pub fn inputs(&self) -> impl Iterator<Item = Vec<u8>> + '_ {
        self.files.iter().zip(0..=u8::MAX).map(|((_, bytes), which)| [&[which], &bytes[..]].concat())
    }

    /// Reads everything with one file replaced.
    pub fn play(&self, data: &[u8]) {
        let Some((&which, content)) = data.split_first() else { return };
        let Some((file, original)) = self.files.get(usize::from(which)) else { return };
        // A new file, for images may be links to one another.
        let replace = |bytes: &[u8]| fs::remove_file(file).and_then(|()| fs::write(file, bytes));
        replace(content).expect("it can be replaced");
        mutations::play_in(&registry(), &self.path);
        replace(original).expect("it can be replaced");
    }
}

/// One input, played on a seed that the thread keeps.
pub fn play(format: &str, data: &[u8]) {
    thread_local!(static SEED: RefCell<Option<Seed>> = const { RefCell::new(None) });
    SEED.with_borrow_mut(|seed| seed.get_or_insert_with(|| Seed::new(format)).play(data));
}

/// One input of a target whose samples the thread keeps.
#[macro_export]
macro_rules! play_on {
    ($module:ident, $data:expr) => {{
        thread_local!(static SAMPLES: $crate::sample::Samples = $crate::$module::samples());
        SAMPLES.with(|samples| samples.play($data, $crate::$module::read));
    }};
}
