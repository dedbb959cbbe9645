/* SPDX-License-Identifier: BSD-3-Clause */
/* The page: all files of one folder, read once. A path is looked up among these names, so none leads
 * elsewhere. And how that, and answers, are zipped. */
#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include <zlib.h>

#include "http.h"

#define FILES_MAX   256
#define FILE_MAX    (8 << 20)
#define GRAPHIC_MAX (1 << 20)
#define DEPTH       4
#define ZIP_FROM    2048 /* bytes of an answer */

struct files {
    struct file at[FILES_MAX];
    size_t n;
};

static const char *media_type_of(const char *path)
{
    static const char *const types[][2] = {{".html", "text/html; charset=utf-8"},
                                           {".js", "text/javascript; charset=utf-8"},
                                           {".css", "text/css; charset=utf-8"},
                                           {".json", "application/json"},
                                           {".svg", "image/svg+xml"},
                                           {".png", "image/png"},
                                           {".ico", "image/x-icon"},
                                           {".woff2", "font/woff2"},
                                           {".txt", "text/plain; charset=utf-8"},
                                           {".webmanifest", "application/manifest+json"},
                                           {".map", "application/json"}};
    const char *ending = strrchr(path, '.');
    for (size_t i = 0; ending && i < sizeof types / sizeof *types; i++)
        if (!strcmp(ending, types[i][0]))
            return types[i][1];
    return "application/octet-stream";
}

/* app-1A2B3C4D.js: a name that changes with what is in the file. */
static bool has_hash(const char *path)
{
    const char *ending = strrchr(path, '.'), *at = ending;
    while (at && at > path &&
           ((at[-1] >= '0' && at[-1] <= '9') || (at[-1] >= 'A' && at[-1] <= 'Z') ||
            (at[-1] >= 'a' && at[-1] <= 'z')))
        at--;
    return at && at > path && (at[-1] == '-' || at[-1] == '.') && ending - at >= 8;
}

char *zip(const char *data, size_t n, int level, size_t *n_zipped)
{
    z_stream z = {0};
    if (n < 256 || deflateInit2(&z, level, Z_DEFLATED, 15 + 16, 9, Z_DEFAULT_STRATEGY) != Z_OK)
        return NULL;
    char *out = malloc(n);
    z.next_in = (Bytef *)(uintptr_t)data;
    z.avail_in = (uInt)n;
    z.next_out = (Bytef *)out;
    z.avail_out = (uInt)n;
    bool smaller = out && deflate(&z, Z_FINISH) == Z_STREAM_END;
    *n_zipped = z.total_out;
    deflateEnd(&z);
    if (!smaller)
        free(out);
    return smaller ? out : NULL;
}

/* Is @p name among the codings of an Accept-Encoding header: 1; with q=0, which refuses it: 0; else -1. */
static int coding_wanted(const char *accept, const char *name)
{
    while (*accept) {
        accept += strspn(accept, " \t,");
        const size_t n = strcspn(accept, " \t;,"), end = strcspn(accept, ",");
        const char *q = memchr(accept, '=', end);
        if (n == strlen(name) && !strncasecmp(accept, name, n))
            return !q || strtod(q + 1, NULL) > 0;
        accept += end;
    }
    return -1;
}

bool request_takes_zip(const struct request *r)
{
    const char *accept = request_header(r, "Accept-Encoding");
    const int named = accept ? coding_wanted(accept, "gzip") : 0;
    return named < 0 ? coding_wanted(accept, "*") > 0 : named > 0;
}

/* A short answer is sent as soon as it would be zipped, and tells nobody by its length what a secret in it
 * is. */
void zip_reply(struct request *r)
{
    size_t n = 0;
    if (r->zipped || r->reply.failed || r->reply.n < ZIP_FROM || !request_takes_zip(r))
        return;
    char *zipped = zip(r->reply.at, r->reply.n, 1, &n);
    if (!zipped)
        return;
    text_free(&r->reply);
    r->reply = (struct text){.at = zipped, .n = n};
    r->zipped = true;
}

static char *etag(const char *data, size_t n)
{
    uint64_t hash = UINT64_C(14695981039346656037); /* FNV-1a */
    char text[40];
    for (size_t i = 0; i < n; i++)
        hash = (hash ^ (unsigned char)data[i]) * UINT64_C(1099511628211);
    snprintf(text, sizeof text, "\"%016" PRIx64 "-%zx\"", hash, n);
    return strdup(text);
}

static int load_file(struct files *files, const char *name, const char *path, size_t size,
                     struct apc_error *why)
{
    struct file *file = &files->at[files->n];
    char *data = malloc(size + 1);
    FILE *in = fopen(name, "re");
    size_t n = in && data ? fread(data, 1, size, in) : 0;
    bool ok = in && data && n == size;
    if (in)
        fclose(in);
    if (!ok) {
        free(data);
        return apc_fail(why, APC_ESYS, "%s: cannot be read: %s", name, strerror(errno));
    }
    files->n++;
    *file = (struct file){.path = strdup(path),
                          .type = media_type_of(path),
                          .etag = etag(data, n),
                          .immutable = has_hash(path),
                          .data = data,
                          .n = n};
    file->zipped = zip(data, n, 9, &file->n_zipped);
    return file->path && file->etag ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
}

int graphic_load(struct text *graphic, const char *path, struct apc_error *why)
{
    char part[4096];
    FILE *in = fopen(path, "re");
    if (!in)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", path, strerror(errno));
    for (size_t n; graphic->n <= GRAPHIC_MAX && (n = fread(part, 1, sizeof part, in)) > 0;)
        text_put(graphic, part, n);
    int rc = ferror(in) || graphic->n == 0 ? apc_fail(why, APC_ESYS, "%s: cannot be read, or is empty", path)
             : graphic->failed             ? apc_fail(why, APC_ENOMEM, "out of memory")
             : graphic->n > GRAPHIC_MAX
                 ? apc_fail(why, APC_ERANGE, "%s: a drawing has at most %d MiB", path, GRAPHIC_MAX >> 20)
                 : 0;
    fclose(in);
    if (rc < 0)
        text_free(graphic);
    return rc;
}

static int load_folder(struct files *files, const char *folder, const char *path, int depth,
                       struct apc_error *why)
{
    char name[4096], inner[1024];
    struct stat st;
    struct dirent *entry;
    int rc = 0;
    DIR *dir = opendir(folder);
    if (!dir)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", folder, strerror(errno));
    while (rc == 0 && (entry = readdir(dir)) != NULL) {
        if (entry->d_name[0] == '.')
            continue;
        snprintf(name, sizeof name, "%s/%s", folder, entry->d_name);
        snprintf(inner, sizeof inner, "%s/%s", path, entry->d_name);
        if (stat(name, &st) < 0)
            continue;
        if (S_ISDIR(st.st_mode) && depth < DEPTH)
            rc = load_folder(files, name, inner, depth + 1, why);
        else if (S_ISREG(st.st_mode) && (st.st_size > FILE_MAX || files->n == FILES_MAX))
            rc = apc_fail(why, APC_ERANGE, "%s: more than %d files, or one larger than %d MiB", name,
                          FILES_MAX, FILE_MAX >> 20);
        else if (S_ISREG(st.st_mode))
            rc = load_file(files, name, inner, (size_t)st.st_size, why);
    }
    closedir(dir);
    return rc;
}

int files_load(struct files **files, const char *folder, struct apc_error *why)
{
    *files = calloc(1, sizeof **files);
    return *files ? load_folder(*files, folder, "", 0, why) : APC_ENOMEM;
}

void files_free(struct files *files)
{
    for (size_t i = 0; files && i < files->n; i++) {
        const struct file *f = &files->at[i];
        const void *parts[] = {f->path, f->etag, f->data, f->zipped};
        for (size_t k = 0; k < sizeof parts / sizeof *parts; k++)
            free((void *)(uintptr_t)parts[k]);
    }
    free(files);
}

size_t files_count(const struct files *files)
{
    return files->n;
}

const struct file *files_find(const struct files *files, const char *path)
{
    if (!strcmp(path, "/"))
        path = "/index.html";
    for (size_t i = 0; i < files->n; i++)
        if (!strcmp(files->at[i].path, path))
            return &files->at[i];
    return NULL;
}
