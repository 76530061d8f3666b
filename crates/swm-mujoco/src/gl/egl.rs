//! OpenGL through EGL: on a device, without a display server and without a surface. Constants: the EGL registry.

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::ptr::{NonNull, null, null_mut};

use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LOCAL, RTLD_NOW, Symbol};

use super::Driver;

const LIBRARY: &str = "libEGL.so.1";

type Handle = *mut c_void;
type Bool = c_uint;

const OPENGL_API: c_uint = 0x30A2;
const PLATFORM_DEVICE: c_uint = 0x313F;
const PLATFORM_SURFACELESS: c_uint = 0x31DD;

/// What the drawn-to buffers must have; they are MuJoCo's own, the context only has to allow them.
const ATTRIBUTES: &[c_int] = &[
    0x3024, 8, // red
    0x3023, 8, // green
    0x3022, 8, // blue
    0x3021, 8, // alpha
    0x3025, 24, // depth
    0x3026, 8, // stencil
    0x303F, 0x308E, // color buffer: RGB
    0x3033, 0x0001, // surface type: pixel buffer
    0x3040, 0x0008, // renderable: OpenGL
    0x3038, // end
];

/// A display on a device, and the functions to make contexts on it.
pub(super) struct Egl {
    functions: Functions,
    display: Handle,
    config: Handle,
    _library: Library,
}

// SAFETY: EGL's functions may be called from any thread; display and configuration are handles that do not change.
unsafe impl Send for Egl {}
// SAFETY: as above.
unsafe impl Sync for Egl {}

struct Functions {
    get_error: Symbol<unsafe extern "C" fn() -> c_int>,
    bind_api: Symbol<unsafe extern "C" fn(c_uint) -> Bool>,
    create_context: Symbol<unsafe extern "C" fn(Handle, Handle, Handle, *const c_int) -> Handle>,
    destroy_context: Symbol<unsafe extern "C" fn(Handle, Handle) -> Bool>,
    make_current: Symbol<unsafe extern "C" fn(Handle, Handle, Handle, Handle) -> Bool>,
    current_context: Symbol<unsafe extern "C" fn() -> Handle>,
    release_thread: Symbol<unsafe extern "C" fn() -> Bool>,
}

impl Egl {
    /// Loads the library, finds a device that works, and tries a context on it.
    pub(super) fn load() -> Result<Self, String> {
        // SAFETY: loading runs the initializers of a graphics library of the system, which need nothing of us.
        let library =
            unsafe { Library::open(Some(LIBRARY), RTLD_NOW | RTLD_LOCAL) }.map_err(|e| e.to_string())?;
        // SAFETY: these are the signatures of EGL 1.4.
        let functions = unsafe {
            Functions {
                get_error: symbol(&library, b"eglGetError\0")?,
                bind_api: symbol(&library, b"eglBindAPI\0")?,
                create_context: symbol(&library, b"eglCreateContext\0")?,
                destroy_context: symbol(&library, b"eglDestroyContext\0")?,
                make_current: symbol(&library, b"eglMakeCurrent\0")?,
                current_context: symbol(&library, b"eglGetCurrentContext\0")?,
                release_thread: symbol(&library, b"eglReleaseThread\0")?,
            }
        };
        let (display, config) = display(&library)?;
        let egl = Self { functions, display, config, _library: library };
        let trial = egl.create()?;
        // SAFETY: the context was made here and is current nowhere.
        let worked = unsafe {
            let worked = egl.make_current(Some(trial)).and_then(|()| egl.make_current(None));
            egl.destroy(trial);
            worked
        };
        worked?;
        // MuJoCo looks for `eglGetProcAddress` among the symbols that all libraries see. Only now that it works: it would
        // find this one too where OSMesa takes its place.
        // SAFETY: the library is loaded already; this changes who sees it. It stays loaded as long as the process.
        let visible = unsafe { Library::open(Some(LIBRARY), RTLD_NOW | RTLD_GLOBAL) };
        std::mem::forget(visible.map_err(|error| error.to_string())?);
        Ok(egl)
    }

    fn error(&self, call: &str) -> String {
        // SAFETY: the function takes nothing.
        let code = unsafe { (self.functions.get_error)() };
        format!("{call} failed with EGL error 0x{code:04X}")
    }

    /// Gives up what EGL keeps for this thread, unless a context is current here, ours or another library's. A thread that
    /// ended with it while the process ends would free it twice: itself, and the library.
    fn release_thread(&self) {
        // SAFETY: the functions take nothing, and no context is current.
        unsafe {
            if (self.functions.current_context)().is_null() {
                (self.functions.release_thread)();
            }
        }
    }
}

// SAFETY: contexts come from EGL itself.
unsafe impl Driver for Egl {
    fn name(&self) -> &'static str {
        "EGL"
    }

    fn create(&self) -> Result<NonNull<c_void>, String> {
        // SAFETY: display and configuration are valid; no context is shared, no attributes are given.
        let context = unsafe {
            (self.functions.bind_api)(OPENGL_API);
            (self.functions.create_context)(self.display, self.config, null_mut(), null())
        };
        let created = NonNull::new(context).ok_or_else(|| self.error("eglCreateContext"));
        self.release_thread();
        created
    }

    unsafe fn make_current(&self, context: Option<NonNull<c_void>>) -> Result<(), String> {
        let context = context.map_or(null_mut(), NonNull::as_ptr);
        // SAFETY: the caller's promise; no surface is needed, MuJoCo renders into its own buffers. The interface that
        // is bound belongs to the thread.
        let done = unsafe {
            (self.functions.bind_api)(OPENGL_API);
            (self.functions.make_current)(self.display, null_mut(), null_mut(), context)
        };
        let made = if done == 0 { Err(self.error("eglMakeCurrent")) } else { Ok(()) };
        if context.is_null() {
            self.release_thread();
        }
        made
    }

    unsafe fn destroy(&self, context: NonNull<c_void>) {
        // SAFETY: the caller's promise.
        unsafe { (self.functions.destroy_context)(self.display, context.as_ptr()) };
        self.release_thread();
    }
}

/// The first display that can be initialized, with a configuration: on the devices in their order, or on the one that
/// `MUJOCO_EGL_DEVICE_ID` names, as in MuJoCo's Python package; last without any device.
fn display(library: &Library) -> Result<(Handle, Handle), String> {
    type GetPlatformDisplay = unsafe extern "C" fn(c_uint, *mut c_void, *const c_int) -> Handle;
    type QueryDevices = unsafe extern "C" fn(c_int, *mut Handle, *mut c_int) -> Bool;
    // SAFETY: these are the signatures of EGL 1.4 and of its extensions `EXT_platform_base` and
    // `EXT_device_enumeration`; the latter return null where they are missing.
    let (initialize, choose_config, get_display, query_devices) = unsafe {
        let get_proc =
            symbol::<unsafe extern "C" fn(*const c_char) -> *const c_void>(library, b"eglGetProcAddress\0")?;
        let extension = |name: &CStr| get_proc(name.as_ptr());
        let get_display = extension(c"eglGetPlatformDisplayEXT");
        let query_devices = extension(c"eglQueryDevicesEXT");
        (
            symbol::<unsafe extern "C" fn(Handle, *mut c_int, *mut c_int) -> Bool>(
                library,
                b"eglInitialize\0",
            )?,
            symbol::<unsafe extern "C" fn(Handle, *const c_int, *mut Handle, c_int, *mut c_int) -> Bool>(
                library,
                b"eglChooseConfig\0",
            )?,
            std::mem::transmute::<*const c_void, Option<GetPlatformDisplay>>(get_display),
            std::mem::transmute::<*const c_void, Option<QueryDevices>>(query_devices),
        )
    };
    let get_display = get_display.ok_or("it has no eglGetPlatformDisplayEXT")?;
    let mut candidates = Vec::new();
    if let Some(query_devices) = query_devices {
        let mut devices: [Handle; 64] = [null_mut(); 64];
        let mut count = 0;
        // SAFETY: the array has room for as many devices as are asked for.
        unsafe { query_devices(devices.len() as c_int, devices.as_mut_ptr(), &raw mut count) };
        let count = usize::try_from(count).unwrap_or(0).min(devices.len());
        candidates.extend(devices[..count].iter().map(|device| (PLATFORM_DEVICE, *device)));
    }
    let device_count = candidates.len();
    if let Some(chosen) = std::env::var_os("MUJOCO_EGL_DEVICE_ID") {
        let chosen = chosen.to_str().and_then(|text| text.parse::<usize>().ok());
        let chosen = chosen.filter(|index| *index < device_count);
        let chosen = chosen.ok_or(format!("MUJOCO_EGL_DEVICE_ID is not below {device_count}"))?;
        candidates = vec![candidates[chosen]];
    } else {
        candidates.push((PLATFORM_SURFACELESS, null_mut()));
    }
    for (platform, device) in candidates {
        // SAFETY: platform and device belong together; no attributes are given.
        let display = unsafe { get_display(platform, device, null()) };
        // SAFETY: the display is what EGL returned; versions may be null.
        if display.is_null() || unsafe { initialize(display, null_mut(), null_mut()) } == 0 {
            continue;
        }
        let (mut config, mut count) = (null_mut(), 0);
        // SAFETY: the attributes end with the mark of the end, and there is room for one configuration.
        unsafe { choose_config(display, ATTRIBUTES.as_ptr(), &raw mut config, 1, &raw mut count) };
        if count > 0 {
            return Ok((display, config));
        }
    }
    Err(format!("no driver works on its {device_count} devices, nor without a device"))
}

/// A function of the library.
///
/// # Safety
/// `T` is the function's type.
unsafe fn symbol<T>(library: &Library, name: &[u8]) -> Result<Symbol<T>, String> {
    // SAFETY: the caller's promise.
    unsafe { library.get(name) }.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPENGL_ES_API: c_uint = 0x30A0;

    #[test]
    fn a_thread_keeps_nothing_of_egl_between_two_images() {
        let Ok(egl) = Egl::load() else {
            return;
        };
        // SAFETY: this is the signature of EGL 1.2.
        let bound =
            unsafe { symbol::<unsafe extern "C" fn() -> c_uint>(&egl._library, b"eglQueryAPI\0") }.unwrap();
        // A thread that EGL knows nothing of is bound to OpenGL ES, one that made or used a context to OpenGL.
        // SAFETY: the function takes nothing.
        let knows_thread = || unsafe { bound() } != OPENGL_ES_API;
        assert!(!knows_thread(), "after loading");
        let context = egl.create().unwrap();
        assert!(!knows_thread(), "after making a context");
        // SAFETY: the context was made here, is used on this thread only, and is not used after its end.
        unsafe {
            egl.make_current(Some(context)).unwrap();
            assert!(knows_thread(), "while the context is current");
            egl.release_thread();
            assert!(knows_thread(), "a current context is not given up");
            egl.make_current(None).unwrap();
            assert!(!knows_thread(), "after an image");
            egl.destroy(context);
        }
        assert!(!knows_thread(), "after the end of the context");
    }
}
