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
    /// The most that is kept.
    const KEPT: i32 = 1 << 30;
    /// The largest threshold that glibc before 2.35 takes.
    const OLD_LIMIT: i32 = 32 << 20;
    // SAFETY: `mallopt` takes two numbers, and locks what it changes.
    let set = |setting, value| unsafe { libc::mallopt(setting, value) } == 1;
    ONCE.call_once(|| {
        // One that is refused leaves the default.
        let _ = set(libc::M_MMAP_THRESHOLD, KEPT) || set(libc::M_MMAP_THRESHOLD, OLD_LIMIT);
        let _ = set(libc::M_TRIM_THRESHOLD, KEPT);
    });
}

/// Other allocators keep it by themselves, or have no such setting.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn keep_freed() {}
