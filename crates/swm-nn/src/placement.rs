//! Where the work around a network is done: optimizers, noise, the normalization of images, groups of candidates.
//!
//! On a CPU, loops of the host share the network's memory, and their bits do not depend on threads. Any other device gets
//! operations of its own, for which the host does not wait.

use burn::backend::DispatchDevice;
use burn::tensor::Device;

/// Who does the work around a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// Loops of the host, which is the device.
    Host,
    /// Operations of the device.
    Device,
}

impl Placement {
    /// The one for networks on `device`.
    pub fn of(device: &Device) -> Self {
        #[cfg(any(test, feature = "testing"))]
        if FORCED.get() {
            return Self::Device;
        }
        match device.clone().inner().as_dispatch() {
            DispatchDevice::Flex(_) => Self::Host,
            _ => Self::Device,
        }
    }
}

#[cfg(any(test, feature = "testing"))]
thread_local! {
    static FORCED: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Does the work of this thread as on any other device than the CPU, by the CPU's tensor operations: for tests. One at a
/// time, since they share the generator.
#[cfg(any(test, feature = "testing"))]
pub fn as_on_a_device<T>(work: impl FnOnce() -> T) -> T {
    struct Reset;
    impl Drop for Reset {
        fn drop(&mut self) {
            FORCED.set(false);
        }
    }
    static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let _reset = Reset;
    FORCED.set(true);
    work()
}
