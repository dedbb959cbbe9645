/* SPDX-License-Identifier: BSD-3-Clause */
#include "all_plants.h"

#include <stdlib.h>
#include <string.h>

#include "common/storeuri.h"
#include "print.h"

static int take_database_plant(void *ctx, const struct apc_store_plant *plant)
{
    struct all_plants *all = ctx;
    struct apc_store_plant *more = realloc(all->plant, (all->n + 1) * sizeof *more);
    if (!more)
        return 1;
    more[all->n++] = *plant;
    all->plant = more;
    return 0;
}

int all_plants_load(struct all_plants *all, const struct cli *cli)
{
    const struct apc_store_options options = {.size = sizeof options, .name = "apc", .timeout = cli->timeout};
    struct apc_store *store = NULL;
    struct apc_error why;
    *all = (struct all_plants){.n = 0};
    int rc = store_open(&store, cli->store, &options, &why);
    if (rc < 0) {
        cli_error(cli, rc, "%s", why.text);
        return rc;
    }
    rc = apc_store_plants(store, take_database_plant, all);
    if (rc < 0)
        cli_store_error(cli, rc, store);
    else if ((size_t)rc > all->n)
        cli_error(cli, rc = APC_ENOMEM, "out of memory");
    apc_store_close(store);
    return rc < 0 ? rc : 0;
}

void all_plants_free(struct all_plants *all)
{
    free(all->plant);
}

char *all_plants_store(const struct cli *cli, const char *schema)
{
    const char *hash = strrchr(cli->store, '#');
    const size_t n = hash ? (size_t)(hash - cli->store) : strlen(cli->store), size = n + strlen(schema) + 2;
    char *uri = malloc(size);
    if (uri)
        snprintf(uri, size, "%.*s#%s", (int)n, cli->store, schema);
    return uri;
}

static void all_plants_members(const struct all_plants *all, apc_ns now)
{
    struct text t = {.out = stdout};
    json_add(&t, "[");
    for (size_t i = 0; i < all->n; i++) {
        const struct apc_store_plant *p = &all->plant[i];
        json_add(&t, i > 0 ? ",\n{" : "{");
        json_add(&t, "plant:%s, owned:%i, age:%.9jd}", p->schema, p->owned,
                 p->newest ? now - p->newest : JSON_NONE);
    }
    json_add(&t, "]\n");
}

int all_plants_show(const struct cli *cli)
{
    static const struct print_column columns[] = {
        {"PLANT", PRINT_LEFT}, {"NEWEST MEASUREMENT", PRINT_RIGHT}, {"TABLES", PRINT_LEFT}};
    struct all_plants all;
    struct print_table table;
    char text[PRINT_LEN];
    int rc = all_plants_load(&all, cli);
    const apc_ns now = apc_clock_utc(NULL);
    if (rc == 0 && cli->format == CLI_JSON) {
        all_plants_members(&all, now);
    } else if (rc == 0) {
        print_table_open(&table, columns, 3);
        for (size_t i = 0; i < all.n; i++) {
            const struct apc_store_plant *p = &all.plant[i];
            print_cell(&table, PRINT_PLAIN, "%s", p->schema);
            print_cell(&table, PRINT_PLAIN, "%s", p->newest ? print_duration(now - p->newest, text) : "-");
            print_cell(&table, PRINT_PLAIN, "%s", p->owned ? "own" : "of another user");
        }
        rc = print_table_end(&table, stdout, cli_colour(), 0);
    }
    all_plants_free(&all);
    return cli_done(cli, exit_code_of(rc));
}
