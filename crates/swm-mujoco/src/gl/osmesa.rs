//! OpenGL through OSMesa: Mesa's software renderer as a separate library. Constants: `GL/osmesa.h`.

use std::cell::UnsafeCell;
use std::ffi::{c_int, c_uint, c_void};
use std::ptr::{NonNull, null_mut};

use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW, Symbol};

use super::Driver;

/// Names of the library, newest first.
const LIBRARIES: &[&str] = &["libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"];

type Handle = *mut c_void;
type Create = unsafe extern "C" fn(c_uint, c_int, c_int, c_int, Handle) -> Handle;
type MakeCurrent = unsafe extern "C" fn(Handle, *mut c_void, c_uint, c_int, c_int) -> u8;

const RGBA: c_uint = 0x1908;
const UNSIGNED_BYTE: c_uint = 0x1401;
const DEPTH_BITS: c_int = 24;
const STENCIL_BITS: c_int = 8;
/// Side of the window that a context must have.
const SIDE: usize = 16;

/// The functions to make contexts.
pub(super) struct Osmesa {
    create: Symbol<Create>,
    make_current: Symbol<MakeCurrent>,
    destroy: Symbol<unsafe extern "C" fn(Handle)>,
    _library: Library,
}

// SAFETY: OSMesa's functions may be called from any thread.
unsafe impl Send for Osmesa {}
// SAFETY: as above.
unsafe impl Sync for Osmesa {}

/// A context and the window that it is current in. MuJoCo renders into its own buffers, and nothing reads this one.
struct Context {
    raw: Handle,
    window: UnsafeCell<[u8; SIDE * SIDE * 4]>,
}

impl Osmesa {
    /// Loads the library, and tries a context.
    pub(super) fn load() -> Result<Self, String> {
        let library = open()?;
        // SAFETY: these are the signatures of OSMesa since version 6.
        let osmesa = unsafe {
            let failed = |error: libloading::Error| error.to_string();
            Self {
                create: library.get(b"OSMesaCreateContextExt\0").map_err(failed)?,
                make_current: library.get(b"OSMesaMakeCurrent\0").map_err(failed)?,
                destroy: library.get(b"OSMesaDestroyContext\0").map_err(failed)?,
                _library: library,
            }
        };
        let trial = osmesa.create()?;
        // SAFETY: the context was made here and is current nowhere.
        unsafe {
            let worked = osmesa.make_current(Some(trial)).and_then(|()| osmesa.make_current(None));
            osmesa.destroy(trial);
            worked.map(|()| osmesa)
        }
    }
}

/// Opens the library so that MuJoCo finds `OSMesaGetProcAddress` among the symbols that all libraries see.
fn open() -> Result<Library, String> {
    let mut reasons = Vec::new();
    for name in LIBRARIES {
        // SAFETY: loading runs the initializers of a graphics library of the system, which need nothing of us.
        match unsafe { Library::open(Some(name), RTLD_NOW | RTLD_GLOBAL) } {
            Ok(library) => return Ok(library),
            Err(error) => reasons.push(error.to_string()),
        }
    }
    Err(reasons.swap_remove(0))
}

// SAFETY: contexts come from OSMesa itself, and each has its window.
unsafe impl Driver for Osmesa {
    fn name(&self) -> &'static str {
        "OSMesa"
    }

    fn create(&self) -> Result<NonNull<c_void>, String> {
        // SAFETY: no context is shared.
        let raw = unsafe { (self.create)(RGBA, DEPTH_BITS, STENCIL_BITS, 0, null_mut()) };
        if raw.is_null() {
            return Err("OSMesaCreateContextExt failed".to_owned());
        }
        let context = Box::new(Context { raw, window: UnsafeCell::new([0; SIDE * SIDE * 4]) });
        Ok(NonNull::from(Box::leak(context)).cast())
    }

    unsafe fn make_current(&self, context: Option<NonNull<c_void>>) -> Result<(), String> {
        let side = SIDE as c_int;
        // SAFETY: the caller's promise: it is one of our boxes, whose window lives as long as the context.
        let done = unsafe {
            match context.map(|context| context.cast::<Context>().as_ref()) {
                Some(context) => {
                    (self.make_current)(context.raw, context.window.get().cast(), UNSIGNED_BYTE, side, side)
                }
                None => (self.make_current)(null_mut(), null_mut(), UNSIGNED_BYTE, 0, 0),
            }
        };
        if done == 0 { Err("OSMesaMakeCurrent failed".to_owned()) } else { Ok(()) }
    }

    unsafe fn destroy(&self, context: NonNull<c_void>) {
        // SAFETY: the caller's promise: it is one of our boxes, and nobody else has it.
        unsafe {
            let context = Box::from_raw(context.cast::<Context>().as_ptr());
            (self.destroy)(context.raw);
        }
    }
}
