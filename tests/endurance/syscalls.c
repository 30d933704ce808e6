/* Counts the calls by which a process changes what other processes can see, and kills the process at one of them.
 *
 * kills.py loads this into every process of a run with LD_PRELOAD. Environment variables control it:
 *
 *   ENDURANCE_LOG     file to which every call appends a line: time in ns, role, pid, number, function, path
 *   ENDURANCE_ROLE    role of the process to kill: orchestrator, sim or host-NAME, where NAME is that of the policy
 *   ENDURANCE_CALL    name of the function at whose call it is killed
 *   ENDURANCE_PATH    pattern of the path that is passed to it, see fnmatch(3)
 *   ENDURANCE_NTH     which of these calls, counted from 1 in each process
 *   ENDURANCE_BEFORE  if set, the kill comes before that call instead of after it
 *   ENDURANCE_MARK    file that the killed process creates, so that its successor lives
 *
 * Failed calls count like others. Only functions of the C library are seen; a direct system call is not. The shim
 * itself makes direct system calls, so that it does not count its own. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <fnmatch.h>
#include <limits.h>
#include <signal.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

/* Descriptor of the log, out of the way of the program's own. */
enum { LOG_FD = 900 };

static char role[64];
static int log_fd = -1;
/* The call at which this process is killed, if `fatal_nth` is not 0. */
static const char *fatal_function, *fatal_path;
static long fatal_nth;
static bool before;
static const char *mark;
static atomic_long n_calls, n_matches;

/* Writes the role of this process into `role`: none for a program that is not part of a run. */
static void find_role(void) {
    static char line[1 << 16];
    int fd = (int)syscall(SYS_openat, AT_FDCWD, "/proc/self/cmdline", O_RDONLY | O_CLOEXEC);
    if (fd < 0) return;
    ssize_t n = syscall(SYS_read, fd, line, sizeof line - 1);
    syscall(SYS_close, fd);
    if (n <= 0) return;
    const char *subcommand = line + strlen(line) + 1;
    if (subcommand >= line + n) return;
    if (strcmp(subcommand, "run") == 0) strcpy(role, "orchestrator");
    if (strcmp(subcommand, "sim") == 0) strcpy(role, "sim");
    if (strcmp(subcommand, "reap") == 0) strcpy(role, "reaper");
    static const char key[] = "\"policy\":\"";
    const char *name = memmem(line, (size_t)n, key, sizeof key - 1);
    if (strcmp(subcommand, "policy-host") == 0 && name) {
        name += sizeof key - 1;
        snprintf(role, sizeof role, "host-%.*s", (int)strcspn(name, "\""), name);
    }
}

__attribute__((constructor)) static void start(void) {
    find_role();
    const char *path = getenv("ENDURANCE_LOG");
    if (path && *role) {
        int fd = (int)syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
        log_fd = (int)syscall(SYS_fcntl, fd, F_DUPFD_CLOEXEC, LOG_FD);
        syscall(SYS_close, fd);
    }
    const char *wanted = getenv("ENDURANCE_ROLE"), *nth = getenv("ENDURANCE_NTH");
    fatal_function = getenv("ENDURANCE_CALL");
    fatal_path = getenv("ENDURANCE_PATH");
    mark = getenv("ENDURANCE_MARK");
    before = getenv("ENDURANCE_BEFORE") != NULL;
    bool complete = wanted && nth && fatal_function && fatal_path && mark;
    if (complete && strcmp(wanted, role) == 0) fatal_nth = atol(nth);
}

static void record(long number, const char *function, const char *path) {
    if (log_fd < 0) return;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    long long ns = now.tv_sec * 1000000000LL + now.tv_nsec;
    char line[PATH_MAX + 256];
    int n = snprintf(line, sizeof line, "%lld\t%s\t%d\t%ld\t%s\t%s\n", ns, role, getpid(), number, function, path);
    if (n > 0 && (size_t)n < sizeof line) syscall(SYS_write, log_fd, line, n);
}

/* Kills this process, unless a predecessor has been killed already. */
static void die(const char *function, const char *path) {
    int fd = (int)syscall(SYS_openat, AT_FDCWD, mark, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd < 0) return;
    char text[PATH_MAX + 128];
    int n = snprintf(text, sizeof text, "%d\t%s\t%s\n", getpid(), function, path);
    if (n > 0 && (size_t)n < sizeof text) syscall(SYS_write, fd, text, n);
    syscall(SYS_kill, getpid(), SIGKILL);
    for (;;) pause();
}

/* Returns `true` if this is the call at which the process is to be killed. */
static bool is_fatal(const char *function, const char *path) {
    if (!fatal_nth || strcmp(function, fatal_function) != 0 || fnmatch(fatal_path, path, 0) != 0) return false;
    return atomic_fetch_add(&n_matches, 1) + 1 == fatal_nth;
}

/* The two halves of a counted call. `enter` returns `true` if the process is to be killed in `leave`. */
static bool enter(const char *function, const char *path) {
    int error = errno;
    record(atomic_fetch_add(&n_calls, 1) + 1, function, path);
    bool fatal = is_fatal(function, path);
    if (fatal && before) die(function, path);
    errno = error;
    return fatal;
}

static void leave(bool fatal, const char *function, const char *path) {
    int error = errno;
    if (fatal) die(function, path);
    errno = error;
}

/* Writes the path of a descriptor into `path`. */
static const char *path_of(int fd, char path[PATH_MAX]) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = syscall(SYS_readlinkat, AT_FDCWD, link, path, PATH_MAX - 1);
    path[n < 0 ? 0 : n] = 0;
    return path;
}

/* Writes `folder`'s path, unless the name stands alone, and `name` into `path`. */
static const char *path_below(int folder, const char *name, char path[PATH_MAX]) {
    if (folder == AT_FDCWD || *name == '/') return name;
    path_of(folder, path);
    size_t n = strlen(path);
    snprintf(path + n, PATH_MAX - n, "/%s", name);
    return path;
}

static bool is_regular(int fd) {
    struct stat info;
    return fd > 2 && fd != log_fd && fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
}

/* Makes the call `next(...)` as a counted one and returns its result. */
#define COUNT(function, path, ...)            \
    do {                                      \
        if (!*role) return next(__VA_ARGS__); \
        const char *shown = (path);           \
        bool fatal = enter(function, shown);  \
        int result = next(__VA_ARGS__);       \
        leave(fatal, function, shown);        \
        return result;                        \
    } while (0)

/* A function of a path alone, or of a path and a number. */
#define PATH(name)                                           \
    int name(const char *path) {                             \
        int (*next)(const char *) = dlsym(RTLD_NEXT, #name); \
        COUNT(#name, path, path);                            \
    }
#define PATH_AND(name, kind)                                       \
    int name(const char *path, kind value) {                       \
        int (*next)(const char *, kind) = dlsym(RTLD_NEXT, #name); \
        COUNT(#name, path, path, value);                           \
    }
PATH(rmdir)
PATH(remove)
PATH(unlink)
PATH_AND(mkdir, mode_t)
PATH_AND(chmod, mode_t)

int shm_unlink(const char *name) {
    int (*next)(const char *) = dlsym(RTLD_NEXT, "shm_unlink");
    char path[PATH_MAX];
    snprintf(path, sizeof path, "/dev/shm%s%s", *name == '/' ? "" : "/", name);
    COUNT("shm_unlink", path, name);
}

/* Of the calls that open a file, only those that may create one count. */
int shm_open(const char *name, int flags, mode_t mode) {
    int (*next)(const char *, int, mode_t) = dlsym(RTLD_NEXT, "shm_open");
    if (!(flags & O_CREAT)) return next(name, flags, mode);
    char path[PATH_MAX];
    snprintf(path, sizeof path, "/dev/shm%s%s", *name == '/' ? "" : "/", name);
    COUNT("shm_open", path, name, flags, mode);
}

#define OPEN(name)                                                              \
    int name(const char *path, int flags, ...) {                                \
        int (*next)(const char *, int, ...) = dlsym(RTLD_NEXT, #name);          \
        va_list rest;                                                           \
        va_start(rest, flags);                                                  \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
        va_end(rest);                                                           \
        if (!(flags & O_CREAT)) return next(path, flags, mode);                 \
        COUNT(#name, path, path, flags, mode);                                  \
    }
OPEN(open)
OPEN(open64)

#define OPENAT(name)                                                              \
    int name(int folder, const char *path, int flags, ...) {                      \
        int (*next)(int, const char *, int, ...) = dlsym(RTLD_NEXT, #name);       \
        va_list rest;                                                             \
        va_start(rest, flags);                                                    \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;   \
        va_end(rest);                                                             \
        if (!(flags & O_CREAT)) return next(folder, path, flags, mode);           \
        char whole[PATH_MAX];                                                     \
        COUNT(#name, path_below(folder, path, whole), folder, path, flags, mode); \
    }
OPENAT(openat)
OPENAT(openat64)

int creat(const char *path, mode_t mode) {
    int (*next)(const char *, mode_t) = dlsym(RTLD_NEXT, "creat");
    COUNT("creat", path, path, mode);
}

#define FD_AND(name, kind)                                \
    int name(int fd, kind value) {                        \
        int (*next)(int, kind) = dlsym(RTLD_NEXT, #name); \
        char path[PATH_MAX];                              \
        COUNT(#name, path_of(fd, path), fd, value);       \
    }
FD_AND(ftruncate, off_t)
FD_AND(ftruncate64, off64_t)
FD_AND(fchmod, mode_t)
FD_AND(flock, int)

#define ALLOCATE(name)                                            \
    int name(int fd, off_t offset, off_t length) {                \
        int (*next)(int, off_t, off_t) = dlsym(RTLD_NEXT, #name); \
        char path[PATH_MAX];                                      \
        COUNT(#name, path_of(fd, path), fd, offset, length);      \
    }
ALLOCATE(posix_fallocate)
ALLOCATE(posix_fallocate64)

#define FALLOCATE(name)                                                \
    int name(int fd, int mode, off_t offset, off_t length) {           \
        int (*next)(int, int, off_t, off_t) = dlsym(RTLD_NEXT, #name); \
        char path[PATH_MAX];                                           \
        COUNT(#name, path_of(fd, path), fd, mode, offset, length);     \
    }
FALLOCATE(fallocate)
FALLOCATE(fallocate64)

int mkdirat(int folder, const char *path, mode_t mode) {
    int (*next)(int, const char *, mode_t) = dlsym(RTLD_NEXT, "mkdirat");
    char whole[PATH_MAX];
    COUNT("mkdirat", path_below(folder, path, whole), folder, path, mode);
}

int unlinkat(int folder, const char *path, int flags) {
    int (*next)(int, const char *, int) = dlsym(RTLD_NEXT, "unlinkat");
    char whole[PATH_MAX];
    COUNT("unlinkat", path_below(folder, path, whole), folder, path, flags);
}

int fchmodat(int folder, const char *path, mode_t mode, int flags) {
    int (*next)(int, const char *, mode_t, int) = dlsym(RTLD_NEXT, "fchmodat");
    char whole[PATH_MAX];
    COUNT("fchmodat", path_below(folder, path, whole), folder, path, mode, flags);
}

/* Functions of two paths are shown with the second, which is the new name. */
#define TWO_PATHS(name)                                                    \
    int name(const char *old, const char *path) {                          \
        int (*next)(const char *, const char *) = dlsym(RTLD_NEXT, #name); \
        COUNT(#name, path, old, path);                                     \
    }
TWO_PATHS(rename)
TWO_PATHS(link)
TWO_PATHS(symlink)

int renameat(int old_folder, const char *old, int folder, const char *path) {
    int (*next)(int, const char *, int, const char *) = dlsym(RTLD_NEXT, "renameat");
    char whole[PATH_MAX];
    COUNT("renameat", path_below(folder, path, whole), old_folder, old, folder, path);
}

int linkat(int old_folder, const char *old, int folder, const char *path, int flags) {
    int (*next)(int, const char *, int, const char *, int) = dlsym(RTLD_NEXT, "linkat");
    char whole[PATH_MAX];
    COUNT("linkat", path_below(folder, path, whole), old_folder, old, folder, path, flags);
}

int symlinkat(const char *old, int folder, const char *path) {
    int (*next)(const char *, int, const char *) = dlsym(RTLD_NEXT, "symlinkat");
    char whole[PATH_MAX];
    COUNT("symlinkat", path_below(folder, path, whole), old, folder, path);
}

/* Of the operations of fcntl, only those that acquire or release a lock count. */
#define FCNTL(name)                                                                             \
    int name(int fd, int operation, ...) {                                                      \
        int (*next)(int, int, ...) = dlsym(RTLD_NEXT, #name);                                   \
        va_list rest;                                                                           \
        va_start(rest, operation);                                                              \
        void *value = va_arg(rest, void *);                                                     \
        va_end(rest);                                                                           \
        bool locks = operation == F_SETLK || operation == F_SETLKW || operation == F_OFD_SETLK; \
        if (!locks) return next(fd, operation, value);                                          \
        char path[PATH_MAX];                                                                    \
        COUNT(#name, path_of(fd, path), fd, operation, value);                                  \
    }
FCNTL(fcntl)
FCNTL(fcntl64)

int bind(int fd, const struct sockaddr *address, socklen_t length) {
    int (*next)(int, const struct sockaddr *, socklen_t) = dlsym(RTLD_NEXT, "bind");
    bool local = address->sa_family == AF_UNIX;
    COUNT("bind", local ? ((const struct sockaddr_un *)address)->sun_path : "", fd, address, length);
}

#define SPAWN(name)                                                                                       \
    int name(pid_t *pid, const char *path, const posix_spawn_file_actions_t *actions,                     \
             const posix_spawnattr_t *attributes, char *const arguments[], char *const environment[]) {   \
        int (*next)(pid_t *, const char *, const posix_spawn_file_actions_t *, const posix_spawnattr_t *, \
                    char *const[], char *const[]) = dlsym(RTLD_NEXT, #name);                              \
        COUNT(#name, arguments[0] && arguments[1] ? arguments[1] : path, pid, path, actions, attributes,  \
              arguments, environment);                                                                    \
    }
SPAWN(posix_spawn)
SPAWN(posix_spawnp)

/* Writes count if they go to regular files. The sim's first report of a finished episode is logged as call 0. */
ssize_t write(int fd, const void *bytes, size_t n) {
    ssize_t (*next)(int, const void *, size_t) = dlsym(RTLD_NEXT, "write");
    static const char finished[] = "{\"finished\":";
    if (fd == 1 && *role && memmem(bytes, n, finished, sizeof finished - 1)) record(0, "finished", "");
    if (!*role || !is_regular(fd)) return next(fd, bytes, n);
    char path[PATH_MAX];
    path_of(fd, path);
    bool fatal = enter("write", path);
    ssize_t result = next(fd, bytes, n);
    leave(fatal, "write", path);
    return result;
}

#define PWRITE(name)                                                                 \
    ssize_t name(int fd, const void *bytes, size_t n, off_t offset) {                \
        ssize_t (*next)(int, const void *, size_t, off_t) = dlsym(RTLD_NEXT, #name); \
        if (!*role) return next(fd, bytes, n, offset);                               \
        char path[PATH_MAX];                                                         \
        path_of(fd, path);                                                           \
        bool fatal = enter(#name, path);                                             \
        ssize_t result = next(fd, bytes, n, offset);                                 \
        leave(fatal, #name, path);                                                   \
        return result;                                                               \
    }
PWRITE(pwrite)
PWRITE(pwrite64)
