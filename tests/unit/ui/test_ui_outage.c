/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-ui, as a process, while its database goes, comes back, and loses an answer: through a proxy that the
 * test controls. What the page is told, and what is written.
 */
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <apcstore.h>

#include "cluster.h"
#include "proxy.h"

#include "ui/api.h"

static struct cluster *cluster;
static struct proxy *proxy;
static char folder[] = "/tmp/apc-ui-outage.XXXXXX";
static pid_t daemon_pid;
static struct client client;

static void prepare(const char *uri)
{
    static const struct apc_tag tags[] = {
        {.table = APC_SENSOR, .id = 1, .name = "y", .low = -APC_VALUE_MAX, .high = APC_VALUE_MAX},
        {.table = APC_SETPOINT, .id = 1, .name = "r", .low = 0, .high = 100, .controller = "base"},
        {.table = APC_ACTUATOR, .id = 1, .name = "u", .low = 0, .high = 10},
        {.table = APC_OPMODE, .id = 0, .name = "mode", .low = 0, .high = 1},
        {.table = APC_OPMODE, .id = 1, .name = "u", .low = 0, .high = 3, .controller = "base"},
        {.table = APC_TICK, .id = 1, .name = "base", .controller = "base", .period = 3600}};
    double none = 0;
    struct apc_vector tick = {
        .table = APC_TICK, .id = 1, .seq = 1, .time = apc_clock_utc(NULL), .n = 1, .room = 1, .value = &none};
    const struct apc_rows rows = {.size = sizeof rows, .vector = &tick, .n_vectors = 1};
    struct apc_sample z = {.table = APC_SETPOINT, .id = 1, .time = APC_NS_PER_S, .value = 5};
    struct apc_store *store;
    assert_int_equal(apc_store_open(&store, uri, NULL, NULL), 0);
    assert_true(apc_store_init(store) >= 0);
    assert_true(apc_store_put_tags(store, tags, sizeof tags / sizeof *tags) > 0);
    assert_int_equal(apc_store_put(store, &z, 1), 0);
    assert_true(apc_store_append_rows(store, &rows) >= 0);
    apc_store_close(store);
}

/* The port from its first lines. */
static int read_port(const char *log)
{
    for (int i = 0; i < 200; i++) {
        char line[512], *at;
        FILE *file = fopen(log, "r");
        while (file && fgets(line, sizeof line, file))
            if ((at = strstr(line, "serving http://127.0.0.1:")) != NULL) {
                fclose(file);
                return (int)strtol(at + 25, NULL, 10);
            }
        if (file)
            fclose(file);
        assert_int_equal(waitpid(daemon_pid, NULL, WNOHANG), 0);
        usleep(20000);
    }
    fail_msg("apc-ui does not say where it serves");
    return 0;
}

static void start_daemon(const char *uri)
{
    char log[128];
    snprintf(log, sizeof log, "%s/log", folder);
    daemon_pid = fork();
    if (daemon_pid == 0) {
        int fd = open(log, O_WRONLY | O_CREAT, 0600);
        dup2(fd, 2);
        setenv("HOME", folder, 1);
        unsetenv("APC_USERS");
        execl(APC_UI, "apc-ui", "--store", uri, "--listen", "127.0.0.1:0", (char *)NULL);
        _exit(127);
    }
    assert_true(daemon_pid > 0);
    client.port = read_port(log);
    client = client_make(client.port, NULL, NULL);
}

static int set_up(void **state)
{
    char listening[160], server[300], uri[300];
    (void)state;
    assert_non_null(mkdtemp(folder));
    cluster = cluster_start_private();
    prepare(cluster_uri(cluster));
    snprintf(listening, sizeof listening, "unix:%s/.s.PGSQL.5432", folder);
    snprintf(server, sizeof server, "unix:%s", cluster_socket(cluster));
    proxy = proxy_start(listening, server);
    snprintf(uri, sizeof uri, "postgresql://apc@/%s?host=%s", cluster_database(cluster), folder);
    start_daemon(uri);
    return 0;
}

static int tear_down(void **state)
{
    int status = 0;
    char command[80];
    (void)state;
    proxy_set(proxy, PROXY_PASS);
    kill(daemon_pid, SIGTERM);
    waitpid(daemon_pid, &status, 0);
    proxy_stop(proxy);
    cluster_destroy(cluster);
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return system(command) != 0 || status != 0 ? -1 : 0;
}

static void await_connected(struct http_stream *stream, bool connected)
{
    for (int i = 0; i < 100; i++) {
        json_t *data = next_event(stream, "store", NULL);
        bool now = json_is_true(json_object_get(data, "connected"));
        json_decref(data);
        if (now == connected)
            return;
    }
    fail_msg("the store never was what was waited for");
}

static void await_ready(void)
{
    struct http_stream *stream = client_stream(&client, NULL);
    while (client_get(&client, "/readyz", NULL) != 200)
        json_decref(next_event(stream, "beat", NULL));
    http_stream_close(stream);
}

static char *setpoint(double value, const char *key)
{
    static char body[200];
    snprintf(body, sizeof body, "{\"id\":1,\"value\":%g,\"seq\":%" JSON_INTEGER_FORMAT ",\"key\":\"%s\"}",
             value, (json_int_t)seq_of(&client, "setpoint.1"), key);
    return body;
}

/* Promise(server/status-codes) */
static void while_it_is_away_the_page_is_told_and_nothing_is_written(void **state)
{
    json_t *json;
    (void)state;
    await_ready();
    struct http_stream *stream = client_stream(&client, NULL);
    json_decref(next_event(stream, "state", NULL));
    proxy_set(proxy, PROXY_REFUSE);
    await_connected(stream, false);
    assert_int_equal(client_get(&client, "/readyz", NULL), 503);
    assert_int_equal(client_get(&client, "/livez", NULL), 200);
    assert_int_equal(client_get(&client, "/api/state", &json), 200); /* the last known */
    assert_true(json_is_false(json_object_get(json_object_get(json, "store"), "connected")));
    assert_non_null(text_of(json_object_get(json, "store"), "error"));
    json_decref(json);
    expect_error(&client, "POST", "/api/setpoint", NULL, setpoint(11, "while-away"), 503, "store");
    expect_error(&client, "GET", "/api/history?var=sensor.1&since=-60&bins=10", NULL, NULL, 503, "store");
    json_t *beat = next_event(stream, "beat", NULL);
    assert_true(json_is_false(json_object_get(beat, "connected")));
    json_decref(beat);

    proxy_set(proxy, PROXY_PASS);
    await_connected(stream, true);
    assert_int_equal(client_get(&client, "/readyz", NULL), 200);
    http_stream_close(stream);
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.setpoint"), "1");
}

/* The commit waits for a standby that is not there, longer than the daemon does: nobody knows what will
 * become of it. */
/* Promise(server/status-codes) */
static void a_commit_without_an_answer_is_unknown_and_settles_by_itself(void **state)
{
    json_t *json;
    (void)state;
    await_ready();
    struct http_stream *stream = client_stream(&client, NULL);
    json_decref(next_event(stream, "state", NULL));
    /* who writes is to be known already */
    const int64_t before = seq_of(&client, "setpoint.1");
    assert_int_equal(client_post(&client, "/api/setpoint", setpoint(5, "who-writes"), NULL), 200);
    while (seq_of(&client, "setpoint.1") == before)
        json_decref(next_event(stream, "beat", NULL));
    char *body = setpoint(20, "lost-answer");
    assert_true(cluster_need_standby(cluster, "nobody"));
    assert_int_equal(client_post(&client, "/api/setpoint", body, &json), 504);
    assert_string_equal(text_of(json_object_get(json, "error"), "code"), "unknown");
    const json_t *write = json_object_get(json, "write");
    assert_string_equal(text_of(write, "state"), "unknown");
    assert_true(json_is_null(json_object_get(write, "stored")));
    json_decref(json);
    cluster_query(cluster, "ALTER SYSTEM RESET synchronous_standby_names");
    cluster_query(cluster, "SELECT pg_reload_conf()");
    json_decref(await_write(stream, "lost-answer", "accepted"));
    assert_near(value_of(&client, "setpoint.1"), 20, 0);
    assert_int_equal(client_get(&client, "/api/writes?key=lost-answer", &json), 200);
    write = json_array_get(json_object_get(json, "writes"), 0);
    assert_true(json_is_true(json_object_get(write, "stored")));
    json_decref(json);
    http_stream_close(stream);
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.setpoint WHERE value = 20"), "1");
    /* the audit has it, with what was known */
    assert_true(cluster_await(
        cluster, "SELECT text FROM apc.event WHERE kind = 'operator' AND text LIKE 'r: 5 -> 20%'",
        "r: 5 -> 20, outcome unknown (from 127.0.0.1)"));
}

/* Promise(stores/loop-would-read) */
static void in_a_history_nothing_is_written(void **state)
{
    json_t *json;
    (void)state;
    await_ready();
    char *body = setpoint(30, "in-a-history"), before[32];
    snprintf(before, sizeof before, "%s", cluster_query(cluster, "SELECT count(*) FROM apc.setpoint"));
    cluster_query(cluster, "INSERT INTO apc.catalogue (revision, kind, text) VALUES (1, 'history', '')");
    assert_int_equal(client_post(&client, "/api/setpoint", body, &json), 503);
    const json_t *error = json_object_get(json, "error");
    assert_string_equal(text_of(error, "code"), "store");
    assert_non_null(strstr(text_of(error, "message"), "is a history, which no loop reads"));
    json_decref(json);
    assert_string_equal(cluster_query(cluster, "SELECT count(*) FROM apc.setpoint"), before);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(while_it_is_away_the_page_is_told_and_nothing_is_written),
        cmocka_unit_test(a_commit_without_an_answer_is_unknown_and_settles_by_itself),
        cmocka_unit_test(in_a_history_nothing_is_written), /* and it stays one */
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
