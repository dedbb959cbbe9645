/* SPDX-License-Identifier: BSD-3-Clause */
#include "status_writes.h"

#include <stdlib.h>
#include <string.h>

#include "apc/common/print.h"

#define LAST 3 /* all of it is to stay on one screen */

static bool is_operators(const struct apc_tag *tag)
{
    return tag->table == APC_SETPOINT || tag->table == APC_TUNING || tag->table == APC_MANUAL ||
           cli_is_loop(tag);
}

static int latest_first(const void *a, const void *b)
{
    const struct apc_sample *x = a, *y = b;
    return x->time < y->time ? 1 : x->time > y->time ? -1 : 0;
}

/* Who writes once often writes again: a name is asked for where it is not that of the row before. */
static int name_write_authors(struct status_writes *w, struct apc_store *store)
{
    int rc = 0;
    for (size_t i = 0; i < w->n && rc >= 0; i++) {
        if (i > 0 && w->row[i].author == w->row[i - 1].author)
            memcpy(w->author[i], w->author[i - 1], APC_AUTHOR_LEN);
        else
            rc = apc_store_author_name(store, w->row[i].author, w->author[i]);
        if (rc == APC_ENOTFOUND)
            rc = 0;
    }
    return rc < 0 ? rc : 0;
}

int status_writes_load(struct status_writes *w, struct apc_store *store, const struct cli_tags *tags)
{
    size_t n = 0;
    *w = (struct status_writes){tags, calloc(tags->n + 1, sizeof *w->row),
                                calloc(tags->n + 1, sizeof *w->author), 0};
    if (!w->row || !w->author)
        return APC_ENOMEM;
    for (size_t i = 0; i < tags->n; i++)
        if (is_operators(&tags->tag[i]))
            w->row[n++] = (struct apc_sample){.table = tags->tag[i].table, .id = tags->tag[i].id};
    const int rc = apc_store_read(store, w->row, n);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < n; i++)
        if (w->row[i].author > 0)
            w->row[w->n++] = w->row[i];
    qsort(w->row, w->n, sizeof *w->row, latest_first);
    return name_write_authors(w, store);
}

void status_writes_free(struct status_writes *w)
{
    free(w->row);
    free(w->author);
    *w = (struct status_writes){0};
}

int status_writes_show(const struct status_writes *w, bool colour)
{
    static const struct print_column columns[] = {
        {"WRITTEN", PRINT_LEFT}, {"NAME", PRINT_LEFT}, {"VALUE", PRINT_POINT}, {"BY", PRINT_LEFT}};
    char text[PRINT_LEN];
    struct print_table table;
    if (w->n == 0)
        return 0;
    print_table_open(&table, columns, 4);
    for (size_t i = 0; i < w->n && i < LAST; i++) {
        print_cell(&table, PRINT_PLAIN, "%s", print_second(w->row[i].time, text));
        print_cell(&table, PRINT_PLAIN, "%s", print_name(w->tags, &w->row[i], text));
        print_cell(&table, PRINT_PLAIN, "%s", print_value(&w->row[i], text));
        print_cell(&table, PRINT_PLAIN, "%s", w->author[i]);
    }
    putchar('\n');
    return print_table_end(&table, stdout, colour, 0);
}

void status_writes_json(const struct status_writes *w, apc_ns now, struct text *t)
{
    json_add(t, "writes:[");
    for (size_t i = 0; i < w->n; i++) {
        json_add(t, ",\n{");
        print_sample_members(t, &w->row[i], w->tags, now);
        json_add(t, "author:%-s}", w->author[i]);
    }
    json_add(t, "]");
}
