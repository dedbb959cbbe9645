/* SPDX-License-Identifier: BSD-3-Clause */
#include <errno.h>
#include <limits.h>

#include "api.h"

int whole_number(const char *text)
{
    char *end;
    errno = 0;
    const long value = strtol(text, &end, 10);
    if (errno || end == text || *end || value < 0 || value > INT_MAX)
        fail_msg("\"%s\" is no whole number", text);
    return (int)value;
}

int environment_port(const char *name)
{
    const char *text = getenv(name);
    if (!text)
        fail_msg("%s is not set: this program is run by test_ui_api.sh", name);
    return whole_number(text);
}

static json_t *parse(const struct http_reply *reply)
{
    return json_loadb(reply->body ? reply->body : "", reply->n, 0, NULL);
}

static int ask(const struct client *c, const char *method, const char *path, const char *header,
               const char *body, json_t **json)
{
    struct http_reply reply;
    char lines[1024];
    snprintf(lines, sizeof lines, "%s%s%s%s%s%s%s", c->cookie[0] ? "Cookie: " : "", c->cookie,
             c->cookie[0] ? "\r\n" : "", c->csrf[0] ? "X-CSRF-Token: " : "", c->csrf,
             c->csrf[0] ? "\r\n" : "", header ? header : "");
    http_request(&reply, c->port, method, path, lines, body);
    int status = reply.status;
    if (json)
        *json = parse(&reply);
    http_free(&reply);
    return status;
}

struct client client_make(int port, const char *user, const char *password)
{
    struct client c = {.port = port};
    struct http_reply reply;
    char body[256], cookie[256];
    if (user) {
        snprintf(body, sizeof body, "{\"user\":\"%s\",\"password\":\"%s\"}", user, password);
        http_request(&reply, port, "POST", "/api/login", "Content-Type: application/json\r\n", body);
        assert_int_equal(reply.status, 200);
        http_header(&reply, "Set-Cookie", cookie, sizeof cookie);
        cookie[strcspn(cookie, ";")] = '\0';
        snprintf(c.cookie, sizeof c.cookie, "%s", cookie);
        http_free(&reply);
    }
    json_t *session;
    assert_int_equal(client_get(&c, "/api/session", &session), 200);
    snprintf(c.csrf, sizeof c.csrf, "%s", text_of(session, "csrf"));
    json_decref(session);
    return c;
}

int client_get(const struct client *c, const char *path, json_t **json)
{
    return ask(c, "GET", path, NULL, NULL, json);
}

int client_post(const struct client *c, const char *path, const char *body, json_t **json)
{
    return ask(c, "POST", path, "Content-Type: application/json\r\n", body, json);
}

void expect_error(const struct client *c, const char *method, const char *path, const char *header,
                  const char *body, int status, const char *code)
{
    json_t *json;
    int got = ask(c, method, path,
                  header ? header
                  : body ? "Content-Type: application/json\r\n"
                         : NULL,
                  body, &json);
    const json_t *error = json_object_get(json, "error");
    const char *said = text_of(error, "code"), *message = text_of(error, "message");
    if (got != status || !said || strcmp(said, code) != 0 || !message || !*message)
        fail_msg("%s %s %.60s: %d %s (%s), expected %d %s", method, path, body ? body : "", got,
                 said ? said : "-", message ? message : "-", status, code);
    json_decref(json);
}

static const json_t *sample_of(const json_t *state, const char *ref)
{
    const json_t *sample = json_object_get(json_object_get(state, "values"), ref);
    if (!sample)
        fail_msg("there is no %s in /api/state", ref);
    return sample;
}

int64_t seq_of(const struct client *c, const char *ref)
{
    json_t *state;
    assert_int_equal(client_get(c, "/api/state", &state), 200);
    int64_t seq = json_integer_value(json_array_get(sample_of(state, ref), 0));
    json_decref(state);
    return seq;
}

double value_of(const struct client *c, const char *ref)
{
    json_t *state;
    assert_int_equal(client_get(c, "/api/state", &state), 200);
    double value = json_number_value(json_array_get(sample_of(state, ref), 2));
    json_decref(state);
    return value;
}

struct http_stream *client_stream(const struct client *c, const char *last)
{
    char header[512];
    snprintf(header, sizeof header, "%s%s%s%s%s%s", c->cookie[0] ? "Cookie: " : "", c->cookie,
             c->cookie[0] ? "\r\n" : "", last ? "Last-Event-ID: " : "", last ? last : "", last ? "\r\n" : "");
    return http_stream_open(c->port, "/events", header);
}

json_t *next_event(struct http_stream *stream, const char *event, struct http_message *message)
{
    struct http_message own;
    if (!message)
        message = &own;
    while (http_stream_next(stream, message))
        if (!strcmp(message->event, event)) {
            json_t *data = json_loads(message->data, 0, NULL);
            assert_non_null(data);
            return data;
        }
    fail_msg("the stream ended before a message \"%s\"", event);
    return NULL;
}

json_t *await_write(struct http_stream *stream, const char *key, const char *state)
{
    for (int i = 0; i < 100; i++) {
        json_t *write = next_event(stream, "write", NULL);
        if (!strcmp(text_of(write, "key"), key) && !strcmp(text_of(write, "state"), state))
            return write;
        json_decref(write);
    }
    fail_msg("write %s was never %s", key, state);
    return NULL;
}
