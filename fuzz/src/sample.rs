//! Files and folders of any kind, of which one file has the bytes of the fuzzer. The first byte says which sample, the second which file.

use std::fs;
use std::path::{Path, PathBuf};

use swm_data::testing::mutations::files;
use tempfile::TempDir;

/// A file or folder in a folder of its own, and what its files held.
pub struct Sample {
    _folder: TempDir,
    /// Where it is.
    pub path: PathBuf,
    files: Vec<(PathBuf, Vec<u8>)>,
}

/// Several kinds.
pub struct Samples(Vec<Sample>);

impl Sample {
    /// What `make` writes at a path of this name.
    pub fn new(name: &str, make: impl FnOnce(&Path)) -> Self {
        let folder = TempDir::new().expect("there is room for temporary files");
        let path = folder.path().join(name);
        make(&path);
        let files = files(&path).into_iter();
        let files = files.map(|file| (file.clone(), fs::read(&file).expect("it was just written"))).collect();
        Self { _folder: folder, path, files }
    }

    /// A copy of a file or folder.
    pub fn copy(from: &Path) -> Self {
        let name = from.file_name().expect("a file or folder has a name").to_string_lossy();
        Self::new(&name, |to| copy(from, to))
    }
}

impl Samples {
    /// These, of which the first 256 have inputs.
    pub fn new(samples: Vec<Sample>) -> Self {
        Self(samples)
    }

    /// The inputs that change nothing.
    pub fn inputs(&self) -> impl Iterator<Item = Vec<u8>> + '_ {
        (0..=u8::MAX).zip(&self.0).flat_map(|(which, sample)| {
            let files = (0..=u8::MAX).zip(&sample.files);
            files.map(move |(file, (_, bytes))| [&[which, file], &bytes[..]].concat())
        })
    }

    /// Reads a sample with one file replaced.
    pub fn play(&self, data: &[u8], read: impl FnOnce(&Path)) {
        let [which, file, content @ ..] = data else { return };
        let Some(sample) = self.0.get(usize::from(*which)) else { return };
        let Some((file, original)) = sample.files.get(usize::from(*file)) else { return };
        fs::write(file, content).expect("it can be replaced");
        read(&sample.path);
        fs::write(file, original).expect("it can be replaced");
    }
}

fn copy(from: &Path, to: &Path) {
    if from.is_file() {
        fs::copy(from, to).expect("there is room");
        return;
    }
    fs::create_dir_all(to).expect("there is room");
    for entry in fs::read_dir(from).expect("the fixtures are there") {
        let entry = entry.expect("it is listed").path();
        copy(&entry, &to.join(entry.file_name().expect("it is listed")));
    }
}
