/* SPDX-License-Identifier: BSD-3-Clause */
/* The one gate: deny by default. What a route asks for is in the table. */
#include <arpa/inet.h>
#include <string.h>
#include <strings.h>

#include "http.h"

/* HOST[:PORT] without its port. False: it is none. */
static bool host_part(const char *text, char host[256])
{
    const char *end = text[0] == '[' ? strchr(text, ']') : strchr(text, ':');
    size_t n = end ? (size_t)(end - text) : strlen(text);
    if (text[0] == '[') {
        if (!end)
            return false;
        text++;
        n--;
        end++;
    }
    if (n == 0 || n >= 256 ||
        (end && *end && (*end != ':' || strspn(end + 1, "0123456789") != strlen(end + 1))))
        return false;
    memcpy(host, text, n);
    host[n] = '\0';
    return true;
}

/*
 * A page that makes its own name point here (DNS rebinding) has to send that name: so names are refused but
 * those we know, and addresses are not names.
 */
bool host_allowed(const char *text, const char *const *names)
{
    char host[256];
    unsigned char address[16];
    if (!text || !host_part(text, host))
        return false;
    if (inet_pton(AF_INET, host, address) == 1 || inet_pton(AF_INET6, host, address) == 1 ||
        !strcasecmp(host, "localhost"))
        return true;
    for (; *names; names++)
        if (!strcasecmp(host, *names))
            return true;
    return false;
}

bool origin_matches(const char *origin, const char *host)
{
    const char *scheme = strstr(origin, "://");
    return scheme && host && !strcasecmp(scheme + 3, host);
}

void cookie_name(const struct ui *ui, char name[32])
{
    snprintf(name, 32, "apc-session-%d", ui->port); /* cookies do not tell ports apart */
}

static bool same_origin(const struct request *r)
{
    const char *origin = request_header(r, "Origin"), *site = request_header(r, "Sec-Fetch-Site");
    if (origin && !origin_matches(origin, request_header(r, "Host")))
        return false;
    return !site || !strcmp(site, "same-origin") || !strcmp(site, "none");
}

static bool find_session(struct ui *ui, struct request *r)
{
    char name[32];
    if (ui->open) {
        r->session = ui->sessions.local;
        return true;
    }
    cookie_name(ui, name);
    const char *token = MHD_lookup_connection_value(r->connection, MHD_COOKIE_KIND, name);
    return token && session_find(&ui->sessions, token, apc_clock_mono(NULL), &r->session);
}

static bool check_post(struct ui *ui, struct request *r)
{
    const char *csrf = request_header(r, "X-CSRF-Token"), *type = request_header(r, "Content-Type");
    const char *length = request_header(r, "Content-Length");
    bool form =
        r->route->role == ROLE_NONE && type && !strncasecmp(type, "application/x-www-form-urlencoded", 33);
    (void)ui;
    if (r->route->role != ROLE_NONE && !(csrf && token_equal(csrf, r->session.csrf)))
        return fault_set(&r->fault, 403, "csrf", NULL,
                         "the request lacks this session's token: reload the page and try again");
    if (!form && !(type && !strncasecmp(type, "application/json", 16) && strchr("; ", type[16]) != NULL))
        return fault_set(&r->fault, 415, "type", NULL, "the request must be application/json");
    if (length && (strlen(length) > 9 || strtol(length, NULL, 10) > BODY_MAX))
        return fault_set(&r->fault, 413, "size", NULL, "the request is larger than %d bytes", BODY_MAX);
    return true;
}

bool gate_pass(struct ui *ui, struct request *r, const char *method)
{
    const struct route *route = r->route;
    bool post = !strcmp(method, "POST");
    if (!host_allowed(request_header(r, "Host"), ui->options.names))
        return fault_set(&r->fault, 403, "host", NULL,
                         "this server is not known by that name: use its address, or start it with --name");
    if (post && !same_origin(r))
        return fault_set(&r->fault, 403, "origin", NULL,
                         "the request comes from another page and is refused");
    bool known = find_session(ui, r);
    if (!known && !(route && route->role == ROLE_NONE))
        return fault_set(&r->fault, 401, "login", NULL,
                         "please log in: there is no session, or it has ended");
    if (!route)
        return fault_set(&r->fault, 404, "path", NULL, "there is nothing here");
    if (strcmp(method, route->method) != 0 && !(!strcmp(method, "HEAD") && !strcmp(route->method, "GET")))
        return fault_set(&r->fault, 405, "method", NULL, "%s takes %s only", route->path, route->method);
    if (route->role == ROLE_OPERATOR && r->session.role != ROLE_OPERATOR)
        return fault_set(&r->fault, 403, "role", NULL, "%s is an observer: this takes an operator",
                         r->session.user);
    return !post || check_post(ui, r);
}
