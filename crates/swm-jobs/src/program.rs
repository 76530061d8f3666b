//! The program that runs the shards of a job: a file, which the job's folder gets a copy of, or a package that an interpreter runs
//! where it is installed.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use crate::error::JobError;
use swm_tasks::evaluation::file_hash;

/// How others start this command, where it is a package in an interpreter and the running file is the interpreter.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Launcher {
    /// The interpreter, and its arguments that come before those of the command: `python -m PACKAGE`.
    pub words: Vec<String>,
    /// The library that computes the results.
    pub library: PathBuf,
    /// What to install, such as `stable-worldmodel-rs==0.2.0`.
    pub package: String,
}

impl Launcher {
    /// The package `package` with its library, which `words` start.
    pub fn new(words: Vec<String>, library: PathBuf, package: impl Into<String>) -> Self {
        Self { words, library, package: package.into() }
    }
}

static LAUNCHER: OnceLock<Launcher> = OnceLock::new();

/// Declares how this command is started. The first call of a process counts.
pub fn set_launcher(launcher: Launcher) {
    LAUNCHER.get_or_init(|| launcher);
}

/// The program that runs the shards.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Program {
    /// What `swm --version` prints: commit, renderer, physics, features.
    pub about: String,
    /// Where it was when the job was submitted; of a package, its interpreter.
    pub path: PathBuf,
    /// Whether the folder has a copy, which tasks start: another build cannot change it.
    pub is_copied: bool,
    /// Of the file; of a package, of its library.
    pub sha256: String,
    /// The package that the interpreter `path` runs; `None`: `path` is the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub package: Option<Package>,
}

/// A package that an interpreter runs. Tasks use it where it is installed, and check that it is the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Package {
    /// What to install: `NAME==VERSION`.
    pub install: String,
    /// Arguments of the interpreter before those of the command.
    pub arguments: Vec<String>,
    /// Its library, when the job was submitted.
    pub library: PathBuf,
}

impl Program {
    /// This program, described by `about`. With `copies` the job's folder gets a copy of it, if it is a file.
    ///
    /// # Errors
    ///
    /// Its file cannot be read, or the interpreter that runs it is unknown.
    pub fn this(about: &str, copies: bool) -> Result<Self, JobError> {
        let about = about.to_owned();
        let Some(launcher) = LAUNCHER.get() else {
            let path = std::env::current_exe()?;
            return Ok(Self { about, sha256: file_hash(&path)?, path, is_copied: copies, package: None });
        };
        let Launcher { words, library, package } = launcher;
        let (path, arguments) = words.split_first().ok_or_else(|| {
            JobError::OtherProgram(format!(
                "tasks need the interpreter that runs {package}, and this process does not know it (Python's sys.executable is \
                 empty); run the command from a Python that is a program of its own"
            ))
        })?;
        let (install, library, arguments) = (package.clone(), library.clone(), arguments.to_vec());
        let sha256 = file_hash(&library)?;
        let package = Some(Package { install, arguments, library });
        Ok(Self { about, path: path.into(), is_copied: false, sha256, package })
    }

    /// The beginning of the command lines of tasks, for a job in `dir`.
    pub fn words(&self, dir: &Path) -> Vec<OsString> {
        let program = if self.is_copied { copy_in(dir) } else { self.path.clone() };
        let arguments = self.package.iter().flat_map(|package| package.arguments.iter().map(OsString::from));
        std::iter::once(program.into_os_string()).chain(arguments).collect()
    }

    /// Checks that this process is the program of the job in `dir`, by its hash: `about` describes it.
    ///
    /// # Errors
    ///
    /// It is another one.
    pub fn check(&self, dir: &Path, about: &str) -> Result<(), JobError> {
        match (&self.package, LAUNCHER.get()) {
            (Some(package), Some(launcher)) => self.check_package(package, launcher, dir)?,
            (None, None) => {
                let this = std::env::current_exe()?;
                let is_copy = match (fs::canonicalize(&this), fs::canonicalize(copy_in(dir))) {
                    (Ok(this), Ok(copy)) => this == copy,
                    _ => false,
                };
                if file_hash(&this)? != self.sha256 {
                    return Err(if is_copy { self.has_changed(dir) } else { self.is_not(&this, dir) });
                }
            }
            _ => return Err(self.is_not(&std::env::current_exe()?, dir)),
        }
        if about != self.about {
            return Err(JobError::OtherProgram(format!(
                "on this machine results would differ from those of the job: it was submitted with\n{}\nand here is\n{about}",
                self.about
            )));
        }
        Ok(())
    }

    fn check_package(&self, then: &Package, now: &Launcher, dir: &Path) -> Result<(), JobError> {
        let found = file_hash(&now.library)?;
        if found == self.sha256 {
            return Ok(());
        }
        let short = |hash: &str| hash.get(..12).unwrap_or(hash).to_owned();
        Err(JobError::OtherProgram(format!(
            "the package has changed since the job {} was submitted: that was {} (SHA-256 {}… of {}), here is {} ({}… of {}); \
             install the former again (pip install {}), or submit another job",
            dir.display(),
            then.install,
            short(&self.sha256),
            then.library.display(),
            now.package,
            short(&found),
            now.library.display(),
            then.install
        )))
    }

    /// Of the copy in the folder of the job.
    fn has_changed(&self, dir: &Path) -> JobError {
        let (copy, from) = (copy_in(dir), &self.path);
        let fix = match file_hash(from) {
            Ok(hash) if hash == self.sha256 => format!("copy {} there again", from.display()),
            _ => "submit another job".to_owned(),
        };
        JobError::OtherProgram(format!(
            "{}, the job's copy of the program, has changed since the job was submitted; {fix}",
            copy.display()
        ))
    }

    fn is_not(&self, this: &Path, dir: &Path) -> JobError {
        let words: Vec<String> =
            self.words(dir).iter().map(|word| word.to_string_lossy().into_owned()).collect();
        JobError::OtherProgram(format!(
            "{} is not the program of the job {}: run the tasks with {}",
            this.display(),
            dir.display(),
            words.join(" ")
        ))
    }
}

/// The copy of the program in the folder of a job.
pub(crate) fn copy_in(dir: &Path) -> PathBuf {
    dir.join("swm")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packaged(sha256: &str) -> Program {
        let arguments = ["-m", "stable_worldmodel_rs"].map(str::to_owned).to_vec();
        let package = Package { install: "wm==1".to_owned(), arguments, library: "/then/lib.so".into() };
        let (about, path) = ("swm".to_owned(), "/venv/bin/python".into());
        Program { about, path, is_copied: false, sha256: sha256.to_owned(), package: Some(package) }
    }

    #[test]
    fn a_package_is_started_by_its_interpreter() {
        let words = packaged("a").words(Path::new("/job"));
        assert_eq!(words, ["/venv/bin/python", "-m", "stable_worldmodel_rs"].map(OsString::from));
        let file = Program { package: None, is_copied: true, ..packaged("a") };
        assert_eq!(file.words(Path::new("/job")), [OsString::from("/job/swm")]);
    }

    #[test]
    fn a_program_that_is_no_package_does_not_run_its_tasks() {
        let message = packaged("a").check(Path::new("/job"), "swm").unwrap_err().to_string();
        assert!(message.contains("run the tasks with /venv/bin/python -m stable_worldmodel_rs"), "{message}");
    }

    #[test]
    fn a_changed_installation_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("lib.so");
        fs::write(&library, "another build").unwrap();
        let now = Launcher::new(Vec::new(), library.clone(), "wm==2");
        let job = packaged(&"a".repeat(64));
        let package = job.package.clone().unwrap();
        let message = job.check_package(&package, &now, Path::new("/job")).unwrap_err().to_string();
        for part in [
            "/job was submitted: that was wm==1 (SHA-256 aaaaaaaaaaaa…",
            "here is wm==2",
            "pip install wm==1",
        ] {
            assert!(message.contains(part), "{part}: {message}");
        }
        let same = packaged(&file_hash(&library).unwrap());
        assert!(same.check_package(&package, &now, Path::new("/job")).is_ok());
    }

    #[test]
    fn a_job_of_a_file_is_written_as_before() {
        let file = Program { package: None, ..packaged("a") };
        let json = serde_json::to_value(&file).unwrap();
        assert!(json.get("package").is_none());
        assert_eq!(serde_json::from_value::<Program>(json).unwrap(), file);
        let json = serde_json::to_value(packaged("a")).unwrap();
        assert_eq!(serde_json::from_value::<Program>(json).unwrap(), packaged("a"));
    }
}
