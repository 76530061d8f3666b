//! What can go wrong with MuJoCo. Every message names the object, the reason and the fix.

use std::path::PathBuf;

use swm_core::EnvError;
use swm_core::error::did_you_mean;
use thiserror::Error;

use crate::assets::fix;

/// MuJoCo is missing, or a model or simulation is unusable.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum MujocoError {
    /// The library could not be loaded.
    #[error(
        "cannot load MuJoCo {}: tried {tried}; {}",
        crate::assets::MUJOCO_VERSION,
        fix(", or set SWM_MUJOCO_LIB to the library file")
    )]
    NoLibrary {
        /// Each path tried, with the reason why it failed.
        tried: String,
    },
    /// The library has another version than the bindings.
    #[error(
        "{} is MuJoCo {found}, this program needs {}; {}",
        .path.display(),
        crate::assets::MUJOCO_VERSION,
        fix(", or set SWM_MUJOCO_LIB to a library of that version")
    )]
    WrongVersion {
        /// The library.
        path: PathBuf,
        /// Its version.
        found: String,
    },
    /// Another library is to be used than the one that the process has loaded.
    #[error("MuJoCo is already loaded from {}; choose the library before any environment is made", .path.display())]
    Loaded {
        /// The loaded library.
        path: PathBuf,
    },
    /// The renderer without OpenGL failed.
    #[error(transparent)]
    Image(#[from] swm_render::RenderError),
    /// A file of a model is missing.
    #[error("the model {} is missing; {}", .path.display(), fix(""))]
    NoAsset {
        /// The file.
        path: PathBuf,
    },
    /// A file of the data folder is not as it was published.
    #[error(
        "{} is not the file that was published: its SHA-256 is {found}, not {expected}; {}",
        .path.display(),
        fix(" again")
    )]
    Altered {
        /// The file.
        path: PathBuf,
        /// The SHA-256 that it must have.
        expected: String,
        /// The SHA-256 that it has.
        found: String,
    },
    /// A model file cannot be read, or an edited model cannot be compiled.
    #[error("the model {model} is unusable: {reason}")]
    Model {
        /// File or name of the model.
        model: String,
        /// What MuJoCo says.
        reason: String,
    },
    /// The model has no object of this name.
    #[error("the model has no {kind} `{name}`{}", did_you_mean(.nearest.as_deref()))]
    NoObject {
        /// `geom`, `joint`, …
        kind: &'static str,
        /// The name asked for.
        name: String,
        /// The nearest existing one.
        nearest: Option<String>,
    },
    /// An episode cannot begin.
    #[error("no start of an episode: {0}")]
    Start(String),
    /// MuJoCo stopped with an error.
    #[error("MuJoCo: {0}")]
    Raised(String),
    /// MuJoCo warned that the simulation means nothing any more, or lacks memory.
    #[error("MuJoCo warned at {time_s:.3} s of the episode: {warning}")]
    Diverged {
        /// What it warned of.
        warning: String,
        /// Simulated time of the last state before it.
        time_s: f64,
    },
    /// There is no OpenGL to render with.
    #[error(
        "images by OpenGL are not possible here: tried {tried}; install EGL or OSMesa with a driver (Debian and \
         Ubuntu: `libegl1 libgl1-mesa-dri`, or `libosmesa6`), or ask for no images"
    )]
    NoGl {
        /// Each library tried, with the reason why it failed.
        tried: String,
    },
    /// OpenGL stopped working.
    #[error("OpenGL through {driver}: {reason}")]
    Gl {
        /// `EGL` or `OSMesa`.
        driver: &'static str,
        /// The call that failed.
        reason: String,
    },
    /// The model has fewer cameras.
    #[error("the model has no camera {index}; it has {count}, counted from 0")]
    NoCamera {
        /// The index asked for.
        index: usize,
        /// Cameras of the model.
        count: usize,
    },
    /// Settings of images do not go together.
    #[error("{reason}")]
    Images {
        /// Why, and what would.
        reason: String,
    },
    /// A simulation is to be rendered whose model has other objects.
    #[error("the simulation's model has other objects than the one that the images were prepared for")]
    Scene,
    /// A saved state belongs to another model.
    #[error("the state holds {found} values, this model needs {expected}")]
    StateSize {
        /// Values saved.
        found: usize,
        /// Values of this model.
        expected: usize,
    },
}

impl MujocoError {
    /// As the failure of making the environment `env`.
    pub fn at_making(self, env: &str) -> EnvError {
        EnvError::Setting { env: env.to_owned(), reason: self.to_string() }
    }

    /// As the failure of a reset of `env`.
    pub fn at_reset(self, env: &str) -> EnvError {
        EnvError::Reset { env: env.to_owned(), reason: self.to_string() }
    }

    /// As the failure of a step of `env`.
    pub fn at_step(self, env: &str) -> EnvError {
        EnvError::Diverged { env: env.to_owned(), reason: self.to_string() }
    }

    /// As the failure of a restore of `env`.
    pub fn at_restore(self, env: &str) -> EnvError {
        EnvError::State { env: env.to_owned(), reason: self.to_string() }
    }
}
