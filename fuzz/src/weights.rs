//! Published checkpoints of which a file has the bytes of the fuzzer: its weights, its config, or the notes beside it. The first byte says
//! which checkpoint, the second which file.

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

use swm_checkpoints::import::Import;
use swm_core::Registry;
use swm_tasks::request::Request as _;
use tempfile::TempDir;

/// What every checkpoint may have beside its weights, and what stands there at first.
const NOTES: (&str, &[u8]) = ("swm.json", b"{\"version\": 1, \"image\": 16, \"scales\": {}, \"set\": {}}");
/// The config of weights that have none.
const CONFIG: &str = "lewm_trainer/config.json";

/// A checkpoint in a folder of its own.
struct Checkpoint {
    folder: TempDir,
    files: Vec<(PathBuf, Vec<u8>)>,
}

/// All that there are.
pub struct Seeds(Vec<Checkpoint>);

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/checkpoints")
}

/// Files of a folder and of those below it, by their places in it; not the outputs that tests compare.
fn files_below(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(next) = waiting.pop() {
        for entry in
            fs::read_dir(&next).expect("the fixtures are there").map(|entry| entry.expect("it is listed"))
        {
            let path = entry.path();
            if path.is_dir() {
                waiting.push(path);
            } else if !path.ends_with("expected.safetensors") {
                let place = path.strip_prefix(folder).expect("it is below").to_owned();
                found.push((place, fs::read(&path).expect("it is a file")));
            }
        }
    }
    found.sort();
    found
}

impl Checkpoint {
    fn new(mut files: Vec<(PathBuf, Vec<u8>)>) -> Self {
        let folder = TempDir::new().expect("there is room for temporary files");
        files.push((NOTES.0.into(), NOTES.1.to_vec()));
        for (place, bytes) in &files {
            let path = folder.path().join(place);
            fs::create_dir_all(path.parent().expect("it has a folder")).expect("there is room");
            fs::write(path, bytes).expect("there is room");
        }
        Self { folder, files }
    }

    /// Describes it and loads it, as every model that it may be.
    fn play(&self) {
        for kind in [None, Some("lewm"), Some("dino-wm"), Some("gciql"), Some("tdmpc2")] {
            let request = Import {
                from: self.folder.path().display().to_string(),
                kind: kind.map(str::to_owned),
                action_mean: Some(vec![0.0; 2]),
                action_std: Some(vec![1.0; 2]),
                check_only: true,
                ..Import::default()
            };
            // Only that it ends: most bytes are refused.
            let _ = request.run(&Registry::new(), &mut ());
        }
    }
}

impl Seeds {
    /// The fixtures of the tests of imports; those that must be refused stand beside a sound config.
    pub fn new() -> Self {
        let mut folders: Vec<PathBuf> = fs::read_dir(golden())
            .expect("the fixtures are there")
            .map(|entry| entry.expect("it is listed").path())
            .collect();
        folders.sort();
        let (bad, sound): (Vec<_>, Vec<_>) = folders.into_iter().partition(|folder| folder.ends_with("bad"));
        let mut all: Vec<Checkpoint> =
            sound.iter().map(|folder| Checkpoint::new(files_below(folder))).collect();
        let config = fs::read(golden().join(CONFIG)).expect("the fixtures are there");
        for (place, bytes) in bad.iter().flat_map(|folder| files_below(folder)) {
            if place.extension().is_some_and(|ending| ending == "pt") {
                all.push(Checkpoint::new(vec![
                    ("weights.pt".into(), bytes),
                    ("config.json".into(), config.clone()),
                ]));
            }
        }
        Self(all)
    }

    /// The inputs that change nothing.
    pub fn inputs(&self) -> impl Iterator<Item = Vec<u8>> + '_ {
        (0..=u8::MAX).zip(&self.0).flat_map(|(which, checkpoint)| {
            let files = (0..=u8::MAX).zip(&checkpoint.files);
            files.map(move |(file, (_, bytes))| [&[which, file], &bytes[..]].concat())
        })
    }

    /// Reads a checkpoint with one file replaced.
    pub fn play(&self, data: &[u8]) {
        let [which, file, content @ ..] = data else { return };
        let Some(checkpoint) = self.0.get(usize::from(*which)) else { return };
        let Some((place, original)) = checkpoint.files.get(usize::from(*file)) else { return };
        let path = checkpoint.folder.path().join(place);
        fs::write(&path, content).expect("it can be replaced");
        checkpoint.play();
        fs::write(&path, original).expect("it can be replaced");
    }
}

impl Default for Seeds {
    fn default() -> Self {
        Self::new()
    }
}

/// One input, played on checkpoints that the thread keeps.
pub fn play(data: &[u8]) {
    thread_local!(static SEEDS: RefCell<Option<Seeds>> = const { RefCell::new(None) });
    SEEDS.with_borrow_mut(|seeds| seeds.get_or_insert_with(Seeds::new).play(data));
}
