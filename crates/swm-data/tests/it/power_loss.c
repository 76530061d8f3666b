/* Keeps what a power loss would leave: whenever a file is synced, its content, and whenever a folder is, its entries.
 * What is written and never synced is in neither. Loaded before the C library (LD_PRELOAD) by power_loss.rs.
 *
 * SWM_TEST_DISK names the folder of what is kept, by inode and time of birth. */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { NAME = 64, PATH = 4096 };

static int name_of(int folder, const char *path, char name[NAME], int *is_folder) {
    struct statx there;
    int flags = AT_SYMLINK_NOFOLLOW | (*path ? 0 : AT_EMPTY_PATH);
    if (statx(folder, path, flags, STATX_BASIC_STATS | STATX_BTIME, &there)) return -1;
    snprintf(name, NAME, "%llu.%lld.%u", (unsigned long long)there.stx_ino, (long long)there.stx_btime.tv_sec,
             there.stx_btime.tv_nsec);
    *is_folder = S_ISDIR(there.stx_mode);
    return 0;
}

static void list_folder(const char *path, FILE *out) {
    DIR *folder = opendir(path);
    struct dirent *entry;
    while (folder && (entry = readdir(folder))) {
        char name[NAME];
        int is_folder;
        if (strcmp(entry->d_name, ".") && strcmp(entry->d_name, "..") &&
            !name_of(dirfd(folder), entry->d_name, name, &is_folder))
            fprintf(out, "%s %s %s\n", name, is_folder ? "folder" : "file", entry->d_name);
    }
    if (folder) closedir(folder);
}

static void copy_file(const char *path, FILE *out) {
    char bytes[1 << 16];
    FILE *file = fopen(path, "rb");
    size_t count;
    while (file && (count = fread(bytes, 1, sizeof bytes, file))) fwrite(bytes, 1, count, out);
    if (file) fclose(file);
}

static void keep(int fd) {
    const char *disk = getenv("SWM_TEST_DISK");
    char name[NAME], own[NAME], kept[PATH], draft[PATH + 16];
    int is_folder;
    if (!disk || name_of(fd, "", name, &is_folder)) return;
    snprintf(own, sizeof own, "/proc/self/fd/%d", fd);
    snprintf(kept, sizeof kept, "%s/%s", disk, name);
    /* Threads sync at the same time. */
    snprintf(draft, sizeof draft, "%s.%d", kept, fd);
    FILE *out = fopen(draft, "wb");
    if (!out) abort();
    if (is_folder) list_folder(own, out); else copy_file(own, out);
    if (fclose(out) || rename(draft, kept)) abort();
}

static int sync_by(const char *call, int fd) {
    int (*real)(int) = (int (*)(int))dlsym(RTLD_NEXT, call);
    int failed = real(fd);
    if (!failed) keep(fd);
    return failed;
}

int fsync(int fd) { return sync_by("fsync", fd); }
int fdatasync(int fd) { return sync_by("fdatasync", fd); }
