//! Files that the book's examples find: small recordings, made when an example begins. Not the test of the book, which is
//! `tests/integration/book`.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::process::ExitCode;

/// A file, and the options of `swm collect` that make it.
const FILES: &[(&str, &str)] = &[
    ("pusht.h5", "swm/PushT-v1 --policy weak --episodes 24 --max-steps 60 --seed 1 --image-size 64x64"),
    ("small.h5", "swm/PushT-v1 --policy weak --episodes 4 --max-steps 30 --seed 1 --replayable"),
    (
        "tworoom.h5",
        "swm/TwoRoom-v2 --policy noisy-expert:2 --episodes 24 --max-steps 60 --seed 1 --image-size 64x64",
    ),
];

/// The command line, without the program's name, that makes the file `name` in the current folder.
pub fn command(name: &str) -> Option<String> {
    let (_, options) = FILES.iter().find(|(file, _)| *file == name)?;
    Some(format!("collect {options} --out {name} --quiet"))
}

/// A folder of its own for the process, which is in it from now on; the folder goes when this does.
pub struct Folder(PathBuf);

/// Goes into a new folder with the files of these names.
///
/// # Errors
///
/// A folder or file cannot be made, or no file has this name.
pub fn enter(names: &[&str]) -> io::Result<Folder> {
    let folder = Folder(std::env::temp_dir().join(format!("swm-book-{}", std::process::id())));
    std::fs::create_dir_all(&folder.0)?;
    std::env::set_current_dir(&folder.0)?;
    for name in names {
        let command =
            command(name).ok_or_else(|| io::Error::other(format!("no file {name} is ever given")))?;
        let args = std::iter::once("swm").chain(command.split(' ')).map(OsString::from);
        if swm::cli::run(&swm::registry(), args) != ExitCode::SUCCESS {
            return Err(io::Error::other(format!("`swm {command}` fails")));
        }
    }
    Ok(folder)
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::env::set_current_dir(std::env::temp_dir());
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
