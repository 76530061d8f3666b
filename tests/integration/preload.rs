//! A library that is loaded before the C library and lets calls of the system fail, as the file systems of clusters, full disks and kills do. It
//! is compiled by the test; where there is no C compiler, tests that need it are left out with a message.

#![cfg(target_os = "linux")]

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::Folder;

const SOURCE: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

/* Whether the open file lies on the disk that is full: below the folder that this variable names. */
static int is_full(int file) {
    const char *folder = getenv("SWM_TEST_FULL");
    char link[64], path[4096];
    ssize_t len;
    if (!folder) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    len = readlink(link, path, sizeof path - 1);
    return len > 0 && (size_t)len >= strlen(folder) && !strncmp(path, folder, strlen(folder));
}

ssize_t write(int file, const void *bytes, size_t len) {
    static ssize_t (*real)(int, const void *, size_t);
    if (is_full(file)) { errno = ENOSPC; return -1; }
    if (!real) real = (ssize_t (*)(int, const void *, size_t))dlsym(RTLD_NEXT, "write");
    return real(file, bytes, len);
}

ssize_t writev(int file, const struct iovec *parts, int count) {
    static ssize_t (*real)(int, const struct iovec *, int);
    if (is_full(file)) { errno = ENOSPC; return -1; }
    if (!real) real = (ssize_t (*)(int, const struct iovec *, int))dlsym(RTLD_NEXT, "writev");
    return real(file, parts, count);
}

/* Whether the process is killed amid this write, which the variable counts: one of HDF5's blocks of a dataset, over a page's end. */
static int is_torn(const void *bytes, size_t len, size_t in_page) {
    static long left = -1;
    static int is_known;
    const char *count = getenv("SWM_TEST_TEAR");
    if (!is_known) { is_known = 1; left = count ? atol(count) : -1; }
    if (left < 0 || len <= in_page || len < 4) return 0;
    if (memcmp(bytes, "EA", 2) && memcmp(bytes, "OHDR", 4) && memcmp(bytes, "OCHK", 4)) return 0;
    return left-- == 0;
}

ssize_t pwrite64(int file, const void *bytes, size_t len, off64_t at) {
    static ssize_t (*real)(int, const void *, size_t, off64_t);
    size_t in_page = 4096 - at % 4096;
    if (is_full(file)) { errno = ENOSPC; return -1; }
    if (!real) real = (ssize_t (*)(int, const void *, size_t, off64_t))dlsym(RTLD_NEXT, "pwrite64");
    if (is_torn(bytes, len, in_page)) { real(file, bytes, in_page, at); raise(SIGKILL); }
    return real(file, bytes, len, at);
}

ssize_t pwrite(int file, const void *bytes, size_t len, off_t at) {
    return pwrite64(file, bytes, len, at);
}

/* Locks that are not there: the variable is the number of the error. */
int flock(int file, int operation) {
    static int (*real)(int, int);
    const char *error = getenv("SWM_TEST_FLOCK");
    if (error) { errno = atoi(error); return -1; }
    if (!real) real = (int (*)(int, int))dlsym(RTLD_NEXT, "flock");
    return real(file, operation);
}
"#;

/// The library, as long as this lives.
pub(crate) struct Preload {
    _folder: Folder,
    library: PathBuf,
}

impl Preload {
    /// Compiles the library; `None`, with a message, where there is no C compiler.
    pub(crate) fn new() -> Option<Self> {
        let folder = Folder::new();
        let (source, library) = (folder.path("preload.c"), folder.path("preload.so"));
        std::fs::write(&source, SOURCE).expect("the folder is ours");
        let made = Command::new("cc").args(["-shared", "-fPIC", "-o", &library, &source, "-ldl"]).output();
        match made {
            Ok(made) => assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr)),
            Err(error) => {
                eprintln!("skipped: `cc` cannot be started ({error})");
                return None;
            }
        }
        Some(Self { _folder: folder, library: library.into() })
    }

    /// A command for which the disk below `folder` is full.
    pub(crate) fn full(&self, mut command: Command, folder: &str) -> Command {
        let folder = Path::new(folder).canonicalize().expect("the folder is there");
        command.env("LD_PRELOAD", &self.library).env("SWM_TEST_FULL", folder);
        command
    }

    /// A command that is killed amid the write of a block of a dataset in HDF5, when `count` others have been written.
    pub(crate) fn torn(&self, mut command: Command, count: usize) -> Command {
        command.env("LD_PRELOAD", &self.library).env("SWM_TEST_TEAR", count.to_string());
        command
    }

    /// A command for which locks fail with the error `number`.
    pub(crate) fn without_locks(&self, mut command: Command, number: i32) -> Command {
        command.env("LD_PRELOAD", &self.library).env("SWM_TEST_FLOCK", number.to_string());
        command
    }
}
