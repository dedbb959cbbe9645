/* SPDX-License-Identifier: BSD-3-Clause */
/* What apc-ui answers, asked without a connection, on a store in memory. To be included by one file of a
 * program: it stands in for those who ask a connection.
 */
#ifndef APC_TEST_UI_REQUEST_H
#define APC_TEST_UI_REQUEST_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apc-ui/api/api.h"
#include "check.h"

#define S APC_NS_PER_S

static struct ui *ui;
static struct apc_store *store;
static struct request request;
static struct connection from = {.address = "10.0.0.7"};
static const char *query[20]; /* name, value, ... */

const char *request_query(const struct request *r, const char *name)
{
    (void)r;
    for (size_t i = 0; i + 1 < sizeof query / sizeof *query && query[i]; i += 2)
        if (!strcmp(query[i], name))
            return query[i + 1];
    return NULL;
}

static const char *encoding; /* that whoever asks takes */
const char *request_header(const struct request *r, const char *name)
{
    (void)r;
    return strcmp(name, "Accept-Encoding") ? NULL : encoding;
}

static void ask_nothing(void)
{
    free(request.body);
    text_free(&request.reply);
    text_free(&request.extra);
    memset(query, 0, sizeof query);
    request = (struct request){.from = &from, .session = ui->sessions.local};
}

static void tell_nobody(void *ctx, const struct write *write)
{
    (void)ctx;
    (void)write;
}

/* All that stands around a request, and the store, which has its tables. */
static bool ui_made(const char *uri)
{
    ui = calloc(1, sizeof *ui);
    ui->options.store = uri;
    ui->open = true;
    return apc_log_create(&ui->log, STDERR_FILENO, "test", APC_LOG_ERROR) >= 0 &&
           model_init(&ui->model) >= 0 && stream_create(&ui->stream) >= 0 &&
           writes_create(&ui->writes, tell_nobody, NULL) >= 0 &&
           sessions_init(&ui->sessions, 100 * S, 1000 * S) >= 0 && audit_init(&ui->audit) >= 0 &&
           pthread_mutex_init(&ui->users_mutex, NULL) == 0 && desks_init(ui->desk) >= 0 &&
           listing_init(&ui->listing) >= 0 && verdicts_init(&ui->verdicts) >= 0 &&
           duration_stats_init(&ui->reads) >= 0 && duration_stats_init(&ui->stores) >= 0 &&
           duration_stats_init(&ui->lag) >= 0 && apc_store_open(&store, uri, NULL, NULL) >= 0 &&
           apc_store_init(store) >= 0;
}

static void ui_gone(void)
{
    ask_nothing();
    apc_store_close(store);
    duration_stats_free(&ui->reads);
    duration_stats_free(&ui->stores);
    duration_stats_free(&ui->lag);
    audit_free(&ui->audit);
    desks_free(ui->desk);
    listing_free(&ui->listing);
    verdicts_free(&ui->verdicts);
    sessions_free(&ui->sessions);
    writes_destroy(ui->writes);
    stream_destroy(ui->stream);
    model_free(&ui->model);
    apc_log_destroy(ui->log);
    pthread_mutex_destroy(&ui->users_mutex);
    free(ui);
}

#endif
