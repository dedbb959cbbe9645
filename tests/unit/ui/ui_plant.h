/* SPDX-License-Identifier: BSD-3-Clause */
/* A plant that apc-ui is asked about, as ui_request.h asks: two of each with controller "base", and one loop
 * above. To be included by one file of a program.
 */
#ifndef APC_TEST_UI_PLANT_H
#define APC_TEST_UI_PLANT_H

#include "ui_request.h"

#define TUNINGS WRITE_CHANGES

static struct apc_tag tags[40 + TUNINGS];
static size_t n_tags;

/* The answer as JSON, to be given back; NULL when it is none. */
static inline json_t *ask(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    request.fault = (struct fault){0};
    text_free(&request.reply);
    request.status = 0;
    handle(ui, &request, store);
    return json_loadb(request.reply.at ? request.reply.at : "", request.reply.n, 0, NULL);
}

static inline const char *ask_text(void (*handle)(struct ui *, struct request *, struct apc_store *))
{
    static char text[1 << 16];
    json_decref(ask(handle));
    snprintf(text, sizeof text, "%.*s", (int)request.reply.n, request.reply.at ? request.reply.at : "");
    return text;
}

static inline void tag(enum apc_table table, int id, const char *name, double low, double high)
{
    struct apc_tag *t = &tags[n_tags++];
    *t = (struct apc_tag){.table = table, .id = id, .unit = "m", .low = low, .high = high};
    snprintf(t->name, sizeof t->name, "%s", name);
}

/* Those from here on are a controller's. */
static inline void tags_of(const char *controller, size_t first)
{
    for (size_t i = first; i < n_tags; i++)
        snprintf(tags[i].controller, sizeof tags[i].controller, "%s", controller);
}

static inline void tag_loop(int id, const char *name, const char *controller)
{
    const size_t first = n_tags;
    char text[APC_TAG_LEN];
    tag(APC_OPMODE, id, name, 0, 3);
    snprintf(text, sizeof text, "%s.mode.actual", name);
    tag(APC_ACTUAL, apc_variable_number(APC_OPMODE, id), text, 0, 5);
    snprintf(text, sizeof text, "%s.manual", name);
    tag(APC_MANUAL, id, text, 0, 10);
    tags_of(controller, first);
}

static inline int by_table(const void *a, const void *b)
{
    const struct apc_tag *one = a, *other = b;
    return one->table != other->table ? (int)one->table - (int)other->table : one->id - other->id;
}

static inline int append_dim(int id, double value)
{
    static int64_t seq;
    struct apc_sample s = {.table = APC_DIM, .id = id, .seq = ++seq, .time = S, .value = value};
    return apc_store_append(store, &s, 1);
}

/* Two of each with controller "base", and one loop above, which moves r1; as many tunings as one write may
 * change. */
static inline int set_up(void **state)
{
    (void)state;
    n_tags = 0;
    tag(APC_SENSOR, 1, "y1", -APC_VALUE_MAX, APC_VALUE_MAX);
    tag(APC_SENSOR, 2, "y2", 0, 1);
    tag(APC_OPMODE, 0, "mode", 0, 3);
    tag(APC_TICK, 1, "base", 0, 0);
    tag(APC_TICK, 2, "upper", 0, 0);
    const size_t first = n_tags;
    tag(APC_ACTUATOR, 1, "u1", 0, 10);
    tag(APC_ACTUATOR, 2, "u2", 0, 10);
    tag(APC_SETPOINT, 1, "r1", -100, 100);
    tag(APC_SETPOINT, 2, "r2", -100, 100);
    for (int i = 1; i <= TUNINGS; i++) {
        char name[16];
        snprintf(name, sizeof name, "k%d", i);
        tag(APC_TUNING, i, name, -1000, 1000);
    }
    tags_of("base", first);
    tag_loop(1, "u1", "base");
    tag_loop(2, "u2", "base");
    tag_loop(3, "upper.r1", "upper");
    qsort(tags, n_tags, sizeof *tags, by_table);
    if (!ui_made("mem:handlers") || apc_store_put_tags(store, tags, n_tags) < 0)
        return -1;
    static const double pairs[] = {1, 1, 2, 2, 1, 0};
    for (int i = 0; i < 6; i++)
        if (append_dim(4 + i, pairs[i]) < 0)
            return -1;
    if (model_load(&ui->model, store) < 0)
        return -1;
    ui->began = apc_clock_mono(NULL);
    ui->round[0] = ui->round[1] = ui->began;
    ui->model.connected = true;
    ask_nothing();
    return 0;
}

static inline int tear_down(void **state)
{
    (void)state;
    ui_gone();
    return 0;
}

static inline struct apc_sample *now_of(enum apc_table table, int id)
{
    int at = find_plant_tag(&ui->model.plant, table, id);
    assert_true(at >= 0);
    return &ui->model.now[at];
}

/* As the live thread does it: this value came so long ago. */
static inline void came(enum apc_table table, int id, double value, apc_ns age)
{
    struct apc_sample *s = now_of(table, id);
    *s = (struct apc_sample){.table = table, .id = id, .seq = s->seq + 1, .time = S, .value = value};
    ui->model.moved[s - ui->model.now] = apc_clock_mono(NULL) - age;
}

static inline void ticked(size_t controller, apc_ns age)
{
    ui->model.tick[controller].seq++;
    ui->model.ticked[controller] = apc_clock_mono(NULL) - age;
}

static inline void actual(int loop, enum apc_mode mode)
{
    came(APC_ACTUAL, apc_variable_number(APC_OPMODE, loop), mode, 0);
}

static inline void period(apc_ns controller, apc_ns client)
{
    plant_rhythm(&ui->model.plant, "base", controller);
    plant_rhythm(&ui->model.plant, "upper", 10 * controller);
    plant_rhythm(&ui->model.plant, "client", client);
    plant_rhythm(&ui->model.plant, "plant", client);
}

static inline void all_came(apc_ns age)
{
    for (int id = 1; id <= 2; id++) {
        came(APC_SENSOR, id, 0.5, age);
        came(APC_ACTUATOR, id, 1.25, age);
        ticked((size_t)id - 1, age);
    }
    for (int id = 1; id <= 3; id++) {
        came(APC_OPMODE, id, APC_MODE_AUTO, age);
        actual(id, APC_MODE_AUTO);
    }
}

static inline void an_event(const char *source, const char *kind, enum apc_event_severity severity,
                            const char *text)
{
    struct apc_event e = {.time = 1763730000 * S, .severity = severity};
    snprintf(e.source, sizeof e.source, "%s", source);
    snprintf(e.kind, sizeof e.kind, "%s", kind);
    snprintf(e.text, sizeof e.text, "%s", text);
    model_take_event(&ui->model, &e);
}

/* A member of `control`, as JSON text. */
static inline const char *control(const char *member)
{
    static char text[300];
    json_t *state = ask(get_state);
    assert_non_null(state);
    char *dump = json_dumps(json_object_get(json_object_get(state, "control"), member), JSON_ENCODE_ANY);
    snprintf(text, sizeof text, "%s", dump ? dump : "(missing)");
    free(dump);
    json_decref(state);
    return text;
}

static inline bool stale(const char *ref)
{
    json_t *all = ask(get_diagnostics);
    const json_t *signal;
    size_t i;
    int found = -1;
    assert_non_null(all);
    json_array_foreach(json_object_get(all, "signals"), i,
                       signal) if (!strcmp(json_string_value(json_object_get(signal, "ref")), ref)) found =
        json_is_true(json_object_get(signal, "stale"));
    json_decref(all);
    assert_true(found >= 0);
    return found;
}

static inline void has(const char *text, const char *part)
{
    if (!strstr(text, part))
        fail_msg("\"%s\" is not in: %s", part, text);
}

static inline size_t times_in(const char *text, const char *part)
{
    size_t n = 0;
    for (const char *at = text; (at = strstr(at, part)) != NULL; at++)
        n++;
    return n;
}

/* One window of a task: n ticks around this. */
static inline void put_window(const char *task, const char *quantity, apc_ns time, uint64_t n, apc_ns value,
                              uint64_t missed)
{
    const int64_t low = value - 100, high = value + 100, count = (int64_t)n;
    struct apc_timing_row row = {.time = time,
                                 .period = 2 * S,
                                 .missed = missed,
                                 .count = n,
                                 .mean = (double)value,
                                 .p50 = value,
                                 .p99 = value + 50,
                                 .max = value + 90,
                                 .bin_low = &low,
                                 .bin_high = &high,
                                 .bin_count = &count,
                                 .n_bins = 1};
    snprintf(row.task, sizeof row.task, "%s", task);
    snprintf(row.quantity, sizeof row.quantity, "%s", quantity);
    assert_int_equal(apc_store_append_timing(store, &row, 1), 1);
}

static inline void put_events(int n, const char *kind)
{
    static apc_ns time = 2000 * S; /* no two are the same */
    struct apc_event *e = calloc((size_t)n, sizeof *e);
    assert_non_null(e);
    for (int i = 0; i < n; i++) {
        e[i] = (struct apc_event){.time = time += S, .severity = APC_EVENT_INFO, .source = "x"};
        snprintf(e[i].kind, sizeof e[i].kind, "%s", kind);
        snprintf(e[i].text, sizeof e[i].text, "%d", i);
    }
    assert_int_equal(apc_store_append_events(store, e, (size_t)n), n);
    free(e);
}

/* Trial has the output u1 together with base, and goes along. */
static inline void describe_a_shadow(void)
{
    const struct apc_sample choice = {
        .table = APC_OPMODE, .id = LOOPS_ACTING(APC_ACTUATOR, 1), .seq = 1, .time = S, .value = 1};
    size_t first = n_tags;
    tag(APC_ESTIMATE, 1, "u1.output", 0, 10);
    tags_of("base", first);
    first = n_tags;
    tag(APC_ESTIMATE, 2, "trial.u1.output", 0, 10);
    tag(APC_TICK, 3, "trial", 0, 0);
    tags_of("trial", first);
    tag_loop(4, "trial.u1", "trial");
    tag(APC_OPMODE, choice.id, "u1.acting", 1, 3);
    qsort(tags, n_tags, sizeof *tags, by_table);
    assert_int_equal(apc_store_put_tags(store, tags, n_tags), n_tags);
    assert_int_equal(apc_store_append(store, &choice, 1), 1);
    assert_int_equal(append_dim(10, 1), 1);
    assert_int_equal(append_dim(11, 1), 1);
    assert_int_equal(model_load(&ui->model, store), 0);
}

#endif
