//! The heap of a process that computes networks.
#![cfg_attr(
    all(target_os = "linux", target_env = "gnu"),
    expect(unsafe_code, reason = "settings of the C library's allocator")
)]

/// Keeps freed memory for the tensors to come, once in a process: each step needs as much again. By default glibc returns large pieces to
/// the system, which then clears them anew: 6 to 16 % of the time of a plan or of a training step.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(super) fn keep_freed() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    /// Pieces up to this size come from the heap, and its free end above it is returned.
    const KEPT: i32 = 1 << 30;
    /// Variables by which a user has decided.
    const DECIDED: [&str; 3] = ["MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "GLIBC_TUNABLES"];
    /// The largest threshold that glibc before 2.35 takes.
    const OLD_LIMIT: i32 = 32 << 20;
    // SAFETY: `mallopt` takes two numbers, and locks what it changes.
    let set = |setting, value| unsafe { libc::mallopt(setting, value) } == 1;
    ONCE.call_once(|| {
        if DECIDED.iter().any(|name| std::env::var_os(name).is_some()) {
            return;
        }
        // One that is refused leaves the default.
        let _ = set(libc::M_MMAP_THRESHOLD, KEPT) || set(libc::M_MMAP_THRESHOLD, OLD_LIMIT);
        let _ = set(libc::M_TRIM_THRESHOLD, KEPT);
    });
}

/// Other allocators keep it by themselves, or have no such setting.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn keep_freed() {}
