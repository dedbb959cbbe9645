/* SPDX-License-Identifier: BSD-3-Clause */
/* samples.csv and operation.csv of a run folder: time,table,id,status,value. A large file is read in parts,
 * one in a thread each, which are put together afterwards: what comes out is the same. */
#include <apcstore.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/files.h"
#include "record.h"
#include "samples_columns.h"

enum { ROOM = 4096, CHUNK = 1 << 18, BEHIND = 32, ROW = 32 };

/* ---- Variables and codes --------------------------------------------------------------------- */

static size_t slot_of(const struct apc_samples *r, int32_t table, int32_t id)
{
    const uint32_t key = ((uint32_t)id * 16 + (uint32_t)table) * 2654435761u;
    size_t at = key & (r->slots - 1);

    while (r->slot[at] && (r->table[r->slot[at] - 1] != table || r->id[r->slot[at] - 1] != id))
        at = (at + 1) & (r->slots - 1);
    return at;
}

/* So many slots that half of them are free. */
static bool more_slots(struct apc_samples *r)
{
    const size_t slots = r->slots ? 2 * r->slots : 64;
    int32_t *const slot = calloc(slots, sizeof *slot),
                   *const table = realloc(r->table, slots / 2 * sizeof *table), *id = NULL;

    r->table = table ? table : r->table;
    id = realloc(r->id, slots / 2 * sizeof *id);
    r->id = id ? id : r->id;
    if (!slot || !table || !id) {
        free(slot);
        return false;
    }
    free(r->slot);
    r->slot = slot;
    r->slots = slots;
    for (size_t i = 0; i < r->n_variables; i++)
        r->slot[slot_of(r, r->table[i], r->id[i])] = (int32_t)i + 1;
    return true;
}

/* Its place; -1: out of memory. */
static int32_t place_of_variable(struct apc_samples *r, int32_t table, int32_t id)
{
    if (2 * r->n_variables >= r->slots && !more_slots(r))
        return -1;
    const size_t at = slot_of(r, table, id);

    if (!r->slot[at]) {
        r->table[r->n_variables] = table;
        r->id[r->n_variables] = id;
        r->slot[at] = (int32_t)++r->n_variables;
    }
    return r->slot[at] - 1;
}

/* Its place; -1: there are too many. */
static int place_of_code(struct apc_samples *r, apc_status code)
{
    size_t i = 0;

    while (i < r->n_codes && r->code[i] != code)
        i++;
    if (i == r->n_codes && r->n_codes < sizeof r->code / sizeof r->code[0])
        r->code[r->n_codes++] = code;
    return i < r->n_codes ? (int)i : -1;
}

static int32_t table_called(const char *from, size_t n)
{
    for (int table = 1; table < APC_TABLE_END; table++) {
        const char *const name = apc_table_name((enum apc_table)table);

        if (name[0] == *from && strlen(name) == n && memcmp(name, from, n) == 0)
            return table;
    }
    return 0;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* "sensor,1," as it stands in the file, where it is no longer than 16 bytes: rows name their variables in the
 * same order again and again, so that mostly a glance tells which one it is. */
struct spelling {
    uint64_t text[2], mask[2];
    int32_t length, next; /* 0: none yet; whose row came after it */
};

/* What lies between two places of the file. */
struct part {
    struct apc_samples *r;
    const char *name;
    int fd;
    off_t from, to; /* the lines that begin there */
    char *chunk;    /* [CHUNK + BEHIND] */
    struct spelling *spelling;
    size_t spellings;
    int32_t last; /* variable of the row before */
    size_t rows;  /* about so many */
    uint64_t lines;
    pthread_t thread;
    int rc;
    const char *why;
};

static bool widen_record(struct apc_samples *r, size_t room)
{
    if (!apc_grow(&r->time, room, sizeof *r->time) || !apc_grow(&r->variable, room, sizeof *r->variable) ||
        !apc_grow(&r->status, room, sizeof *r->status) || !apc_grow(&r->value, room, sizeof *r->value))
        return false;
    r->room = room;
    return true;
}

/* Put down how a variable is spelled. Returns false: out of memory. */
static bool learn(struct part *t, int32_t place, const char *from, size_t n)
{
    if ((size_t)place >= t->spellings) {
        const size_t more = t->spellings ? 2 * t->spellings : 64;

        if (!apc_grow(&t->spelling, more, sizeof *t->spelling))
            return false;
        memset(t->spelling + t->spellings, 0, (more - t->spellings) * sizeof *t->spelling);
        t->spellings = more;
    }
    struct spelling *const s = &t->spelling[place];

    if (s->length == 0 && n <= sizeof s->text) {
        memset(s->mask, 0, sizeof s->mask);
        memset(s->mask, 0xFF, n);
        memcpy(s->text, from, n);
        s->length = (int32_t)n;
    }
    return true;
}

static bool is_spelled(const struct spelling *s, const char *at)
{
    uint64_t text[2];

    memcpy(text, at, sizeof text);
    return s->length && !(((text[0] & s->mask[0]) ^ s->text[0]) | ((text[1] & s->mask[1]) ^ s->text[1]));
}

/* The variable "TABLE,ID," at @p *p, which is moved behind it. Returns its place, APC_EPROTO or APC_ENOMEM. */
static int32_t parse_variable(struct part *t, const char **p)
{
    const char *const from = *p, *end = from;
    double id;

    if (t->last >= 0) {
        const int32_t next = t->spelling[t->last].next;

        if (is_spelled(&t->spelling[next], from)) {
            *p = from + t->spelling[next].length;
            return next;
        }
    }
    while (*end != ',' && *end != '\n')
        end++;
    const int32_t table = *end == ',' ? table_called(from, (size_t)(end - from)) : 0;

    if (!table || !decimal_take(end + 1, &end, &id) || *end != ',' || !(id >= 0 && id < (1 << 28)))
        return APC_EPROTO;
    const int32_t place = place_of_variable(t->r, table, (int32_t)id);

    *p = end + 1;
    return place < 0 || !learn(t, place, from, (size_t)(*p - from)) ? APC_ENOMEM : place;
}

/* The status and a comma. Its place; -1: it is none, or there are too many. */
static int take_status(struct apc_samples *r, const char **p)
{
    char text[APC_STATUS_NAME_LEN];
    apc_status code = APC_GOOD;
    size_t n = 4;

    if (memcmp(*p, "Good,", 5) != 0) {
        for (n = 0; n < sizeof text && (*p)[n] != ',' && (*p)[n] != '\n'; n++)
            text[n] = (*p)[n];
        if (n == sizeof text || (*p)[n] != ',')
            return -1;
        text[n] = '\0';
        if (apc_status_parse(text, &code) < 0)
            return -1;
    }
    *p += n + 1;
    return r->n_codes && r->code[0] == code ? 0 : place_of_code(r, code);
}

/* The line at @p *p, which is moved behind it. Returns 0, APC_EPROTO: it is no row, or APC_ENOMEM. */
static int parse_sample_line(struct part *t, const char **p)
{
    struct apc_samples *const r = t->r;

    if (r->n == r->room && !widen_record(r, r->room ? 2 * r->room : t->rows))
        return APC_ENOMEM;
    if (!decimal_take(*p, p, &r->time[r->n]) || *(*p)++ != ',')
        return APC_EPROTO;
    const int32_t variable = parse_variable(t, p);

    if (variable < 0)
        return variable;
    const int status = take_status(r, p);

    if (status < 0 || !decimal_take(*p, p, &r->value[r->n]) || *(*p)++ != '\n')
        return APC_EPROTO;
    if (t->last >= 0)
        t->spelling[t->last].next = variable;
    t->last = variable;
    r->variable[r->n] = variable;
    r->status[r->n++] = (int8_t)status;
    return 0;
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* The whole lines of the first @p n bytes of the chunk, which stand at @p at in the file. Returns how many
 * bytes they are, or a negative error. */
static ssize_t take_lines(struct part *t, size_t n, off_t at)
{
    const char *p = t->chunk, *const end = memrchr(p, '\n', n);

    if (!end)
        return 0;
    if (at > 0 && at < t->from) /* in the middle of a line: that one is the part's before */
        p = (const char *)memchr(p, '\n', n) + 1;
    for (; p <= end && at + (p - t->chunk) < t->to; t->lines++) {
        const bool names = at + (p - t->chunk) == 0;

        if (names)
            p = (const char *)memchr(p, '\n', n) + 1;
        const int rc = names ? 0 : parse_sample_line(t, &p);

        if (rc < 0)
            return rc;
    }
    return p - t->chunk;
}

static int fail_part(struct part *t, int rc, const char *why)
{
    t->why = why;
    return rc;
}

static int take_part(struct part *t)
{
    off_t at = t->from > 0 ? t->from - 1 : 0;
    size_t n = 0;
    ssize_t got;

    while (at < t->to && (got = pread(t->fd, t->chunk + n, CHUNK - n, at + (off_t)n)) != 0) {
        if (got < 0)
            return fail_part(t, APC_ESYS, "cannot be read");
        n += (size_t)got;
        const ssize_t taken = take_lines(t, n, at);

        if (taken < 0)
            return fail_part(t, (int)taken,
                             taken == APC_EPROTO
                                 ? "not a row \"time,table,id,status,value\": is the file damaged?"
                                 : "out of memory");
        if (taken == 0 && n == CHUNK)
            return fail_part(t, APC_EPROTO, "a line without an end");
        n -= (size_t)taken;
        at += taken;
        memmove(t->chunk, t->chunk + taken, n);
    }
    return at >= t->to || n == 0 ? 0 : fail_part(t, APC_EPROTO, "ends in the middle of a line");
}

void samples_forget(struct apc_samples *r)
{
    free(r->time);
    free(r->variable);
    free(r->status);
    free(r->value);
    free(r->table);
    free(r->id);
    free(r->slot);
    *r = (struct apc_samples){0};
}

static void *parse_csv_part(void *ctx)
{
    struct part *const t = ctx;

    t->rc = t->chunk ? take_part(t) : fail_part(t, APC_ENOMEM, "out of memory");
    return NULL;
}

/* The rows of a part behind those that are there. Returns false: out of memory, or too many codes. */
static bool append_part(struct apc_samples *r, const struct apc_samples *part)
{
    int32_t *const place = malloc((part->n_variables + 1) * sizeof *place);
    int8_t code[sizeof part->code / sizeof part->code[0]];
    bool fits = place && (r->n + part->n <= r->room || widen_record(r, r->n + part->n));

    for (size_t i = 0; fits && i < part->n_variables; i++)
        fits = (place[i] = place_of_variable(r, part->table[i], part->id[i])) >= 0;
    for (size_t i = 0; fits && i < part->n_codes; i++)
        fits = (code[i] = (int8_t)place_of_code(r, part->code[i])) >= 0;
    if (fits && part->n > 0) {
        memcpy(r->time + r->n, part->time, part->n * sizeof *r->time);
        memcpy(r->value + r->n, part->value, part->n * sizeof *r->value);
        for (size_t i = 0; i < part->n; i++)
            r->variable[r->n + i] = place[part->variable[i]];
        for (size_t i = 0; i < part->n; i++)
            r->status[r->n + i] = code[part->status[i]];
        r->n += part->n;
    }
    free(place);
    return fits;
}

/* All parts, the first one in this thread. Returns 0 or the first error in the order of the file. */
static int take_file(struct part part[SAMPLES_PARTS], size_t parts, struct apc_error *why)
{
    bool started[SAMPLES_PARTS] = {false};
    uint64_t lines = 0;

    for (size_t i = 1; i < parts; i++)
        started[i] = pthread_create(&part[i].thread, NULL, parse_csv_part, &part[i]) == 0;
    for (size_t i = 0; i < parts; i++) {
        if (!started[i])
            parse_csv_part(&part[i]);
        else
            pthread_join(part[i].thread, NULL);
    }
    for (size_t i = 0; i < parts; i++) {
        lines += part[i].lines;
        if (part[i].rc < 0)
            return apc_fail(why, part[i].rc, "%s:%llu: %s", part[i].name, (unsigned long long)lines + 1,
                            part[i].why);
        if (i > 0 && !append_part(part[0].r, part[i].r))
            return apc_fail(why, APC_ENOMEM, "out of memory for the rows of %s", part[i].name);
    }
    return 0;
}

/* ---- Files as nobody here writes them --------------------------------------------------------- */

static int take_slow_sample(void *ctx, double t, const struct apc_sample *sample)
{
    struct apc_samples *const r = ctx;

    if (r->n == r->room && !widen_record(r, r->room ? 2 * r->room : ROOM))
        return APC_ENOMEM;
    const int32_t variable = place_of_variable(r, (int32_t)sample->table, sample->id);
    const int status = place_of_code(r, sample->status);

    if (variable < 0 || status < 0)
        return variable < 0 ? APC_ENOMEM : APC_ERANGE;
    r->time[r->n] = t;
    r->variable[r->n] = variable;
    r->status[r->n] = (int8_t)status;
    r->value[r->n++] = sample->value;
    return 0;
}

static int read_fast(struct apc_samples *rows, const char *file, struct apc_error *why)
{
    const int fd = open(file, O_RDONLY | O_CLOEXEC);
    struct apc_samples others[SAMPLES_PARTS] = {{0}};
    struct part part[SAMPLES_PARTS] = {{0}};
    struct stat stat;

    if (fd < 0 || fstat(fd, &stat) != 0) {
        const int rc = apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s cannot be read: %s",
                                file, strerror(errno));
        if (fd >= 0)
            close(fd);
        return rc;
    }
    const size_t parts = samples_parts((size_t)stat.st_size);

    for (size_t i = 0; i < parts; i++)
        part[i] =
            (struct part){.r = i ? &others[i] : rows,
                          .name = file,
                          .fd = fd,
                          .from = stat.st_size / (off_t)parts * (off_t)i,
                          .to = i + 1 < parts ? stat.st_size / (off_t)parts * (off_t)(i + 1) : stat.st_size,
                          .chunk = calloc(1, CHUNK + BEHIND),
                          .rows = ROOM + (size_t)(i ? stat.st_size / (off_t)parts : stat.st_size) / ROW,
                          .last = -1};
    const int rc = take_file(part, parts, why);

    for (size_t i = 0; i < parts; i++) {
        free(part[i].chunk);
        free(part[i].spelling);
        if (i > 0)
            samples_forget(&others[i]);
    }
    close(fd);
    return rc;
}

/* What is not as it was written here may have gone through a spreadsheet: the reader of all files knows. */
int samples_csv_read(struct apc_samples *rows, const char *file, struct apc_error *why)
{
    const int rc = read_fast(rows, file, why);

    if (rc != APC_EPROTO)
        return rc;
    samples_forget(rows);
    return samples_each(file, take_slow_sample, rows, why);
}
