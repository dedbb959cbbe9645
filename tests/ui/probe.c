/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The API of apc-ui against a running loop, as test_ui_api.sh sets it up: APC_UI_OPEN is the port of a server
 * without users, APC_UI_SECURE of one with anna (engineer) and otto (observer). Every refused request leaves
 * what it was about as it was.
 */
#include <errno.h>
#include <sys/socket.h>
#include <unistd.h>

#include "apc-ui/api/api.h"
#include "api.h"
#include "schema.h"

#define JSON "Content-Type: application/json\r\n"

static json_t *openapi;
static struct client local, anna, otto, stranger;

static int set_up(void **state)
{
    json_error_t error;
    (void)state;
    openapi = json_load_file(APC_OPENAPI, 0, &error);
    if (!openapi)
        fail_msg("%s:%d: %s", APC_OPENAPI, error.line, error.text);
    local = client_make(environment_port("APC_UI_OPEN"), NULL, NULL);
    anna = client_make(environment_port("APC_UI_SECURE"), "anna", "operator123");
    otto = client_make(environment_port("APC_UI_SECURE"), "otto", "observer123");
    stranger = (struct client){.port = anna.port};
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    json_decref(openapi);
    return 0;
}

/* ---- The description ---------------------------------------------------------------------- */

static const json_t *operation(const struct route *route)
{
    const char *method = !strcmp(route->method, "GET") ? "get" : "post";
    return json_object_get(json_object_get(json_object_get(openapi, "paths"), route->path), method);
}

static void same_parameters(const struct route *route, const json_t *described)
{
    char query[200] = "";
    const json_t *parameter;
    size_t i;
    if (!route->query)
        return;
    json_array_foreach(json_object_get(described, "parameters"), i, parameter)
    {
        size_t n = strlen(query);
        if (json_object_get(parameter, "$ref")) /* a header: see below */
            continue;
        snprintf(query + n, sizeof query - n, "%s%s", n ? " " : "", text_of(parameter, "name"));
    }
    assert_string_equal(query, route->query);
}

/* Promise(server/routes-answers-openapi): Routes and answers are those of openapi.json. */
static void openapi_names_every_route_and_no_other(void **state)
{
    size_t described = 0;
    const char *path;
    json_t *methods;
    (void)state;
    for (size_t i = 0; i < n_routes; i++) {
        const json_t *op = operation(&routes[i]);
        if (!op)
            fail_msg("openapi.json has no %s %s", routes[i].method, routes[i].path);
        assert_string_equal(text_of(op, "x-role"),
                            routes[i].role == ROLE_NONE ? "anyone" : role_name(routes[i].role));
        same_parameters(&routes[i], op);
    }
    json_object_foreach(json_object_get(openapi, "paths"), path, methods) described +=
        json_object_size(methods);
    assert_int_equal(described, n_routes);
}

/* Promise(server/routes-answers-openapi) */
static void openapi_says_how_a_request_shows_who_it_is_from(void **state)
{
    const json_t *components = json_object_get(openapi, "components");
    const json_t *schemes = json_object_get(components, "securitySchemes");
    char name[64];
    (void)state;
    snprintf(name, sizeof name, "%.*s", (int)strcspn(anna.cookie, "="), anna.cookie);
    assert_int_equal(strncmp(name, "apc-session-", 12), 0);
    assert_string_equal(text_of(json_object_get(schemes, "session"), "name"), "apc-session-8080");
    assert_string_equal(text_of(json_object_get(schemes, "token"), "scheme"), "bearer");
    assert_string_equal(text_of(json_object_get(schemes, "basic"), "scheme"), "basic");
    assert_string_equal(text_of(json_object_get(json_object_get(components, "parameters"), "Csrf"), "name"),
                        "X-CSRF-Token");
    for (size_t i = 0; i < n_routes; i++) {
        const json_t *first = json_array_get(json_object_get(operation(&routes[i]), "parameters"), 0);
        const char *ref = text_of(first, "$ref");
        bool needed = !strcmp(routes[i].method, "POST") && routes[i].role != ROLE_NONE;
        assert_int_equal(ref && !strcmp(ref, "#/components/parameters/Csrf"), needed);
    }
}

static const json_t *schema_of(const struct route *route, int status)
{
    char text[8];
    snprintf(text, sizeof text, "%d", status);
    const json_t *answer = json_object_get(json_object_get(operation(route), "responses"), text);
    if (!answer)
        fail_msg("openapi.json says nothing of %d for %s %s", status, route->method, route->path);
    answer = schema_resolve(openapi, answer);
    return json_object_get(json_object_get(json_object_get(answer, "content"), "application/json"), "schema");
}

static const struct route *route_of(const char *method, const char *path)
{
    size_t n = strcspn(path, "?");
    for (size_t i = 0; i < n_routes; i++)
        if (!strcmp(routes[i].method, method) && strlen(routes[i].path) == n &&
            !strncmp(routes[i].path, path, n))
            return &routes[i];
    fail_msg("no route %s %s", method, path);
    return NULL;
}

/*
 * Promise(page/page-plant-lists)
 * Promise(server/routes-answers-openapi)
 */
static void answers_are_what_openapi_says(void **state)
{
    static const struct {
        const char *path;
        int status;
    } cases[] = {
        {"/api/session", 200},
        {"/api/plant", 200},
        {"/api/plants", 200},
        {"/api/state", 200},
        {"/api/history?var=sensor.1&since=-60&bins=10", 200},
        {"/api/history?var=setpoint.1&since=-1&last=10", 200},
        {"/api/history?names=y,setpoint.1,nonsense&since=-60&last=5", 200},
        {"/api/history?names=u&since=-60&bins=5", 200},
        {"/api/history?var=y&names=y&since=-60&bins=5", 422},
        {"/api/history?var=sensor.99&since=-60&bins=10", 404},
        {"/api/events", 200},
        {"/api/events?severity=4", 400},
        {"/api/timing", 200},
        {"/api/timing/series?task=controller&quantity=jitter", 200},
        {"/api/predictions", 200},
        {"/api/predictions?at=-3600", 200},
        {"/api/predictions?at=soon", 400},
        {"/api/alarms", 200},
        {"/api/alarms/journal", 200},
        {"/api/alarms/journal?since=-60&last=0", 400},
        {"/api/alarms/figures", 200},
        {"/api/alarms/figures?since=-60&until=-3600", 422},
        {"/api/alarms/trial", 400},
        {"/api/alarms/trial?alarm=none", 404},
        {"/api/kpis", 200},
        {"/api/kpis?since=-3600&until=-60", 200},
        {"/api/kpis?since=-60&until=-3600", 422},
        {"/api/health?since=-60&until=-3600", 422},
        {"/api/health?since=-8e6", 422},
        {"/api/health?since=1e9&until=1.001e9", 422},
        {"/api/health?since=soon", 400},
        {"/api/why?output=u", 200},
        {"/api/why?output=u&at=-1&over=0.5", 200},
        {"/api/why?output=u&at=-3600", 404},
        {"/api/why?output=v", 404},
        {"/api/why?output=u&over=1d", 400},
        {"/api/retake?at=-1", 200},
        {"/api/retake?at=-1&names=u,Kp", 200},
        {"/api/retake?at=-1&names=q", 404},
        {"/api/retake?at=1e9", 422},
        {"/api/retake?at=3e9", 422},
        {"/api/retake", 400},
        {"/api/diagnostics", 200},
        {"/api/writes", 200},
        {"/api/writes?key=no-such-key", 404},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        json_t *json;
        int status = client_get(&local, cases[i].path, &json);
        if (status != cases[i].status)
            fail_msg("%s: %d", cases[i].path, status);
        assert_non_null(json);
        schema_check(openapi, schema_of(route_of("GET", cases[i].path), status), json, cases[i].path);
        json_decref(json);
    }
}

/* Promise(laws/former) */
static void a_former_path_is_answered_with_the_present_one_beside(void **state)
{
    static const struct {
        const char *former, *link, *has;
    } of[] = {{"/api/merits", "</api/kpis>; rel=\"successor-version\"", "\"loops\":["},
              {"/api/outlook", "</api/predictions>; rel=\"successor-version\"", "\"outlook\":["},
              {"/api/kpis", "", "\"loops\":["},
              {"/api/predictions", "", "\"predictions\":["}};
    (void)state;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct http_reply reply;
        char text[100];
        http_request(&reply, local.port, "GET", of[i].former, NULL, NULL);
        assert_int_equal(reply.status, 200);
        assert_string_equal(http_header(&reply, "Link", text, sizeof text), of[i].link);
        assert_non_null(strstr(reply.body, of[i].has));
        http_free(&reply);
    }
}

/* ---- Access ------------------------------------------------------------------------------- */

/* Promise(server/users) */
static void a_stranger_gets_401_on_every_route(void **state)
{
    (void)state;
    for (size_t i = 0; i < n_routes; i++) {
        struct http_reply reply;
        const char *path = routes[i].where == PAGE ? "/" : routes[i].path;
        if (routes[i].role == ROLE_NONE)
            continue;
        http_request(&reply, stranger.port, routes[i].method, path, JSON,
                     !strcmp(routes[i].method, "POST") ? "{}" : NULL);
        if (reply.status != 401)
            fail_msg("%s %s: %d", routes[i].method, path, reply.status);
        http_free(&reply);
    }
    expect_error(&stranger, "GET", "/no/such/path", NULL, NULL, 401, "login");
    expect_error(&stranger, "GET", "/index.html", NULL, NULL, 401, "login");
    expect_error(&stranger, "DELETE", "/api/state", NULL, NULL, 401, "login");
    expect_error(&stranger, "GET", "/api/state", "Cookie: apc-session-1=0\r\n", NULL, 401, "login");
}

/* Promise(server/users) */
static void only_these_need_no_login(void **state)
{
    static const char *const anyone[] = {"/api/login", "/livez", "/readyz"};
    size_t n = 0;
    (void)state;
    for (size_t i = 0; i < n_routes; i++)
        if (routes[i].role == ROLE_NONE)
            assert_string_equal(routes[i].path, anyone[n++]);
    assert_int_equal(n, 3);
    assert_int_equal(client_get(&stranger, "/livez", NULL), 200);
    assert_int_equal(client_get(&stranger, "/readyz", NULL), 200);
}

/* Promise(server/users) */
static void a_browser_without_a_session_gets_the_form(void **state)
{
    struct http_reply reply;
    char text[300];
    (void)state;
    http_request(&reply, stranger.port, "GET", "/", "Accept: text/html\r\n", NULL);
    assert_int_equal(reply.status, 401);
    assert_non_null(strstr(reply.body, "<form method=\"post\" action=\"/api/login\">"));
    http_free(&reply);
    http_request(&reply, stranger.port, "POST", "/api/login",
                 "Content-Type: application/x-www-form-urlencoded\r\n", "user=otto&password=observer%3123");
    assert_int_equal(reply.status, 303);
    assert_string_equal(http_header(&reply, "Location", text, sizeof text), "/");
    http_header(&reply, "Set-Cookie", text, sizeof text);
    assert_non_null(strstr(text, "HttpOnly"));
    assert_non_null(strstr(text, "SameSite=Strict"));
    http_free(&reply);
    http_request(&reply, stranger.port, "POST", "/api/login",
                 "Content-Type: application/x-www-form-urlencoded\r\n", "user=%3Cb%3E&password=x");
    assert_int_equal(reply.status, 401);
    assert_non_null(strstr(reply.body, "name or password is wrong"));
    assert_null(strstr(reply.body, "<b>"));
    http_free(&reply);
}

/* Promise(page/write-nothing-long) */
static void an_open_server_says_that_it_is_one(void **state)
{
    json_t *session;
    (void)state;
    client_get(&local, "/api/session", &session);
    assert_true(json_is_false(json_object_get(session, "protected")));
    assert_string_equal(text_of(session, "role"), "engineer");
    assert_true(json_is_null(json_object_get(session, "idle")));
    json_decref(session);
    client_get(&anna, "/api/session", &session);
    assert_true(json_number_value(json_object_get(session, "idle")) == 1800); /* who only looks may stay */
    json_decref(session);
    client_get(&otto, "/api/session", &session);
    assert_true(json_is_true(json_object_get(session, "protected")));
    assert_string_equal(text_of(session, "role"), "observer");
    assert_string_equal(text_of(session, "user"), "otto");
    assert_true(json_is_null(json_object_get(session, "idle")));
    json_decref(session);
}

/*
 * Promise(server/headers): Each answer has the headers that protect it; CSRF, origin and host are looked
 *   at.
 */
static void every_answer_carries_the_headers_that_protect_it(void **state)
{
    static const char *const names[][2] = {{"Content-Security-Policy", "default-src 'self'"},
                                           {"X-Content-Type-Options", "nosniff"},
                                           {"X-Frame-Options", "DENY"},
                                           {"Cache-Control", "no-store"}};
    static const char *const paths[] = {"/api/state", "/api/nothing", "/livez", "/metrics"};
    char text[400];
    (void)state;
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        struct http_reply reply;
        http_request(&reply, local.port, "GET", paths[i], NULL, NULL);
        for (size_t k = 0; k < sizeof names / sizeof *names; k++)
            assert_non_null(strstr(http_header(&reply, names[k][0], text, sizeof text), names[k][1]));
        assert_string_equal(http_header(&reply, "Access-Control-Allow-Origin", text, sizeof text), "");
        http_free(&reply);
    }
}

static void a_session_ends_with_logout(void **state)
{
    struct client c = client_make(anna.port, "otto", "observer123");
    struct http_stream *stream = client_stream(&c, NULL);
    json_t *data = next_event(stream, "hello", NULL);
    (void)state;
    json_decref(data);
    assert_int_equal(client_post(&c, "/api/logout", "{}", NULL), 200);
    expect_error(&c, "GET", "/api/state", NULL, NULL, 401, "login");
    data = next_event(stream, "bye", NULL);
    assert_string_equal(text_of(data, "reason"), "session");
    json_decref(data);
    http_stream_close(stream);
}

/* Promise(server/status-codes) */
static void failed_logins_have_to_wait(void **state)
{
    struct http_reply reply;
    char seconds[32];
    int status = 0;
    (void)state;
    /* at its own server: the pause is for this name at this address */
    int port = environment_port("APC_UI_LOGIN");
    struct http_reply login;
    char device[300], header[400];
    http_request(&login, port, "POST", "/api/login", JSON,
                 "{\"user\":\"anna\",\"password\":\"operator123\"}");
    assert_int_equal(login.status, 200);
    const char *cookie = strstr(login.header, "apc-device-");
    assert_non_null(cookie);
    snprintf(device, sizeof device, "%.*s", (int)strcspn(cookie, ";"), cookie);
    http_free(&login);
    /* Until the pause is long enough for what follows, on any machine. The pause is the server's promise: that it holds is
     * what is tested. */
    for (int pause = 0; pause < 8;) {
        http_request(&reply, port, "POST", "/api/login", JSON, "{\"user\":\"anna\",\"password\":\"wrong\"}");
        status = reply.status;
        assert_true(status == 401 || status == 429);
        http_header(&reply, "Retry-After", seconds, sizeof seconds);
        pause = *seconds ? whole_number(seconds) : 0;
        if (pause >= 8)
            break;
        http_free(&reply);
        sleep((unsigned)pause);
    }
    assert_int_equal(status, 429);
    http_free(&reply);
    /* the right password has to wait as well, or the pause would tell whether it is the right one */
    http_request(&reply, port, "POST", "/api/login", JSON,
                 "{\"user\":\"anna\",\"password\":\"operator123\"}");
    assert_int_equal(reply.status, 429);
    http_free(&reply);
    /* but not in a browser in which anna has logged in before, nor for another name, nor from another address */
    snprintf(header, sizeof header, JSON "Cookie: %s\r\n", device);
    http_request(&reply, port, "POST", "/api/login", header,
                 "{\"user\":\"anna\",\"password\":\"operator123\"}");
    assert_int_equal(reply.status, 200);
    http_free(&reply);
    http_request(&reply, port, "POST", "/api/login", header,
                 "{\"user\":\"otto\",\"password\":\"observer123\"}");
    assert_int_equal(reply.status, 200);
    http_free(&reply);
    http_from("127.0.0.2");
    http_request(&reply, port, "POST", "/api/login", JSON,
                 "{\"user\":\"anna\",\"password\":\"operator123\"}");
    http_from(NULL);
    assert_int_equal(reply.status, 200);
    http_free(&reply);
}

/* ---- Bad input: nothing is written -------------------------------------------------------- */

/* Promise(server/status-codes) */
static void refused_requests_write_nothing(void **state)
{
    char header[200], stale[200], output[200], tuning[400];
    const int64_t z = seq_of(&anna, "setpoint.1"), manual = seq_of(&anna, "manual.1"),
                  mode = seq_of(&anna, "opmode.1"), kp = seq_of(&anna, "tuning.1");
    char good[200];
    (void)state;
    snprintf(good, sizeof good, "{\"id\":1,\"value\":3,\"seq\":%" JSON_INTEGER_FORMAT "}", (json_int_t)z);
    const struct {
        const struct client *who;
        const char *path, *header, *body;
        int status;
        const char *code;
    } cases[] = {
        {&stranger, "/api/setpoint", NULL, good, 401, "login"},
        {&otto, "/api/setpoint", NULL, good, 403, "role"},
        {&otto, "/api/mode", NULL, "{\"id\":1,\"mode\":\"Man\",\"seq\":1}", 403, "role"},
        {&anna, "/api/setpoint", JSON "Origin: http://evil.example\r\n", good, 403, "origin"},
        {&anna, "/api/setpoint", JSON "Origin: null\r\n", good, 403, "origin"},
        {&anna, "/api/setpoint", JSON "Sec-Fetch-Site: cross-site\r\n", good, 403, "origin"},
        {&anna, "/api/setpoint", JSON "Host: evil.example\r\n", good, 403, "host"},
        {&anna, "/api/setpoint", "Content-Type: text/plain\r\n", good, 415, "type"},
        {&anna, "/api/setpoint", "Content-Type: application/x-www-form-urlencoded\r\n", "id=1&value=3", 415,
         "type"},
        {&anna, "/api/setpoint", NULL, "", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,", 400, "json"},
        {&anna, "/api/setpoint", NULL, "[1]", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":3,\"seq\":1,\"sec\":1}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":3,\"value\":4,\"seq\":1}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":3}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":3,\"seq\":-1}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":NaN,\"seq\":1}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":1e999,\"seq\":1}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":\"3\",\"seq\":1}", 422, "value"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":null,\"seq\":1}", 422, "value"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":3,\"seq\":1,\"key\":\"x\"}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":9,\"value\":3,\"seq\":1}", 404, "variable"},
        {&anna, "/api/setpoint", NULL, "{\"id\":4294967297,\"value\":3,\"seq\":1}", 400, "json"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":100.5,\"seq\":1}", 422, "limits"},
        {&anna, "/api/setpoint", NULL, "{\"id\":1,\"value\":-1e300,\"seq\":1}", 422, "limits"},
        {&anna, "/api/setpoint", NULL, stale, 409, "stale"},
        {&anna, "/api/output", NULL, output, 409, "mode"},
        {&anna, "/api/output", NULL, "{\"id\":1,\"value\":11,\"seq\":0}", 422, "limits"},
        {&anna, "/api/mode", NULL, "{\"id\":1,\"mode\":\"Cas\",\"seq\":1}", 422,
         "value"}, /* nobody is above */
        {&anna, "/api/mode", NULL, "{\"id\":1,\"mode\":\"LO\",\"seq\":1}", 422, "value"},
        {&anna, "/api/mode", NULL, "{\"id\":1,\"mode\":1,\"seq\":1}", 400, "json"},
        {&anna, "/api/mode", NULL, "{\"mode\":\"Man\",\"seq\":1}", 400, "json"},
        {&anna, "/api/mode", NULL, "{\"id\":2,\"mode\":\"Man\",\"seq\":1}", 404, "variable"},
        {&anna, "/api/mode", NULL, "{\"id\":1,\"mode\":\"Man\",\"seq\":0}", 409, "stale"},
        {&otto, "/api/alarms/y.high/ack", NULL, "{\"seq\":1}", 403, "role"},
        {&otto, "/api/alarms/y.high/shelve", NULL, "{\"until\":0,\"seq\":1}", 403, "role"},
        {&otto, "/api/alarms/y.high/service", NULL, "{\"out\":true,\"seq\":1}", 403, "role"},
        {&anna, "/api/alarms/y.high/service", NULL, "{\"out\":1,\"seq\":1}", 400, "json"},
        {&anna, "/api/alarms/y.high/ack", JSON "Origin: null\r\n", "{\"seq\":1}", 403, "origin"},
        {&anna, "/api/alarms/y.high/ack", NULL, "{\"seq\":1,\"name\":\"y\"}", 400, "json"},
        {&anna, "/api/alarms/y.high/ack", NULL, "{\"seq\":1}", 404, "alarm"}, /* there are none */
        {&anna, "/api/alarms/y.high/shelve", NULL, "{\"until\":-1,\"seq\":1}", 400, "json"},
        {&anna, "/api/alarms//ack", NULL, "{\"seq\":1}", 404, "path"},
        {&anna, "/api/alarms/ack", NULL, "{\"seq\":1}", 404, "path"},
        {&anna, "/api/retake", NULL, "{\"at\":1e9}", 400, "json"},
        {&anna, "/api/retake", NULL, "{\"at\":1e9,\"seen\":{}}", 422, "value"},
        {&anna, "/api/retake", NULL, "{\"at\":-5,\"seen\":{}}", 422, "value"},
        {&anna, "/api/retake", NULL, "{\"at\":3e9,\"seen\":{}}", 422, "value"},
        {&anna, "/api/tuning", NULL, "{\"values\":[]}", 400, "json"},
        {&anna, "/api/tuning", NULL, "{\"values\":[1]}", 400, "json"},
        {&anna, "/api/tuning", NULL, tuning, 409, "stale"}, /* one of two is */
        {&anna, "/api/tuning", NULL, "{\"values\":[{\"id\":2,\"value\":0,\"seq\":1}]}", 422, "limits"},
    };
    snprintf(stale, sizeof stale, "{\"id\":1,\"value\":3,\"seq\":%" JSON_INTEGER_FORMAT "}",
             (json_int_t)z + 1);
    snprintf(output, sizeof output, "{\"id\":1,\"value\":1,\"seq\":%" JSON_INTEGER_FORMAT "}",
             (json_int_t)manual);
    snprintf(tuning, sizeof tuning,
             "{\"values\":[{\"id\":1,\"value\":0.3,\"seq\":%" JSON_INTEGER_FORMAT
             "},{\"id\":2,\"value\":2,\"seq\":77}]}",
             (json_int_t)kp);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (cases[i].code)
            expect_error(cases[i].who, "POST", cases[i].path, cases[i].header, cases[i].body, cases[i].status,
                         cases[i].code);

    struct client forger = anna;
    forger.csrf[0] = '\0';
    expect_error(&forger, "POST", "/api/setpoint", NULL, good, 403, "csrf");
    expect_error(&forger, "POST", "/api/setpoint", JSON "X-CSRF-Token: 00\r\n", good, 403, "csrf");
    snprintf(header, sizeof header, JSON "X-CSRF-Token: %s\r\n", otto.csrf);
    expect_error(&forger, "POST", "/api/setpoint", header, good, 403, "csrf");
    struct client open_forger = {.port = local.port};
    expect_error(&open_forger, "POST", "/api/setpoint", NULL, good, 403, "csrf");

    assert_int_equal(seq_of(&anna, "setpoint.1"), z);
    assert_int_equal(seq_of(&anna, "manual.1"), manual);
    assert_int_equal(seq_of(&anna, "opmode.1"), mode);
    assert_int_equal(seq_of(&anna, "tuning.1"), kp);
}

/* Promise(page): A form older than the value is refused. */
static void a_stale_form_is_shown_the_newer_value(void **state)
{
    json_t *json;
    (void)state;
    assert_int_equal(client_post(&anna, "/api/setpoint", "{\"id\":1,\"value\":3,\"seq\":0}", &json), 409);
    const json_t *current =
        json_object_get(json_object_get(json_object_get(json, "error"), "current"), "setpoint.1");
    assert_int_equal(json_integer_value(json_array_get(current, 0)), seq_of(&anna, "setpoint.1"));
    assert_near(json_number_value(json_array_get(current, 2)), value_of(&anna, "setpoint.1"), 0);
    schema_check(openapi, schema_of(route_of("POST", "/api/setpoint"), 409), json, "409");
    json_decref(json);
}

/*
 * Promise(server/status-codes): Every status and code of the table in docs/http-api.md is given as it says.
 */
static void bad_parameters_and_paths_are_refused(void **state)
{
    static const struct {
        const char *path;
        int status;
        const char *code;
    } cases[] = {
        {"/api/history", 422, "parameter"},
        {"/api/why", 400, "parameter"},
        {"/api/why?output=u&over=-1", 400, "parameter"},
        {"/api/why?output=u&over=nan", 400, "parameter"},
        {"/api/why?output=u&over=86401", 400, "parameter"},
        {"/api/history?var=sensor.1&since=-60", 422, "parameter"},
        {"/api/history?var=sensor.1&since=-60&bins=10&last=10", 422, "parameter"},
        {"/api/history?var=sensor.1&since=-60&bins=0", 400, "parameter"},
        {"/api/history?var=sensor.1&since=-60&bins=4001", 400, "parameter"},
        {"/api/history?var=sensor.1&since=-60&bins=1e3", 400, "parameter"},
        {"/api/history?var=sensor.1&since=tomorrow&bins=9", 400, "parameter"},
        {"/api/history?var=sensor.1&since=nan&bins=9", 400, "parameter"},
        {"/api/history?var=sensor.1&since=1e300&bins=9", 400, "parameter"},
        {"/api/history?var=sensor.1&since=20&until=10&bins=9", 422, "parameter"},
        {"/api/history?var=sensor.1&sinse=-60&bins=9", 400, "parameter"},
        {"/api/history?var&since=-60&bins=9", 400, "parameter"},
        {"/api/history?var=sensor.1%27%3B--&since=-60&bins=9", 404, "variable"},
        {"/api/history?var=state.1&since=-60&bins=9", 404, "variable"},
        {"/api/history?var=sensor.-1&since=-60&bins=9", 404, "variable"},
        {"/api/timing?since=-1e6", 422, "parameter"},
        {"/api/timing?quantity=speed", 400, "parameter"},
        {"/api/timing/series?task=controller", 400, "parameter"},
        {"/api/nothing", 404, "path"},
        {"/../../../../etc/passwd", 404, "path"},
        {"/%2e%2e/%2e%2e/%2e%2e/etc/passwd", 404, "path"},
        {"/..%2f..%2f..%2fetc%2fpasswd", 404, "path"},
        {"/nothing/\\..\\..\\etc", 404, "path"},
        {"/%00", 400, "parameter"},
        {"/index.html%00.js", 400, "parameter"},
        {"/api/history?var=sensor.1%00&since=-60&bins=9", 400, "parameter"},
        {"/api/history?var=sensor.1&since=-60&bins=9&bins=9", 400, "parameter"},
        {"/api/history?var=sensor.1&since=-60&bins=9&var=setpoint.1", 400, "parameter"},
        {"/api/history?var=sensor.01&since=-60&bins=9", 404, "variable"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        expect_error(&local, "GET", cases[i].path, NULL, NULL, cases[i].status, cases[i].code);
    expect_error(&local, "POST", "/api/state", NULL, "{}", 405, "method");
    expect_error(&local, "GET", "/api/setpoint", NULL, NULL, 405, "method");
    expect_error(&local, "PUT", "/", NULL, NULL, 405, "method");
    expect_error(&local, "PUT", "/nothing", NULL, NULL, 404, "path");
}

/* Promise(server/status-codes) */
static void a_body_that_is_too_large_is_refused(void **state)
{
    const size_t size = 10 << 20;
    char *bytes = malloc(size + 1000), *at = bytes;
    struct http_reply reply;
    (void)state;
    assert_non_null(bytes);
    int n = snprintf(bytes, 1000,
                     "POST /api/setpoint HTTP/1.1\r\nHost: localhost\r\nX-CSRF-Token: %s\r\n" JSON
                     "Content-Length: %zu\r\nConnection: close\r\n\r\n",
                     local.csrf, size);
    memset(bytes + n, ' ', size);
    http_raw(&reply, local.port, bytes, (size_t)n + size);
    /* it may have closed while we were still sending: then its answer is lost, as HTTP has it */
    assert_true(reply.status == 413 || reply.status == 0);
    http_free(&reply);
    at += snprintf(bytes, 1000,
                   "POST /api/setpoint HTTP/1.1\r\nHost: localhost\r\nX-CSRF-Token: %s\r\n" JSON
                   "Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n",
                   local.csrf);
    for (int i = 0; i < 20; i++) { /* 80 KiB that were not announced */
        at = stpcpy(at, "1000\r\n");
        memset(at, ' ', 4096);
        at = stpcpy(at + 4096, "\r\n");
    }
    at = stpcpy(at, "0\r\n\r\n");
    http_raw(&reply, local.port, bytes, (size_t)(at - bytes));
    assert_int_equal(reply.status, 413);
    http_free(&reply);
    free(bytes);
}

static void what_is_no_http_is_turned_away(void **state)
{
    static const char *const garbage[] = {"\r\n\r\n\r\n", "GET\r\n\r\n",
                                          "\x16\x03\x01\x02\x00\x01\x00\x01\xfc",
                                          "GET /api/state HTTP/1.1\r\n\r\n", /* without a host */
                                          "GET /api/state HTTP/9.9\r\nHost: localhost\r\n\r\n"};
    (void)state;
    for (size_t i = 0; i < sizeof garbage / sizeof *garbage; i++) {
        struct http_reply reply;
        char bytes[200];
        /* closing our half tells it that no more will come */
        int fd = http_connect(local.port);
        snprintf(bytes, sizeof bytes, "%s", garbage[i]);
        assert_true(http_send(fd, bytes, strlen(bytes)));
        close(fd);
        http_request(&reply, local.port, "GET", "/livez", NULL, NULL);
        assert_int_equal(reply.status, 200);
        http_free(&reply);
    }
    char *header = malloc(100000);
    assert_non_null(header);
    memcpy(header, "X-Long: ", 8);
    memset(header + 8, 'x', 99000);
    memcpy(header + 99008, "\r\n", 3);
    struct http_reply reply;
    http_request(&reply, local.port, "GET", "/api/state", header, NULL);
    assert_true(reply.status == 431 || reply.status == 413 || reply.status == 0);
    http_free(&reply);
    free(header);
}

/* ---- Writes ------------------------------------------------------------------------------- */

/* Write, and see it applied. Returns the last state of the write. */
static json_t *applied(const struct client *c, struct http_stream *stream, const char *path, const char *body)
{
    json_t *answer;
    int status = client_post(c, path, body, &answer);
    if (status != 200)
        fail_msg("%s %s: %d %s", path, body, status, json_dumps(answer, 0));
    schema_check(openapi, schema_of(route_of("POST", path), 200), answer, path);
    assert_string_equal(text_of(answer, "state"), "accepted");
    char key[80];
    snprintf(key, sizeof key, "%s", text_of(answer, "key"));
    json_decref(answer);
    return await_write(stream, key, "applied");
}

static void write_value(const struct client *c, struct http_stream *stream, const char *path, const char *ref,
                        int id, double value)
{
    char body[200];
    snprintf(body, sizeof body, "{\"id\":%d,\"value\":%.17g,\"seq\":%" JSON_INTEGER_FORMAT "}", id, value,
             (json_int_t)seq_of(c, ref));
    json_decref(applied(c, stream, path, body));
    assert_near(value_of(c, ref), value, 0);
}

static void write_mode(const struct client *c, struct http_stream *stream, const char *mode, double number)
{
    char body[200];
    snprintf(body, sizeof body, "{\"id\":1,\"mode\":\"%s\",\"seq\":%" JSON_INTEGER_FORMAT "}", mode,
             (json_int_t)seq_of(c, "opmode.1"));
    json_decref(applied(c, stream, "/api/mode", body));
    assert_near(value_of(c, "opmode.1"), number, 0);
    assert_near(value_of(c, "actual.21"), number, 0);
}

/* Promise(server/states-of-a-write) */
static void what_an_operator_writes_is_accepted_then_applied(void **state)
{
    struct http_stream *stream = client_stream(&anna, NULL);
    char body[400];
    (void)state;
    json_decref(next_event(stream, "state", NULL));
    write_value(&anna, stream, "/api/setpoint", "setpoint.1", 1, 12.5);
    write_mode(&anna, stream, "Man", 0);
    write_value(&anna, stream, "/api/output", "manual.1", 1, 1.5);
    assert_near(value_of(&anna, "actuator.1"), 1.5, 0);
    write_value(&anna, stream, "/api/setpoint", "setpoint.1", 1, 13.5); /* also in Man */
    snprintf(body, sizeof body,
             "{\"values\":[{\"id\":1,\"value\":0.25,\"seq\":%" JSON_INTEGER_FORMAT
             "},{\"id\":2,\"value\":1.25,\"seq\":%" JSON_INTEGER_FORMAT "}]}",
             (json_int_t)seq_of(&anna, "tuning.1"), (json_int_t)seq_of(&anna, "tuning.2"));
    json_t *write = applied(&anna, stream, "/api/tuning", body);
    const json_t *change = json_array_get(json_object_get(write, "changes"), 1);
    assert_string_equal(text_of(change, "name"), "tau_i");
    assert_near(number_of(change, "to"), 1.25, 0);
    json_decref(write);
    write_mode(&anna, stream, "Auto", 1);
    assert_near(value_of(&anna, "tuning.1"), 0.25, 0);
    assert_near(value_of(&anna, "tuning.2"), 1.25, 0);
    http_stream_close(stream);
}

/* Promise(server/every-write-every): Every write and every refusal is on record, a flood in a few rows. */
static void each_write_is_recorded_with_its_operator(void **state)
{
    json_t *json;
    char text[100];
    (void)state;
    double before = value_of(&anna, "setpoint.1"), after = before + 1;
    struct http_stream *stream = client_stream(&otto, NULL);
    json_decref(next_event(stream, "state", NULL));
    snprintf(text, sizeof text, "{\"id\":1,\"value\":%.17g,\"seq\":%" JSON_INTEGER_FORMAT "}", after,
             (json_int_t)seq_of(&anna, "setpoint.1"));
    assert_int_equal(client_post(&anna, "/api/setpoint", text, NULL), 200);
    snprintf(text, sizeof text, "r: %g -> %.17g (from 127.0.0.1)", before, after);
    assert_int_equal(client_get(&otto, "/api/events?kind=operator&source=anna&last=1", &json), 200);
    const json_t *event = json_array_get(json_object_get(json, "events"), 0);
    assert_string_equal(text_of(event, "text"), text);
    json_decref(json);
    for (bool told = false; !told;) { /* and everybody who watches is told */
        json = next_event(stream, "event", NULL);
        size_t i;
        json_array_foreach(json_object_get(json, "events"), i, event) told |=
            !strcmp(text_of(event, "text"), text);
        json_decref(json);
    }
    http_stream_close(stream);
}

/* Wait for a row of this user about a refusal, with this in its text. */
static void await_refusal(const struct client *reader, const char *source, const char *part)
{
    char path[200];
    bool found = false;
    struct http_stream *stream = client_stream(reader, NULL);
    snprintf(path, sizeof path, "/api/events?kind=access&source=%s&last=50", source);
    while (!found) {
        json_t *json;
        const json_t *event;
        size_t i;
        json_decref(next_event(stream, "beat", NULL));
        assert_int_equal(client_get(reader, path, &json), 200);
        json_array_foreach(json_object_get(json, "events"), i, event) found |=
            strstr(text_of(event, "text"), part) != NULL;
        json_decref(json);
    }
    http_stream_close(stream);
}

/* Promise(server/every-write-every) */
static void what_was_refused_is_recorded_as_well(void **state)
{
    struct client forger = local;
    (void)state;
    expect_error(&otto, "POST", "/api/mode", NULL, "{\"id\":1,\"mode\":\"Man\",\"seq\":1}", 403, "role");
    await_refusal(&otto, "otto", "/api/mode from 127.0.0.1: otto is an observer");
    expect_error(&local, "POST", "/api/setpoint", NULL, "{\"id\":1,\"value\":1e6,\"seq\":1}", 422, "limits");
    await_refusal(&otto, "local", "r = 1000000 lies outside its limits -100 to 100");
    forger.csrf[0] = '\0';
    expect_error(&forger, "POST", "/api/setpoint", NULL, "{}", 403, "csrf");
    await_refusal(&otto, "local", "lacks this session's token");
}

/* The raw bytes of one request after another; the number of answers, and the status of the first. */
static int answers(const char *bytes, int *status)
{
    struct http_reply reply;
    int count = 0;
    http_raw(&reply, local.port, bytes, strlen(bytes));
    *status = reply.status;
    for (const char *at = reply.body; at && (at = strstr(at, "HTTP/1.1 ")) != NULL; at++)
        count++;
    count += reply.status != 0;
    http_free(&reply);
    return count;
}

/* Promise(server/status-codes) */
static void a_request_that_says_twice_where_it_ends_is_the_last_of_its_connection(void **state)
{
#define AFTER "GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    static const char *const twice[] = {
        "POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
        "Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n" AFTER,
        "POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
        "Transfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n\r\n" AFTER,
        "POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
        "Content-Length: 2\r\nContent-Length: 2\r\n\r\n{}" AFTER,
        "POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
        "Content-Length: 2\r\ncontent-length: 0\r\n\r\n{}" AFTER,
        "GET /livez HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\nContent-Length: 80\r\n\r\n" AFTER,
        "GET /livez HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n" AFTER,
        "GET /livez HTTP/1.1\r\nHost: localhost\r\nHOST: evil.example\r\n\r\n" AFTER,
    };
    int status;
    (void)state;
    assert_int_equal(answers("GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n" AFTER, &status), 2);
    assert_int_equal(status, 200);
    for (size_t i = 0; i < sizeof twice / sizeof *twice; i++) {
        int n = answers(twice[i], &status);
        if (n != 1 || status != 400)
            fail_msg("%s: %d answers, the first %d", twice[i], n, status);
    }
}

/* ---- Machines ----------------------------------------------------------------------------- */

/* Promise(server/users) */
static void a_token_opens_what_its_role_may_without_a_login(void **state)
{
    const char *observer = getenv("APC_UI_OBSERVER_TOKEN"), *writer = getenv("APC_UI_OPERATOR_TOKEN");
    char header[300], body[200];
    struct http_reply reply;
    (void)state;
    assert_non_null(observer);
    assert_non_null(writer);
    snprintf(header, sizeof header, "Authorization: Bearer %s\r\n", observer);
    http_request(&reply, stranger.port, "GET", "/metrics", header, NULL);
    assert_int_equal(reply.status, 200);
    assert_string_equal(http_header(&reply, "Set-Cookie", body, sizeof body), "");
    http_free(&reply);
    snprintf(header, sizeof header, JSON "Authorization: Bearer %s\r\n", observer);
    expect_error(&stranger, "POST", "/api/mode", header, "{\"id\":1,\"mode\":\"Man\",\"seq\":1}", 403,
                 "role");
    snprintf(header, sizeof header, JSON "Authorization: Bearer %s\r\n", writer);
    snprintf(body, sizeof body, "{\"id\":1,\"value\":15,\"seq\":%" JSON_INTEGER_FORMAT "}",
             (json_int_t)seq_of(&anna, "setpoint.1"));
    http_request(&reply, stranger.port, "POST", "/api/setpoint", header, body); /* no cookie, so no CSRF */
    assert_int_equal(reply.status, 200);
    http_free(&reply);
}

static void what_is_no_token_opens_nothing(void **state)
{
    char token[200], header[300];
    (void)state;
    snprintf(token, sizeof token, "%s", getenv("APC_UI_OBSERVER_TOKEN"));
    token[strlen(token) - 1] ^= 1;
    const char *const wrong[] = {"Bearer ",         "Bearer grafana",
                                 "Bearer grafana~", "Bearer ~",
                                 "Basic !!!",       "Basic YW5uYTpvcGVyYXRvcjEyMw==" /* anna's password */,
                                 "Digest x",        ""};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        snprintf(header, sizeof header, "Authorization: %s\r\n", wrong[i]);
        expect_error(&stranger, "GET", "/metrics", header, NULL, 401, "token");
        expect_error(&local, "GET", "/metrics", header, NULL, 401, "token"); /* nor does it add to anything */
    }
    snprintf(header, sizeof header, "Authorization: Bearer %s\r\n", token);
    expect_error(&stranger, "GET", "/metrics", header, NULL, 401, "token");
}

static void a_token_works_with_basic_too(void **state)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char pair[200], header[400] = "Authorization: Basic ";
    struct http_reply reply;
    (void)state;
    memset(pair, 0, sizeof pair);
    snprintf(pair, sizeof pair - 3, "%s", getenv("APC_UI_OBSERVER_TOKEN"));
    *strchr(pair, '~') = ':';
    size_t n = strlen(pair), at = strlen(header);
    for (size_t i = 0; i < n; i += 3) {
        unsigned long bits = (unsigned long)(unsigned char)pair[i] << 16 |
                             (unsigned long)(unsigned char)pair[i + 1] << 8 | (unsigned char)pair[i + 2];
        for (unsigned k = 0; k < 4; k++)
            header[at++] = i + k > n ? '=' : digits[bits >> (18 - 6 * k) & 63];
    }
    snprintf(header + at, sizeof header - at, "\r\n");
    http_request(&reply, stranger.port, "GET", "/metrics", header, NULL);
    assert_int_equal(reply.status, 200);
    http_free(&reply);
}

/* Promise(server/stream) */
static void a_session_has_its_share_of_streams(void **state)
{
    struct client c = client_make(anna.port, "otto", "observer123"), other;
    struct http_stream *streams[8];
    (void)state;
    for (size_t i = 0; i < 8; i++)
        streams[i] = client_stream(&c, NULL);
    expect_error(&c, "GET", "/events", NULL, NULL, 503, "busy");
    other = client_make(anna.port, "anna", "operator123");
    http_stream_close(client_stream(&other, NULL));
    for (size_t i = 0; i < 8; i++)
        http_stream_close(streams[i]);
}

/* Promise(server/states-of-a-write) */
static void a_key_that_was_used_writes_nothing_again(void **state)
{
    char body[300], key[40];
    json_t *first, *again;
    (void)state;
    int64_t seq = seq_of(&anna, "setpoint.1");
    snprintf(key, sizeof key, "test-key-%ld", (long)getpid());
    snprintf(body, sizeof body, "{\"id\":1,\"value\":14,\"seq\":%" JSON_INTEGER_FORMAT ",\"key\":\"%s\"}",
             (json_int_t)seq, key);
    assert_int_equal(client_post(&anna, "/api/setpoint", body, &first), 200);
    assert_int_equal(client_post(&anna, "/api/setpoint", body, &again), 200);
    assert_string_equal(text_of(again, "key"), key);
    assert_true(json_equal(json_object_get(first, "changes"), json_object_get(again, "changes")));
    json_decref(again);
    snprintf(body, sizeof body, "/api/writes?key=%s", key);
    assert_int_equal(client_get(&anna, body, &again), 200);
    assert_int_equal(json_array_size(json_object_get(again, "writes")), 1);
    json_decref(again);
    json_decref(first);
    struct http_stream *stream = client_stream(&anna, NULL);
    while (seq_of(&anna, "setpoint.1") < seq + 1)
        json_decref(next_event(stream, "values", NULL));
    assert_int_equal(seq_of(&anna, "setpoint.1"), seq + 1);
    http_stream_close(stream);
}

/* ---- The stream --------------------------------------------------------------------------- */

/*
 * Promise(server/stream): The stream: everything first, then changes, resumed where it broke off, the slow
 *   are dropped and told.
 */
static void a_stream_begins_with_everything_and_goes_on_with_changes(void **state)
{
    struct http_stream *stream = client_stream(&otto, NULL);
    struct http_message message;
    (void)state;
    assert_true(http_stream_next(stream, &message));
    assert_string_equal(message.event, "hello");
    assert_true(http_stream_next(stream, &message));
    assert_string_equal(message.event, "state");
    json_t *data = json_loads(message.data, 0, NULL);
    schema_check(openapi,
                 json_object_get(json_object_get(json_object_get(openapi, "components"), "schemas"), "State"),
                 data, "state");
    json_decref(data);
    double before = 0;
    for (int i = 0; i < 5; i++) {
        data = next_event(stream, "values", &message);
        assert_true(message.id[0] != '\0');
        const json_t *y = json_object_get(json_object_get(data, "values"), "sensor.1");
        if (y) {
            double seq = json_number_value(json_array_get(y, 0));
            assert_true(seq > before);
            before = seq;
        }
        json_decref(data);
    }
    data = next_event(stream, "beat", &message);
    assert_string_equal(message.id, "");
    json_decref(data);
    http_stream_close(stream);
}

/* Promise(server/stream) */
static void a_stream_goes_on_where_it_was_left(void **state)
{
    struct http_stream *stream = client_stream(&otto, NULL);
    struct http_message message;
    char last[64];
    (void)state;
    json_decref(next_event(stream, "values", &message));
    snprintf(last, sizeof last, "%s", message.id);
    json_decref(next_event(stream, "values", &message));
    char follows[64];
    snprintf(follows, sizeof follows, "%s", message.id);
    http_stream_close(stream);

    stream = client_stream(&otto, last);
    json_t *hello = next_event(stream, "hello", NULL);
    assert_true(json_is_true(json_object_get(hello, "resumed")));
    json_decref(hello);
    do
        assert_true(http_stream_next(stream, &message));
    while (!message.id[0]);
    assert_true(strcmp(message.event, "state") != 0);
    /* what came next before comes next again; other kinds may lie between */
    while (strcmp(message.id, follows) != 0)
        assert_true(http_stream_next(stream, &message));
    http_stream_close(stream);

    static const char *const unknown[] = {"00000000.1", "nonsense", "00000000.99999999999999999999"};
    for (size_t i = 0; i < sizeof unknown / sizeof *unknown; i++) {
        stream = client_stream(&otto, unknown[i]);
        hello = next_event(stream, "hello", NULL);
        assert_true(json_is_false(json_object_get(hello, "resumed")));
        json_decref(hello);
        json_decref(next_event(stream, "state", NULL));
        http_stream_close(stream);
    }
}

/* ---- Slow clients ------------------------------------------------------------------------- */

/* They dribble a byte a look until they are thrown out; meanwhile the server answers others. */
/* Promise(server/rooms-shares-stranger) */
static void whoever_dribbles_is_thrown_out(void **state)
{
    static const char *const begun[] = {"GET /api/state HTTP/1.1\r\nHost: localhost\r\nX-Slow: ",
                                        "POST /api/login HTTP/1.1\r\nHost: localhost\r\n" JSON
                                        "Content-Length: 60000\r\n\r\n"};
    struct http_stream *stream = client_stream(&local, NULL);
    int fds[2];
    (void)state;
    for (size_t i = 0; i < 2; i++) {
        fds[i] = http_connect(local.port);
        assert_true(http_send(fds[i], begun[i], strlen(begun[i])));
    }
    for (int open = 2, beats = 0; open > 0; beats++) {
        assert_true(beats < 60);
        json_decref(next_event(stream, "beat", NULL));
        for (size_t i = 0; i < 2; i++)
            if (fds[i] >= 0 && (!http_send(fds[i], " ", 1) || !http_send(fds[i], " ", 1))) {
                close(fds[i]);
                fds[i] = -1;
                open--;
            }
        assert_int_equal(client_get(&local, "/api/state", NULL), 200);
    }
    http_stream_close(stream);
}

static bool still_open(int fd)
{
    char byte;
    return recv(fd, &byte, 1, MSG_DONTWAIT) < 0 && errno == EAGAIN;
}

/* Connections that send a header for ever, from two addresses, more than there is room for. They are closed
 * in the end; what counts is that a newcomer is answered before. */
/* Promise(server/rooms-shares-stranger) */
static void many_slow_strangers_keep_nobody_out(void **state)
{
    enum { SLOW = 700 };
    int *fds = calloc(SLOW, sizeof *fds);
    bool answered_beside_them = false;
    (void)state;
    assert_non_null(fds);
    for (int tries = 0; tries < 20 && !answered_beside_them; tries++) {
        for (int i = 0; i < SLOW; i++) {
            http_from(i % 2 ? "127.0.0.2" : "127.0.0.3");
            fds[i] = http_connect(anna.port);
            (void)http_send(fds[i], "GET /livez HTTP/1.1\r\nX-Slow: ", 29);
        }
        http_from(NULL);
        assert_int_equal(client_get(&stranger, "/livez", NULL), 200);
        assert_int_equal(client_get(&anna, "/api/state", NULL), 200);
        answered_beside_them = still_open(fds[SLOW - 1]) && still_open(fds[SLOW - 2]);
        for (int i = 0; i < SLOW; i++)
            close(fds[i]);
    }
    assert_true(answered_beside_them);
    free(fds);
}

/* ---- For the shell ------------------------------------------------------------------------ */

/* Is the loop running there? */
static int ready(const char *port)
{
    struct client c = {.port = whole_number(port)};
    return client_get(&c, "/readyz", NULL) == 200 && seq_of(&c, "actuator.1") > 0 &&
                   seq_of(&c, "actual.21") > 0
               ? 0
               : 1;
}

/* Show what the stream says, without values, until it ends. */
static int watch(const char *port, const char *user, const char *password)
{
    struct client c = client_make(whole_number(port), user, password);
    struct http_stream *stream = client_stream(&c, NULL);
    struct http_message message;
    while (http_stream_next(stream, &message)) {
        printf("%s %s\n", message.event, message.data);
        fflush(stdout);
    }
    http_stream_close(stream);
    return 0;
}

/* Send what stands on the input, show what comes back. */
static int raw(const char *port)
{
    char bytes[4096];
    size_t n = fread(bytes, 1, sizeof bytes, stdin);
    struct http_reply reply;
    http_raw(&reply, whole_number(port), bytes, n);
    printf("%s\r\n%s", reply.header ? reply.header : "", reply.body ? reply.body : "");
    http_free(&reply);
    return 0;
}

int main(int argc, char **argv)
{
    if (argc == 3 && !strcmp(argv[1], "--raw"))
        return raw(argv[2]);
    if (argc == 3 && !strcmp(argv[1], "--ready"))
        return ready(argv[2]);
    if (argc == 5 && !strcmp(argv[1], "--watch"))
        return watch(argv[2], argv[3], argv[4]);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(openapi_names_every_route_and_no_other),
        cmocka_unit_test(openapi_says_how_a_request_shows_who_it_is_from),
        cmocka_unit_test(answers_are_what_openapi_says),
        cmocka_unit_test(a_former_path_is_answered_with_the_present_one_beside),
        cmocka_unit_test(a_stranger_gets_401_on_every_route),
        cmocka_unit_test(only_these_need_no_login),
        cmocka_unit_test(a_browser_without_a_session_gets_the_form),
        cmocka_unit_test(an_open_server_says_that_it_is_one),
        cmocka_unit_test(every_answer_carries_the_headers_that_protect_it),
        cmocka_unit_test(a_session_ends_with_logout),
        cmocka_unit_test(failed_logins_have_to_wait),
        cmocka_unit_test(refused_requests_write_nothing),
        cmocka_unit_test(a_stale_form_is_shown_the_newer_value),
        cmocka_unit_test(bad_parameters_and_paths_are_refused),
        cmocka_unit_test(a_body_that_is_too_large_is_refused),
        cmocka_unit_test(what_is_no_http_is_turned_away),
        cmocka_unit_test(what_an_operator_writes_is_accepted_then_applied),
        cmocka_unit_test(each_write_is_recorded_with_its_operator),
        cmocka_unit_test(what_was_refused_is_recorded_as_well),
        cmocka_unit_test(a_request_that_says_twice_where_it_ends_is_the_last_of_its_connection),
        cmocka_unit_test(a_token_opens_what_its_role_may_without_a_login),
        cmocka_unit_test(what_is_no_token_opens_nothing),
        cmocka_unit_test(a_token_works_with_basic_too),
        cmocka_unit_test(a_session_has_its_share_of_streams),
        cmocka_unit_test(a_key_that_was_used_writes_nothing_again),
        cmocka_unit_test(a_stream_begins_with_everything_and_goes_on_with_changes),
        cmocka_unit_test(a_stream_goes_on_where_it_was_left),
        cmocka_unit_test(whoever_dribbles_is_thrown_out),
        cmocka_unit_test(many_slow_strangers_keep_nobody_out),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
