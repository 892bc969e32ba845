//! The Embree device: version check, configuration, errors.

use super::sys;
use crate::error::{Error, Result};
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// An Embree device. Cloning is cheap; scenes keep the device in use. A device that nothing uses any more is kept for later scenes:
/// Embree's task scheduler (oneTBB) very rarely crashes where devices are made and released again and again (two runs of all tests of some
/// thirty).
#[derive(Clone)]
pub struct Device {
    used: Arc<Used>,
}

/// A device that goes back to [`IDLE`] when the last scene on it is dropped.
struct Used(Made);

/// Devices without scenes.
static IDLE: Mutex<Vec<Made>> = Mutex::new(Vec::new());

/// A device that is never released.
#[derive(Clone, Copy)]
struct Made {
    raw: sys::RTCDevice,
    threads: usize,
    state: &'static CallbackState,
}

#[derive(Default)]
struct CallbackState {
    first_error: Mutex<Option<(i32, String)>>,
    bytes: AtomicIsize,
}

// SAFETY: Embree devices may be used from any thread (Embree manual, "Thread safety"): creating scenes and
// geometries is thread-safe, the callbacks only touch the mutex and the atomic of `CallbackState`.
unsafe impl Send for Made {}
// SAFETY: as above; no method hands out interior references.
unsafe impl Sync for Made {}

/// Largest number of triangles whose tree is built by one thread, in some 30 ms (`seconds.embree` of `mrvis solve scenes/real/valley.obj
/// --threads 1`, 131,648 triangles). Devices of one thread start no threads of Embree's task scheduler (oneTBB), which very rarely crashes
/// where many models are made in a row.
const MAX_SERIAL_TRIANGLES: usize = 100_000;

impl Device {
    /// Creates an Embree device for scenes of this number of triangles in all, which are built on the threads of the caller's pool.
    ///
    /// # Errors
    /// As [`Device::new`].
    pub fn for_triangles(count: usize) -> Result<Device> {
        Device::new(if count > MAX_SERIAL_TRIANGLES { rayon::current_num_threads() } else { 1 })
    }

    /// An Embree device with at most `threads` build threads (0: all cores).
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the library has another major version than the headers, or is older than they are.
    pub fn new(threads: usize) -> Result<Device> {
        let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
        let known = idle.iter().position(|made| made.threads == threads).map(|at| idle.swap_remove(at));
        drop(idle);
        let made = known.map_or_else(|| Made::new(threads), Ok)?;
        Ok(Device { used: Arc::new(Used(made)) })
    }

    /// Version of the library, `4.a.b`.
    pub fn version(&self) -> String {
        version_text(self.property(sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION))
    }

    /// Largest packet width that Embree supports natively on this machine: 16 (AVX-512), 8 (AVX2), 4 or 1 rays.
    pub fn native_width(&self) -> usize {
        use sys::RTCDeviceProperty as P;
        [
            (16, P::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED),
            (8, P::RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED),
            (4, P::RTC_DEVICE_PROPERTY_NATIVE_RAY4_SUPPORTED),
        ]
        .into_iter()
        .find_map(|(width, property)| (self.property(property) != 0).then_some(width))
        .unwrap_or(1)
    }

    pub(super) fn raw(&self) -> sys::RTCDevice {
        self.used.0.raw
    }

    /// Memory of all scenes of this device in bytes, as Embree reports it.
    pub fn bytes(&self) -> usize {
        self.used.0.state.bytes.load(Ordering::Relaxed).max(0) as usize
    }

    fn property(&self, property: sys::RTCDeviceProperty) -> isize {
        device_property(self.raw(), property)
    }

    /// Takes the first error since the last check. For set-up calls; ray queries report no errors.
    pub(super) fn check(&self) -> Result<()> {
        let mut first = self.used.0.state.first_error.lock().unwrap_or_else(PoisonError::into_inner);
        first.take().map_or(Ok(()), |(code, message)| Err(error_of(code, message)))
    }
}

impl Made {
    fn new(threads: usize) -> Result<Made> {
        // simd256 selects the 8-wide BVH on machines where Embree would choose 128-bit nodes.
        let config =
            CString::new(format!("threads={threads},frequency_level=simd256")).expect("no NUL inside");
        // SAFETY: `config` is a NUL-terminated string that outlives the call.
        let raw = unsafe { sys::rtcNewDevice(config.as_ptr()) };
        if raw.is_null() {
            // SAFETY: without a device this takes the error code of the thread.
            let code = unsafe { sys::rtcGetDeviceError(std::ptr::null_mut()) };
            return Err(error_of(
                code.0 as i32,
                format!("the device could not be created (code {})", code.0),
            ));
        }
        let found = device_property(raw, sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION);
        let wanted = sys::mrvis_headers_version() as isize;
        if found / 10_000 != wanted / 10_000 || found < wanted {
            // SAFETY: nothing else uses the device.
            unsafe { sys::rtcReleaseDevice(raw) };
            return Err(Error::Unsupported(format!(
                "Embree: the library is version {} but mrvis was compiled for {}; rebuild mrvis against the installed \
                 headers or install a library of that version",
                version_text(found),
                version_text(wanted)
            )));
        }
        let state: &'static CallbackState = Box::leak(Box::default());
        let user = (&raw const *state).cast_mut().cast::<c_void>();
        // SAFETY: `raw` is live; `user` points to the state, which is never freed.
        unsafe {
            sys::rtcSetDeviceErrorFunction(raw, Some(on_error), user);
            sys::rtcSetDeviceMemoryMonitorFunction(raw, Some(on_memory), user);
        }
        Ok(Made { raw, threads, state })
    }
}

impl Drop for Used {
    fn drop(&mut self) {
        // Of scenes that are gone.
        self.0.state.first_error.lock().unwrap_or_else(PoisonError::into_inner).take();
        IDLE.lock().unwrap_or_else(PoisonError::into_inner).push(self.0);
    }
}

fn device_property(raw: sys::RTCDevice, property: sys::RTCDeviceProperty) -> isize {
    // SAFETY: devices are live; unknown properties give 0 and an error, which `check` would report.
    unsafe { sys::rtcGetDeviceProperty(raw, property) }
}

/// The error of an Embree error code.
fn error_of(code: i32, message: String) -> Error {
    use sys::RTCError as E;
    match E(code as _) {
        E::RTC_ERROR_OUT_OF_MEMORY => Error::OutOfMemory(format!("Embree: {message}")),
        E::RTC_ERROR_CANCELLED => Error::Cancelled("stopped while Embree's tree was built".into()),
        E::RTC_ERROR_UNSUPPORTED_CPU => Error::Unsupported(format!("Embree: {message}")),
        _ => Error::Embree(message),
    }
}

fn version_text(v: isize) -> String {
    format!("{}.{}.{}", v / 10_000, v / 100 % 100, v % 100)
}

extern "C" fn on_error(user: *mut c_void, code: sys::RTCError, message: *const c_char) {
    // SAFETY: Embree passes back the pointer given with the callback, which outlives the device.
    let state = unsafe { &*user.cast::<CallbackState>() };
    let text = if message.is_null() {
        String::new()
    } else {
        // SAFETY: Embree passes a NUL-terminated string that is valid during the callback.
        unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()
    };
    let mut first = state.first_error.lock().unwrap_or_else(PoisonError::into_inner);
    first.get_or_insert_with(|| (code.0 as i32, format!("{text} (code {})", code.0)));
}

extern "C" fn on_memory(user: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: as in `on_error`.
    let state = unsafe { &*user.cast::<CallbackState>() };
    state.bytes.fetch_add(bytes, Ordering::Relaxed);
    true
}
