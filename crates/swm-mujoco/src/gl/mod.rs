//! Images by MuJoCo's own renderer, which draws with OpenGL.
//!
//! Neither this crate nor MuJoCo links OpenGL. It is loaded at run time, from the first of these that works, and then
//! for the whole process: MuJoCo looks its functions up once.
//!
//! * `libEGL`: without a display server; the driver is the graphics card's, or Mesa's in software;
//! * `libOSMesa`: in software.
//!
//! An OpenGL context is current on one thread or none. [`GlContext`] is current only while it draws, so that it may move
//! to another thread between two images.

#[cfg(target_os = "linux")]
mod egl;
#[cfg(target_os = "linux")]
mod osmesa;
mod renderer;

use std::ffi::c_void;
use std::ptr::NonNull;
use std::sync::OnceLock;

use crate::error::MujocoError;

pub use renderer::GlRenderer;

/// What a way to OpenGL must offer.
///
/// # Safety
/// `create` returns a context that `make_current` and `destroy` accept until it is destroyed.
unsafe trait Driver: Send + Sync {
    /// Its name, for messages and logs.
    fn name(&self) -> &'static str;

    /// A new context; the error says which call failed.
    fn create(&self) -> Result<NonNull<c_void>, String>;

    /// Makes the context current on this thread, or none.
    ///
    /// # Safety
    /// The context comes from `create`, and is current on no other thread.
    unsafe fn make_current(&self, context: Option<NonNull<c_void>>) -> Result<(), String>;

    /// Ends a context.
    ///
    /// # Safety
    /// It comes from `create`, is current on no thread, and is not used again.
    unsafe fn destroy(&self, context: NonNull<c_void>);
}

/// The driver of this process, loaded at the first call.
fn driver() -> Result<&'static dyn Driver, MujocoError> {
    static DRIVER: OnceLock<Result<Box<dyn Driver>, String>> = OnceLock::new();
    match DRIVER.get_or_init(load) {
        Ok(driver) => Ok(&**driver),
        Err(tried) => Err(MujocoError::NoGl { tried: tried.clone() }),
    }
}

#[cfg(target_os = "linux")]
fn load() -> Result<Box<dyn Driver>, String> {
    let egl = match egl::Egl::load() {
        Ok(egl) => return Ok(Box::new(egl)),
        Err(reason) => reason,
    };
    match osmesa::Osmesa::load() {
        Ok(osmesa) => Ok(Box::new(osmesa)),
        Err(osmesa) => Err(format!("libEGL ({egl}), libOSMesa ({osmesa})")),
    }
}

#[cfg(not(target_os = "linux"))]
fn load() -> Result<Box<dyn Driver>, String> {
    Err("nothing: on this system the way to OpenGL is not known".to_owned())
}

/// An OpenGL context.
pub struct GlContext {
    driver: &'static dyn Driver,
    raw: NonNull<c_void>,
}

// SAFETY: it is current on a thread only during `draw`, which borrows it.
unsafe impl Send for GlContext {}
// SAFETY: `&GlContext` gives access to nothing but the name of the driver.
unsafe impl Sync for GlContext {}

impl GlContext {
    /// Loads OpenGL, if nothing has done so yet, and makes a context.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoGl`], with each library that was tried; [`MujocoError::Gl`]: no context could be made.
    pub fn new() -> Result<Self, MujocoError> {
        let driver = driver()?;
        let raw = driver.create().map_err(|reason| failed(driver, &reason))?;
        Ok(Self { driver, raw })
    }

    /// What the context was made by: `EGL` or `OSMesa`.
    pub fn driver_name(&self) -> &'static str {
        self.driver.name()
    }

    /// Calls `work` while the context is current on this thread.
    fn with_current<R>(&mut self, work: impl FnOnce() -> R) -> Result<R, MujocoError> {
        struct Current(&'static dyn Driver);
        impl Drop for Current {
            fn drop(&mut self) {
                // SAFETY: no context is named. A failure leaves the context current here, which the next call fixes.
                let _ = unsafe { self.0.make_current(None) };
            }
        }
        // SAFETY: `&mut self` is the only access, so that no other thread draws with it.
        unsafe { self.driver.make_current(Some(self.raw)) }.map_err(|reason| failed(self.driver, &reason))?;
        let _current = Current(self.driver);
        Ok(work())
    }
}

impl Drop for GlContext {
    fn drop(&mut self) {
        // SAFETY: the context is ours, is current on no thread outside of `draw`, and is not used again.
        unsafe { self.driver.destroy(self.raw) };
    }
}

fn failed(driver: &dyn Driver, reason: &str) -> MujocoError {
    MujocoError::Gl { driver: driver.name(), reason: reason.to_owned() }
}
