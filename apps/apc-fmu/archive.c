/* SPDX-License-Identifier: BSD-3-Clause */
/* What an FMU is packed in. Nothing of it is trusted: names stay within the folder, sizes are what they say
 * and not beyond a limit, and there are plain files and folders only. */
#include "fmu.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#define ENTRIES_MAX 20000
#define SIZE_MAX_B  (UINT64_C(1) << 30) /* of all that is unpacked */
#define NAME_MAX_B  1024

struct archive {
    zip_t *zip;
    zip_uint64_t n;
};

static char unpacked[256]; /* "": nothing is */

/* A part ".." leads out, as does a root. */
static bool stays_within(const char *name)
{
    if (!name[0] || name[0] == '/' || strchr(name, '\\') || strlen(name) > NAME_MAX_B)
        return false;
    for (const char *part = name; part; part = strchr(part, '/') ? strchr(part, '/') + 1 : NULL) {
        const size_t n = strcspn(part, "/");
        if ((n == 2 && memcmp(part, "..", 2) == 0) || (n == 1 && part[0] == '.'))
            return false;
    }
    return true;
}

static void check_archive_entry(const struct archive *a, zip_uint64_t i, uint64_t *total)
{
    zip_stat_t about;
    zip_uint8_t system;
    zip_uint32_t attributes;
    const zip_uint64_t needed = ZIP_STAT_NAME | ZIP_STAT_SIZE;

    if (zip_stat_index(a->zip, i, 0, &about) < 0 || (about.valid & needed) != needed)
        refuse_fmu("the archive is damaged: entry %llu of it cannot be read", (unsigned long long)i + 1);
    if (!stays_within(about.name))
        refuse_fmu("the archive holds \"%.80s\", a path that leads out of its folder: it is not unpacked",
                   about.name);
    if (zip_file_get_external_attributes(a->zip, i, 0, &system, &attributes) == 0 &&
        system == ZIP_OPSYS_UNIX && S_ISLNK(attributes >> 16))
        refuse_fmu("the archive holds \"%.80s\", a symbolic link: it is not unpacked", about.name);
    if (about.size > SIZE_MAX_B || (*total += about.size) > SIZE_MAX_B)
        refuse_fmu("the archive would be more than %llu MiB when unpacked: it is not",
                   (unsigned long long)(SIZE_MAX_B >> 20));
}

struct archive *archive_open(const char *path)
{
    struct archive *const a = room(1, sizeof *a);
    uint64_t total = 0;
    int code = 0;

    a->zip = zip_open(path, ZIP_RDONLY, &code);
    if (!a->zip) {
        zip_error_t error;
        zip_error_init_with_code(&error, code);
        refuse_fmu("cannot be read as an archive (zip), which an FMU is: %s", zip_error_strerror(&error));
    }
    const zip_int64_t n = zip_get_num_entries(a->zip, 0);
    if (n < 1 || n > ENTRIES_MAX)
        refuse_fmu("the archive has %lld entries; 1 to %d are expected", (long long)n, ENTRIES_MAX);
    a->n = (zip_uint64_t)n;
    for (zip_uint64_t i = 0; i < a->n; i++)
        check_archive_entry(a, i, &total);
    return a;
}

void archive_close(struct archive *a)
{
    zip_discard(a->zip);
    free(a);
}

bool archive_has(const struct archive *a, const char *name)
{
    return zip_name_locate(a->zip, name, 0) >= 0;
}

void archive_folders(const struct archive *a, const char *folder, char *text, size_t size)
{
    const size_t length = strlen(folder);
    size_t used = 0;

    text[0] = '\0';
    for (zip_uint64_t i = 0; i < a->n && used < size; i++) {
        const char *const name = zip_get_name(a->zip, i, 0);
        char one[64];
        const char *const slash =
            name && strncmp(name, folder, length) == 0 ? strchr(name + length, '/') : NULL;
        if (!slash || !slash[1] || strchr(slash + 1, '/')) /* no file in such a folder */
            continue;
        snprintf(one, sizeof one, "%.*s", (int)(slash - name - (ptrdiff_t)length), name + length);
        const char *const told = strstr(text, one);
        if (told && (told == text || told[-1] == ' ') && strchr(",", told[strlen(one)]))
            continue;
        used += (size_t)snprintf(text + used, size - used, "%s%s", used ? ", " : "", one);
    }
}

/* As much as it says that it is, and not a byte more. */
static void copy_archive_entry(const struct archive *a, zip_uint64_t i,
                               void (*to)(void *ctx, const void *, size_t), void *ctx)
{
    char block[65536];
    zip_stat_t about;
    zip_file_t *const in = zip_stat_index(a->zip, i, 0, &about) == 0 ? zip_fopen_index(a->zip, i, 0) : NULL;
    uint64_t total = 0;
    zip_int64_t n = in ? 1 : -1;

    while (n > 0 && total <= about.size) {
        n = zip_fread(in, block, sizeof block);
        if (n > 0 && (total += (uint64_t)n) <= about.size)
            to(ctx, block, (size_t)n);
    }
    if (n < 0 || total != about.size)
        refuse_fmu("the archive is damaged: \"%.80s\" is not what it says", zip_get_name(a->zip, i, 0));
    zip_fclose(in);
}

struct memory {
    char *at;
    size_t n;
};

static void to_memory(void *ctx, const void *from, size_t n)
{
    struct memory *const m = ctx;
    memcpy(m->at + m->n, from, n);
    m->n += n;
}

char *archive_text(const struct archive *a, const char *name, size_t *length)
{
    const zip_int64_t i = zip_name_locate(a->zip, name, 0);
    struct memory m = {0};
    zip_stat_t about;

    if (i < 0 || zip_stat_index(a->zip, (zip_uint64_t)i, 0, &about) < 0)
        refuse_fmu("holds no %s: it is no FMU", name);
    m.at = room(about.size + 1, 1);
    copy_archive_entry(a, (zip_uint64_t)i, to_memory, &m);
    *length = m.n;
    return m.at;
}

/* ---- Unpacking ----------------------------------------------------------------------------- */

static void to_file(void *ctx, const void *from, size_t n)
{
    const char *at = from;
    if (asker_gone())
        refuse_fmu("nobody waits for it any more");
    while (n > 0) {
        const ssize_t written = write(*(const int *)ctx, at, n);
        if (written < 0 && errno == EINTR)
            continue;
        if (written < 0)
            refuse_fmu("cannot be unpacked into %s (TMPDIR says where): %s", unpacked, strerror(errno));
        at += written;
        n -= (size_t)written;
    }
}

static void unpack(const struct archive *a, zip_uint64_t i)
{
    const char *const name = zip_get_name(a->zip, i, 0);
    char path[sizeof unpacked + NAME_MAX_B + 2];

    snprintf(path, sizeof path, "%s/%s", unpacked, name);
    for (char *slash = path + strlen(unpacked) + 1; (slash = strchr(slash, '/')); slash++) {
        *slash = '\0';
        if (mkdir(path, 0700) < 0 && errno != EEXIST)
            refuse_fmu("cannot be unpacked: %s: %s", path, strerror(errno));
        *slash = '/';
    }
    if (name[strlen(name) - 1] == '/')
        return;
    int out = open(path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0700);
    if (out < 0)
        refuse_fmu("cannot be unpacked: %s: %s", path, strerror(errno));
    copy_archive_entry(a, i, to_file, &out);
    close(out);
}

const char *archive_unpack(const struct archive *a, const char *const *folders, size_t n)
{
    const char *const named = getenv("TMPDIR");
    char *const whole = realpath(named && *named ? named : "/tmp", NULL);

    if (whole)
        snprintf(unpacked, sizeof unpacked, "%s/apc-fmu-XXXXXX", whole);
    if (!whole || !mkdtemp(unpacked)) {
        unpacked[0] = '\0';
        refuse_fmu("no folder to unpack it into (TMPDIR says where): %s", strerror(errno));
    }
    free(whole);
    /* Who tidies up temporary folders by their age leaves one alone that is locked. */
    (void)flock(open(unpacked, O_RDONLY | O_DIRECTORY | O_CLOEXEC), LOCK_EX | LOCK_NB);
    for (zip_uint64_t i = 0; i < a->n; i++) {
        const char *const name = zip_get_name(a->zip, i, 0);
        bool wanted = strcmp(name, "modelDescription.xml") == 0;
        for (size_t k = 0; k < n; k++)
            wanted |= strncmp(name, folders[k], strlen(folders[k])) == 0;
        if (wanted)
            unpack(a, i);
    }
    return unpacked;
}

static int drop_extracted(const char *path, const struct stat *about, int kind, struct FTW *walk)
{
    (void)about;
    (void)kind;
    (void)walk;
    (void)remove(path);
    return 0;
}

void archive_remove(void)
{
    if (unpacked[0])
        (void)nftw(unpacked, drop_extracted, 16, FTW_DEPTH | FTW_PHYS);
    unpacked[0] = '\0';
}
