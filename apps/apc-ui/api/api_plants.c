/* SPDX-License-Identifier: BSD-3-Clause */
/* The plants of the database, and where the page of each is: a page of one process is of one plant. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"

#define DEFAULT_SCHEMA "apc"
#define KEPT           APC_NS_PER_S /* to list them takes connections of its own: however many ask, one a second */

struct address {
    char plant[64], page[200];
};

struct list {
    struct address *address;
    size_t n;
    const char *here; /* schema of the plant that this server shows */
    apc_ns now;       /* UTC */
    struct text *t;
};

static int address_read(const char *line, struct address *one)
{
    char more;
    const int n = sscanf(line, " %63s %199s %c", one->plant, one->page, &more);
    if (n <= 0 || one->plant[0] == '#')
        return 0;
    return n == 2 && (!strncmp(one->page, "http://", 7) || !strncmp(one->page, "https://", 8)) ? 1
                                                                                               : APC_EINVAL;
}

/* A line each. Returns 0 or an error in why. */
static int addresses_load(struct list *list, const char *path, struct apc_error *why)
{
    char line[512];
    int rc = 0;
    FILE *f = fopen(path, "re");
    if (!f)
        return apc_fail(why, errno == ENOENT ? APC_ENOTFOUND : APC_ESYS, "%s: %s", path, strerror(errno));
    for (int at = 1; rc == 0 && fgets(line, sizeof line, f); at++) {
        struct address one, *more;
        const int is = address_read(line, &one);
        if (is == 0)
            continue;
        if (is < 0) {
            rc = apc_fail(
                why, is,
                "%s:%d: expected a plant and the address of its page, as in \"line1 https://line1.example/\"",
                path, at);
        } else if (!(more = realloc(list->address, (list->n + 1) * sizeof *more))) {
            rc = apc_fail(why, APC_ENOMEM, "out of memory");
        } else {
            list->address = more;
            list->address[list->n++] = one;
        }
    }
    fclose(f);
    return rc;
}

int plants_check(const char *path, struct apc_error *why)
{
    struct list list = {0};
    const int rc = path ? addresses_load(&list, path, why) : 0;
    free(list.address);
    return rc;
}

static int listed_json(void *ctx, const struct apc_store_plant *plant)
{
    const struct list *list = ctx;
    const char *page = NULL;
    for (size_t i = 0; i < list->n && !page; i++)
        if (!strcmp(list->address[i].plant, plant->schema))
            page = list->address[i].page;
    json_add(list->t, "{name:%s, here:%i, age:%.9jd, page:%s}", plant->schema,
             !strcmp(plant->schema, list->here), plant->newest > 0 ? list->now - plant->newest : JSON_NONE,
             page);
    return 0;
}

/* As JSON. Returns the number of plants, or the store's error. */
static int plants_json(struct ui *ui, struct apc_store *store, struct text *t)
{
    const char *hash = strrchr(ui->options.store, '#');
    struct list list = {.here = hash ? hash + 1 : DEFAULT_SCHEMA, .now = apc_clock_utc(NULL), .t = t};
    struct apc_error why;
    if (ui->options.plants && addresses_load(&list, ui->options.plants, &why) < 0)
        apc_log_write(ui->log, APC_LOG_WARN, "addresses of plants: %s", why.text);
    json_add(t, "{t:%.6jd, plants:[", list.now);
    const int rc = apc_store_plants(store, listed_json, &list);
    json_add(t, "]}");
    free(list.address);
    return rc == APC_EINVAL ? 0 : rc; /* any other store is of one plant */
}

int listing_init(struct listing *listing)
{
    return pthread_mutex_init(&listing->mutex, NULL) ? APC_ESYS : 0;
}

void listing_free(struct listing *listing)
{
    text_free(&listing->json);
    pthread_mutex_destroy(&listing->mutex);
}

void get_plants(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct listing *listing = &ui->listing;
    pthread_mutex_lock(&listing->mutex);
    if (listing->made == 0 || apc_clock_mono(NULL) - listing->made >= KEPT) {
        text_free(&listing->json);
        listing->why[0] = '\0';
        const int rc = plants_json(ui, store, &listing->json);
        if (rc < 0) {
            fault_store(r, rc, store);
            snprintf(listing->why, sizeof listing->why, "%s", r->fault.message);
        }
        listing->made = apc_clock_mono(NULL);
    }
    if (listing->why[0]) {
        fault_set(&r->fault, 503, "store", NULL, "%s", listing->why);
    } else {
        text_put(&r->reply, listing->json.at, listing->json.n);
        r->reply.failed |= listing->json.failed;
    }
    pthread_mutex_unlock(&listing->mutex);
}
