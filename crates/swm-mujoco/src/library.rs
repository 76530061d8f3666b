//! Loading the MuJoCo library, once per process.

use std::ffi::CStr;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use super::bindings::{Api, mjVERSION_HEADER};
use super::guard;
use crate::assets;
use crate::error::MujocoError;

/// The loaded MuJoCo library: all functions found, the version checked, the handlers replaced.
pub struct Library {
    api: Api,
}

// SAFETY: it holds addresses of functions, which any thread may call, and of the two handler variables, which are
// written under a lock before the library is shared.
unsafe impl Send for Library {}
// SAFETY: as above.
unsafe impl Sync for Library {}

impl Library {
    /// The library of this process, loaded at the first call that succeeds.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoLibrary`] or [`MujocoError::WrongVersion`].
    pub fn get() -> Result<&'static Library, MujocoError> {
        static LIBRARY: OnceLock<Library> = OnceLock::new();
        static LOADING: Mutex<()> = Mutex::new(());
        if let Some(library) = LIBRARY.get() {
            return Ok(library);
        }
        let _only_one = LOADING.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have loaded it while this one waited.
        if let Some(library) = LIBRARY.get() {
            return Ok(library);
        }
        let path = assets::library_path()?;
        // Before it is loaded, for loading runs it.
        let sha256 = assets::library_sha256(&path, assets::expected_library(&path))?;
        let library = Library::open(&path)?;
        assets::set_loaded(&path, sha256);
        Ok(LIBRARY.get_or_init(|| library))
    }

    fn open(path: &Path) -> Result<Library, MujocoError> {
        let failed =
            |reason: String| MujocoError::NoLibrary { tried: format!("{} ({reason})", path.display()) };
        if !path.is_file() {
            return Err(failed("no such file".to_owned()));
        }
        // SAFETY: loading runs the initializers of the file. It is the one that the user installed or named; those of
        // MuJoCo only set up C++ statics.
        let library = unsafe { libloading::Library::new(path) }.map_err(|error| failed(error.to_string()))?;
        // SAFETY: `mj_version` takes nothing and returns an int in every version of MuJoCo.
        let version = unsafe {
            let mj_version = library.get::<unsafe extern "C" fn() -> std::ffi::c_int>(b"mj_version\0");
            let mj_version =
                mj_version.map_err(|_| failed("it has no `mj_version`: not a MuJoCo library".to_owned()))?;
            mj_version()
        };
        if i64::from(version) != i64::from(mjVERSION_HEADER) {
            let found = version_text(version);
            return Err(MujocoError::WrongVersion { path: path.to_owned(), found });
        }
        // SAFETY: the version is that of the headers from which the signatures were generated.
        let api = unsafe { Api::from_library(library) }.map_err(|error| failed(error.to_string()))?;
        static HANDLERS: Mutex<()> = Mutex::new(());
        let lock = HANDLERS.lock().unwrap_or_else(PoisonError::into_inner);
        guard::install(&api);
        drop(lock);
        Ok(Library { api })
    }

    pub(super) fn api(&self) -> &Api {
        &self.api
    }

    /// The version that the library reports: `3.17.0`.
    pub fn version(&self) -> String {
        // SAFETY: the function returns a static null-terminated text.
        let text = unsafe { CStr::from_ptr(self.api.mj_versionString()) };
        text.to_string_lossy().into_owned()
    }
}

/// `3017000` as `3.17.0`; before 3.5 the number was `340` for 3.4.0.
fn version_text(version: i32) -> String {
    let base = if version >= 1_000_000 { 1000 } else { 10 };
    format!("{}.{}.{}", version / (base * base), version / base % base, version % base)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pinned_version_is_loaded() {
        assert_eq!(Library::get().unwrap().version(), assets::MUJOCO_VERSION);
    }

    #[test]
    fn a_missing_library_names_the_path_and_the_command() {
        let message = Library::open(Path::new("no/such/library.so")).err().unwrap().to_string();
        for part in ["no/such/library.so", "no such file", "cargo xtask setup", "SWM_MUJOCO_LIB", "3.17.0"] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_file_that_is_no_library_is_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"not a library").unwrap();
        let message = Library::open(file.path()).err().unwrap().to_string();
        assert!(message.contains(file.path().to_str().unwrap()), "{message}");
    }

    #[test]
    fn versions_are_told_as_people_write_them() {
        assert_eq!(version_text(3_017_000), "3.17.0");
        assert_eq!(version_text(340), "3.4.0");
        let wrong = MujocoError::WrongVersion { path: "lib.so".into(), found: version_text(340) };
        let message = wrong.to_string();
        assert!(message.contains("3.4.0") && message.contains("needs 3.17.0"), "{message}");
    }
}
