/* SPDX-License-Identifier: BSD-3-Clause */
/* samples.csv and operation.csv of a run folder: time,table,id,status,value. */
#include <apcstore.h>
#include <errno.h>
#include <fcntl.h>
#include <float.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "columns.h"

enum { ROOM = 4096, CHUNK = 1 << 20, LINE = 256, DIGITS = 19 };

/* ---- Numbers ------------------------------------------------------------------------------- */

static bool take_any(const char *from, size_t n, double *value)
{
    char text[LINE];

    if (n >= sizeof text)
        return false;
    memcpy(text, from, n);
    text[n] = '\0';
    return apc_number_parse(text, value) == 0;
}

#if LDBL_MANT_DIG == 64 && defined(__x86_64__)
/* @p digits / 10^decimals rounded to 64 bits, then to 53: the same as rounded once, but where 64 bits end in
 * the middle between two doubles. Returns whether it is. */
static bool divide(uint64_t digits, unsigned decimals, double *value)
{
    static const long double power[] = {1e0L,  1e1L,  1e2L,  1e3L,  1e4L,  1e5L,  1e6L,  1e7L,  1e8L,  1e9L,
                                        1e10L, 1e11L, 1e12L, 1e13L, 1e14L, 1e15L, 1e16L, 1e17L, 1e18L, 1e19L,
                                        1e20L, 1e21L, 1e22L, 1e23L, 1e24L, 1e25L, 1e26L, 1e27L};
    if (decimals >= sizeof power / sizeof power[0])
        return false;
    const long double wide = (long double)digits / power[decimals];
    uint64_t bits;

    memcpy(&bits, &wide, sizeof bits);
    *value = (double)wide;
    return (bits & 0x7FF) != 0x400;
}
#else
static bool divide(uint64_t digits, unsigned decimals, double *value)
{
    (void)digits, (void)decimals, (void)value;
    return false;
}
#endif

/* The number that is all of the text from @p from to @p end. */
static bool take_number(const char *from, const char *end, double *value)
{
    const bool negative = *from == '-';
    const char *p = from + negative;
    uint64_t digits = 0;
    unsigned n = 0, decimals = 0;
    bool point = false;

    for (; p < end && n <= DIGITS; p++) {
        if (*p == '.' && !point) {
            point = true;
            continue;
        }
        if (*p < '0' || *p > '9')
            break;
        digits = 10 * digits + (uint64_t)(*p - '0');
        n += digits > 0;
        decimals += point;
    }
    if (p < end || n == 0 || n > DIGITS || !divide(digits, decimals, value))
        return take_any(from, (size_t)(end - from), value);
    *value = negative ? -*value : *value;
    return true;
}

/* ---- Variables and codes --------------------------------------------------------------------- */

static size_t slot_of(const struct apc_record *r, int32_t table, int32_t id)
{
    size_t at = ((uint32_t)id * 16 + (uint32_t)table) * 2654435761u & (r->slots - 1);

    while (r->slot[at] && (r->table[r->slot[at] - 1] != table || r->id[r->slot[at] - 1] != id))
        at = (at + 1) & (r->slots - 1);
    return at;
}

/* So many slots that half of them are free. */
static bool more_slots(struct apc_record *r)
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
static int32_t place_of(struct apc_record *r, int32_t table, int32_t id)
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

/* Its place; -1: it is none, or there are too many. */
static int take_status(struct apc_record *r, const char *from, size_t n)
{
    char text[APC_STATUS_NAME_LEN];
    apc_status code = APC_GOOD;

    if (n != 4 || memcmp(from, "Good", 4) != 0) {
        if (n >= sizeof text)
            return -1;
        memcpy(text, from, n);
        text[n] = '\0';
        if (apc_status_parse(text, &code) < 0)
            return -1;
    }
    size_t i = 0;

    while (i < r->n_codes && r->code[i] != code)
        i++;
    if (i == r->n_codes && r->n_codes < sizeof r->code / sizeof r->code[0])
        r->code[r->n_codes++] = code;
    return i < r->n_codes ? (int)i : -1;
}

static int32_t take_table(const char *from, size_t n)
{
    for (int table = 1; table < APC_TABLE_END; table++) {
        const char *const name = apc_table_name((enum apc_table)table);

        if (name[0] == *from && strlen(name) == n && memcmp(name, from, n) == 0)
            return table;
    }
    return 0;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

static bool widen(struct apc_record *r)
{
    const size_t room = r->room ? 2 * r->room : ROOM;
    void *const time = realloc(r->time, room * sizeof *r->time);

    r->time = time ? time : r->time;
    void *const variable = realloc(r->variable, room * sizeof *r->variable);

    r->variable = variable ? variable : r->variable;
    void *const status = realloc(r->status, room * sizeof *r->status);

    r->status = status ? status : r->status;
    void *const value = realloc(r->value, room * sizeof *r->value);

    r->value = value ? value : r->value;
    r->room = time && variable && status && value ? room : r->room;
    return r->room == room;
}

/* The line from @p p to @p end. Returns 0, APC_EPROTO: it is no row, or APC_ENOMEM. */
static int take_row(struct apc_record *r, const char *p, const char *end)
{
    const char *field[6] = {p};
    double id;

    for (size_t i = 1; i < 5; i++) {
        const char *const comma = memchr(field[i - 1], ',', (size_t)(end - field[i - 1]));

        if (!comma)
            return APC_EPROTO;
        field[i] = comma + 1;
    }
    field[5] = end + 1;
    if (r->n == r->room && !widen(r))
        return APC_ENOMEM;
    const int32_t table = take_table(field[1], (size_t)(field[2] - 1 - field[1]));
    const int status = take_status(r, field[3], (size_t)(field[4] - 1 - field[3]));

    if (!table || status < 0 || !take_number(field[0], field[1] - 1, &r->time[r->n]) ||
        !take_number(field[2], field[3] - 1, &id) || !(id >= 0 && id < (1 << 28)) ||
        !take_number(field[4], field[5] - 1, &r->value[r->n]))
        return APC_EPROTO;
    r->variable[r->n] = place_of(r, table, (int32_t)id);
    r->status[r->n] = (int8_t)status;
    return r->variable[r->n++] < 0 ? APC_ENOMEM : 0;
}

struct file {
    const char *name;
    char *chunk; /* [CHUNK] */
    size_t n;    /* of it, what has been read */
    uint64_t lines;
};

/* The lines that are whole; what is left of the last one goes to the front. */
static int take_lines(struct apc_record *r, struct file *f, struct apc_error *why)
{
    char *p = f->chunk, *const end = f->chunk + f->n, *line;

    for (; (line = memchr(p, '\n', (size_t)(end - p))); p = line + 1) {
        const int rc = f->lines++ == 0 ? 0 : take_row(r, p, line); /* the first one has the names */

        if (rc == APC_EPROTO)
            return apc_fail(why, rc,
                            "%s:%llu: not a row \"time,table,id,status,value\": is the file damaged?",
                            f->name, (unsigned long long)f->lines);
        if (rc < 0)
            return apc_fail(why, rc, "out of memory for the rows of %s", f->name);
    }
    f->n = (size_t)(end - p);
    memmove(f->chunk, p, f->n);
    return f->n < CHUNK ? 0 : apc_fail(why, APC_EPROTO, "%s: a line without an end", f->name);
}

static int take_file(struct apc_record *r, struct file *f, int fd, struct apc_error *why)
{
    ssize_t got;
    int rc = 0;

    while (rc == 0 && (got = read(fd, f->chunk + f->n, CHUNK - f->n)) != 0) {
        if (got < 0)
            return apc_fail(why, APC_ESYS, "%s cannot be read: %s", f->name, strerror(errno));
        f->n += (size_t)got;
        rc = take_lines(r, f, why);
    }
    return rc < 0 || f->n == 0 ? rc
                               : apc_fail(why, APC_EPROTO, "%s:%llu: ends in the middle of a line", f->name,
                                          (unsigned long long)f->lines + 1);
}

int apc_record_read(struct apc_record *record, const char *file, struct apc_error *why)
{
    struct file f = {.name = file, .chunk = malloc(CHUNK)};
    const int fd = open(file, O_RDONLY | O_CLOEXEC);
    int rc = 0;

    if (fd < 0)
        rc = apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s cannot be read: %s", file,
                      strerror(errno));
    else if (!f.chunk)
        rc = apc_fail(why, APC_ENOMEM, "out of memory for the rows of %s", file);
    else
        rc = take_file(record, &f, fd, why);
    if (fd >= 0)
        close(fd);
    free(f.chunk);
    return rc;
}

void apc_record_free(struct apc_record *r)
{
    free(r->time);
    free(r->variable);
    free(r->status);
    free(r->value);
    free(r->table);
    free(r->id);
    free(r->slot);
    free(r);
}
