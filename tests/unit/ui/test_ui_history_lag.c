/* SPDX-License-Identifier: BSD-3-Clause */
/* The thread that looks how far the history is behind the live store: what it finds is what both stores have. */
/* Promise(page/how-far-history) */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc-ui/ui.h"
#include "check.h"
#include "scratch.h"

#define PATIENCE (60 * APC_NS_PER_S)

static struct ui *ui;
static struct apc_store *live, *history;
static pthread_t thread;

static struct apc_store *made(const char *uri)
{
    static const struct apc_tag tag = {.table = APC_SENSOR, .id = 4, .name = "y", .low = -1, .high = 1};
    struct apc_store *store = NULL;
    struct apc_error why = {""};
    if (apc_store_open(&store, uri, NULL, &why) < 0 || apc_store_init(store) < 0 ||
        apc_store_put_tags(store, &tag, 1) < 0)
        fail_msg("%s: %s%s", uri, why.text, store ? apc_store_error(store) : "");
    return store;
}

static void append(int64_t seq)
{
    const struct apc_sample s = {.table = APC_SENSOR, .id = 4, .seq = seq, .time = seq * 60 * APC_NS_PER_S};
    assert_int_equal(apc_store_append(live, &s, 1), 1);
}

static int set_up(void **state)
{
    static char both[400];
    char file[320];
    (void)state;
    snprintf(file, sizeof file, "sqlite:%s/history.db", scratch_folder());
    snprintf(both, sizeof both, "mem:ui-behind+%s", file);
    live = made("mem:ui-behind");
    history = made(file);
    ui = calloc(1, sizeof *ui);
    ui->options.store = both;
    return model_init(&ui->model) < 0 || model_load(&ui->model, live) < 0 ||
           pthread_create(&thread, NULL, behind_thread, ui) != 0;
}

static int tear_down(void **state)
{
    (void)state;
    ui_stop(ui);
    pthread_join(thread, NULL);
    model_free(&ui->model);
    free(ui);
    apc_store_close(history);
    apc_store_close(live);
    return 0;
}

/* What it finds, once that is so. */
static struct behind wait_for(bool (*is)(const struct behind *b))
{
    const apc_ns give_up = apc_clock_mono(NULL) + PATIENCE;
    struct behind b;
    do {
        usleep(5000);
        pthread_mutex_lock(&ui->model.mutex);
        b = ui->model.looked;
        pthread_mutex_unlock(&ui->model.mutex);
    } while (!is(&b) && apc_clock_mono(NULL) < give_up);
    if (!is(&b))
        fail_msg("it finds state %d, %d rows%s, %g s late: %s", b.state, (int)b.rows,
                 b.nothing ? ", nothing" : "", apc_ns_to_s(b.late), b.why);
    return b;
}

static bool has_nothing(const struct behind *b)
{
    return b->state == 1 && b->rows == 3 && b->nothing;
}

static bool has_all(const struct behind *b)
{
    return b->state == 1 && b->rows == 0 && !b->nothing;
}

static bool lacks_two(const struct behind *b)
{
    return b->state == 1 && b->rows == 2 && !b->nothing;
}

static bool is_away(const struct behind *b)
{
    return b->state < 0;
}

static void what_the_history_lacks_is_counted_as_it_comes_and_goes(void **state)
{
    struct apc_replication *f;
    char file[320];
    (void)state;
    for (int64_t seq = 1; seq <= 3; seq++)
        append(seq);
    struct behind b = wait_for(has_nothing);
    assert_int_equal(b.oldest, 60 * APC_NS_PER_S);
    assert_int_equal(apc_replication_create(&f, live, history, NULL), 0);
    assert_int_equal(apc_replication_step(f, PATIENCE), 3);
    b = wait_for(has_all);
    assert_int_equal(b.late, 0);
    append(4);
    append(5);
    const apc_ns since = 4 * 60 * APC_NS_PER_S, before = apc_clock_utc(NULL);
    b = wait_for(lacks_two); /* the first of them has waited since then */
    assert_in_range(b.late, before - since - APC_NS_PER_S, apc_clock_utc(NULL) - since + APC_NS_PER_S);
    assert_int_equal(b.oldest, 60 * APC_NS_PER_S);
    apc_replication_destroy(f);
    apc_store_close(history); /* and its file goes */
    snprintf(file, sizeof file, "sqlite:%s/other.db", scratch_folder());
    history = made(file);
    assert_int_equal(unlink(scratch_path("history.db")), 0);
    b = wait_for(is_away);
    assert_has(b.why, "history");
    assert_int_equal(b.oldest, 60 * APC_NS_PER_S); /* the live store is still there */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_the_history_lacks_is_counted_as_it_comes_and_goes, set_up,
                                        tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
