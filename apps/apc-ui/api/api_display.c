/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Displays: drawings that people make of the plant, in a folder beside the experiment file. A version is a file,
 * NAME.0001.svg, and never changes: link() makes it whole or not at all, and fails where another one was first. Who made it, when
 * and why stands behind the drawing, in a comment; what other programs put there has none.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "apc-ui/api/api.h"
#include "files/files.h"

#define PATH_LEN    (sizeof((struct ui *)0)->displays + 80)
#define FIRST       "overview" /* whose version 0 is the drawing beside the experiment file */
#define DISPLAY_LEN 41
#define VERSIONS    9999
#define SVG_MAX     (1 << 20)
#define TAIL_MAX    8192
#define TITLE_MAX   160 /* bytes: 40 characters of any language */
#define COMMENT_MAX 400
#define MARK        "<!-- apc-display "
#define END         "</svg>"

struct display {
    char name[DISPLAY_LEN];
    int64_t version;
    json_t *about; /* title, level, author, time, comment; NULL: nothing is known */
};

struct displays {
    struct display *at;
    size_t n;
};

static void displays_free(struct displays *all)
{
    for (size_t i = 0; i < all->n; i++)
        json_decref(all->at[i].about);
    free(all->at);
}

static bool display_named(const char *name)
{
    const size_t n = strlen(name);
    return n > 0 && n < DISPLAY_LEN && name[0] != '-' &&
           strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") == n;
}

static void display_path(const struct ui *ui, const char *name, int64_t version, char path[PATH_LEN])
{
    snprintf(path, PATH_LEN, "%s/%s.%04" PRId64 ".svg", ui->displays, name, version);
}

/* NAME.0001.svg */
static bool display_of_file(const char *file, struct display *d)
{
    const size_t n = strcspn(file, ".");
    char *end = NULL;
    if (n >= DISPLAY_LEN || strlen(file) != n + 9 || strcmp(file + n + 5, ".svg") != 0 ||
        strspn(file + n + 1, "0123456789") != 4)
        return false;
    *d = (struct display){.version = strtol(file + n + 1, &end, 10)};
    snprintf(d->name, sizeof d->name, "%.*s", (int)n, file);
    return display_named(d->name) && d->version > 0;
}

/* ---- Reading ------------------------------------------------------------------------------ */

static json_t *display_about(const char *path)
{
    char tail[TAIL_MAX + 1];
    struct stat st;
    FILE *in = fopen(path, "re");
    if (!in)
        return NULL;
    if (fstat(fileno(in), &st) < 0 || fseek(in, st.st_size > TAIL_MAX ? -TAIL_MAX : 0, SEEK_END) < 0 ||
        (st.st_size <= TAIL_MAX && fseek(in, 0, SEEK_SET) < 0))
        st.st_size = 0;
    tail[st.st_size > 0 ? fread(tail, 1, TAIL_MAX, in) : 0] = '\0';
    fclose(in);
    const char *mark = NULL; /* the last: one before it is a part of the drawing */
    for (const char *at = strstr(tail, MARK); at; at = strstr(at + 1, MARK))
        mark = at + sizeof MARK - 1;
    json_t *about = mark ? json_loads(mark, JSON_DISABLE_EOF_CHECK, NULL) : NULL;
    if (!json_is_object(about)) {
        json_decref(about);
        about = json_pack("{s:f}", "time", (double)st.st_mtime);
    }
    return about;
}

static int newest_first(const void *a, const void *b)
{
    const struct display *one = a, *other = b;
    const int by_name = strcmp(one->name, other->name);
    return by_name ? by_name : (one->version < other->version) - (one->version > other->version);
}

/* All versions, of one display or, name NULL, of all; of a folder that is not there none. False: the fault is set. */
static bool displays_read(const struct ui *ui, struct request *r, const char *name, struct displays *all)
{
    struct display d;
    struct dirent *entry;
    struct stat st;
    *all = (struct displays){0};
    DIR *dir = ui->displays[0] ? opendir(ui->displays) : NULL;
    if (!dir && ui->displays[0] && errno != ENOENT)
        return fault_set(&r->fault, 503, "files", NULL, "the displays cannot be read: %s: %s", ui->displays,
                         strerror(errno));
    bool ok = true;
    while (ok && dir && (entry = readdir(dir)) != NULL)
        if (display_of_file(entry->d_name, &d) && (!name || !strcmp(name, d.name)) &&
            fstatat(dirfd(dir), entry->d_name, &st, 0) == 0 && S_ISREG(st.st_mode) &&
            (ok = apc_grow(&all->at, all->n + 1, sizeof d)))
            all->at[all->n++] = d;
    if (dir)
        closedir(dir);
    if (ok && ui->graphic.n > 0 && (!name || !strcmp(name, FIRST)) &&
        (ok = apc_grow(&all->at, all->n + 1, sizeof d)))
        all->at[all->n++] = (struct display){.name = FIRST};
    if (all->n > 0)
        qsort(all->at, all->n, sizeof d, newest_first);
    return ok || fault_set(&r->fault, 503, "busy", NULL, "out of memory");
}

static void display_json(const struct ui *ui, struct display *d, struct text *t)
{
    char path[PATH_LEN];
    display_path(ui, d->name, d->version, path);
    if (!d->about && d->version > 0)
        d->about = display_about(path);
    const json_t *level = json_object_get(d->about, "level"), *time = json_object_get(d->about, "time");
    const char *title = json_string_value(json_object_get(d->about, "title"));
    json_add(t, "{name:%s, title:%s, level:%jd, version:%jd, author:%s, time:%.3f, comment:%s}", d->name,
             title ? title : d->name,
             (intmax_t)(json_is_integer(level)   ? json_integer_value(level)
                        : strcmp(d->name, FIRST) ? 2
                                                 : 1),
             (intmax_t)d->version, json_string_value(json_object_get(d->about, "author")),
             json_is_number(time) ? json_number_value(time) : (double)NAN,
             json_string_value(json_object_get(d->about, "comment")));
}

static bool no_display(struct request *r, const char *name, int64_t version)
{
    return version < 0 ? fault_set(&r->fault, 404, "graphic", NULL, "there is no display \"%s\"", name)
                       : fault_set(&r->fault, 404, "graphic", "version",
                                   "the display \"%s\" has no version %" PRId64, name, version);
}

/* The newest version of each, or all versions of one. */
void get_displays(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct displays all;
    const char *name = request_query(r, "name");
    (void)store;
    if (displays_read(ui, r, name, &all) && (all.n > 0 || !name || no_display(r, name, -1))) {
        json_add(&r->reply, "{writable:%i, displays:[", ui->displays[0] != '\0');
        for (size_t i = 0; i < all.n; i++)
            if (name || i == 0 || strcmp(all.at[i - 1].name, all.at[i].name) != 0)
                display_json(ui, &all.at[i], &r->reply);
        json_add(&r->reply, "]}");
    }
    displays_free(&all);
}

/* As it is in the file, as the drawing of the plant is. */
void get_display(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct displays all;
    struct apc_error why;
    char path[PATH_LEN];
    int64_t version = -1;
    (void)store;
    if (!query_whole(r, "version", 0, VERSIONS, &version) || !displays_read(ui, r, r->name, &all))
        return;
    bool found = false;
    for (size_t i = 0; i < all.n && !found; i++)
        if ((found = version < 0 || all.at[i].version == version))
            version = all.at[i].version;
    displays_free(&all);
    if (!found) {
        no_display(r, r->name, version);
        return;
    }
    if (version == 0) {
        get_graphic(ui, r, store);
        return;
    }
    display_path(ui, r->name, version, path);
    if (graphic_load(&r->reply, path, &why) < 0) {
        fault_set(&r->fault, 503, "files", NULL, "the display cannot be read: %s", why.text);
        return;
    }
    r->type = "image/svg+xml";
    r->sandbox = true;
}

/* ---- Writing ------------------------------------------------------------------------------ */

struct display_order {
    const char *svg, *title, *comment;
    size_t length; /* of the drawing, without what may stand behind it */
    int64_t version, level;
};

static bool short_text(struct request *r, const json_t *body, const char *member, size_t most,
                       const char **text)
{
    if (!member_text(body, member, text, &r->fault))
        return false;
    return strlen(*text) <= most ||
           fault_set(&r->fault, 422, "value", member, "\"%s\" must have at most %zu bytes", member, most);
}

static bool read_display_order(struct request *r, const json_t *body, struct display_order *o)
{
    if (!member_text(body, "svg", &o->svg, &r->fault) ||
        !member_whole(body, "version", 0, VERSIONS - 1, &o->version, &r->fault) ||
        !member_whole(body, "level", 1, 4, &o->level, &r->fault) ||
        !short_text(r, body, "title", TITLE_MAX, &o->title) ||
        !short_text(r, body, "comment", COMMENT_MAX, &o->comment))
        return false;
    const char *end = NULL;
    for (const char *at = strstr(o->svg, END); at; at = strstr(at + 1, END))
        end = at + sizeof END - 1;
    if (!end || !strstr(o->svg, "<svg"))
        return fault_set(&r->fault, 422, "value", "svg",
                         "\"svg\" must be a drawing: from <svg ...> to </svg>");
    o->length = (size_t)(end - o->svg);
    return o->length <= SVG_MAX - TAIL_MAX ||
           fault_set(&r->fault, 422, "value", "svg", "\"svg\" must have at most %d bytes",
                     SVG_MAX - TAIL_MAX);
}

/* What a comment of XML must not have, "--", none of its texts has then, nor what ends a drawing. */
static void put_who_and_why(FILE *out, const struct text *about)
{
    fputs("\n" MARK, out);
    for (size_t i = 0; i < about->n; i++)
        if (strchr("-<", about->at[i]))
            fprintf(out, "\\u%04x", (unsigned)about->at[i]);
        else
            putc(about->at[i], out);
    fputs(" -->\n", out);
}

/* Returns 0 or errno; EEXIST: somebody was first. */
static int display_store(const struct ui *ui, const char *name, int64_t version,
                         const struct display_order *o, const struct text *about)
{
    char part[PATH_LEN], path[PATH_LEN];
    display_path(ui, name, version, path);
    if (mkdir(ui->displays, 0777) < 0 && errno != EEXIST)
        return errno;
    if (snprintf(part, sizeof part, "%s/.part.XXXXXX", ui->displays) >= (int)sizeof part)
        return ENAMETOOLONG;
    const int fd = mkostemp(part, O_CLOEXEC), folder = open(ui->displays, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    FILE *out = fd < 0 ? NULL : fdopen(fd, "w");
    bool ok = out && folder >= 0 && fwrite(o->svg, 1, o->length, out) == o->length;
    if (out)
        put_who_and_why(out, about);
    ok = ok && fflush(out) == 0 && !ferror(out) && fchmod(fd, 0644) == 0 && fsync(fd) == 0;
    int failed = ok ? 0 : errno;
    if (out && fclose(out) != 0 && !failed)
        failed = errno;
    if (!failed && (link(part, path) < 0 || fsync(folder) < 0))
        failed = errno;
    if (fd >= 0)
        unlink(part);
    if (folder >= 0)
        close(folder);
    return failed;
}

/* Who saved it meanwhile, for somebody whose drawing is of an older version. */
static bool display_changed(const struct ui *ui, struct request *r, struct display *newest)
{
    struct text unused = {0};
    display_json(ui, newest, &unused);
    text_free(&unused);
    const char *author = json_string_value(json_object_get(newest->about, "author"));
    return fault_set(&r->fault, 409, "display", "version",
                     "%s has saved version %" PRId64 " of \"%s\" meanwhile: nothing was written",
                     author ? author : "somebody", newest->version, newest->name);
}

static void save_display(struct ui *ui, struct request *r, const struct display_order *o)
{
    struct displays all;
    struct text about = {0};
    struct display made = {.version = o->version + 1};
    snprintf(made.name, sizeof made.name, "%.*s", DISPLAY_LEN - 1, r->name);
    json_add(&about, "{title:%s, level:%jd, author:%s, time:%.3f, comment:%s}", o->title, (intmax_t)o->level,
             r->session.user, (double)apc_clock_utc(NULL) / APC_NS_PER_S, o->comment);
    int failed = EEXIST;
    /* Once more where somebody is first, between the look and the write. */
    for (int i = 0; i < 2 && failed == EEXIST && !r->fault.http && displays_read(ui, r, r->name, &all); i++) {
        if ((all.n > 0 ? all.at[0].version : 0) != o->version)
            (void)(all.n > 0 ? display_changed(ui, r, &all.at[0]) : no_display(r, r->name, o->version));
        else
            failed = about.failed ? ENOMEM : display_store(ui, r->name, made.version, o, &about);
        displays_free(&all);
    }
    text_free(&about);
    if (failed && !r->fault.http)
        fault_set(&r->fault, 503, "files", NULL, "nothing was written, %s: %s", ui->displays,
                  strerror(failed));
    if (r->fault.http)
        return;
    display_json(ui, &made, &r->reply);
    json_decref(made.about);
}

void post_display(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"svg", "version", "title", "level", "comment", NULL};
    struct display_order o = {0};
    (void)store;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    if (body && read_display_order(r, body, &o) && request_may_write(ui, r)) {
        if (!ui->displays[0])
            fault_set(&r->fault, 409, "display", NULL,
                      "there is no folder of displays: start apc-ui with --config or --displays");
        else if (!display_named(r->name))
            fault_set(&r->fault, 422, "value", "name",
                      "the name of a display has 1 to %d letters, digits, _ or -", DISPLAY_LEN - 1);
        else
            save_display(ui, r, &o);
    }
    json_decref(body);
}
