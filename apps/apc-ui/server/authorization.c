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

/* HOST[:PORT] as the other; a scheme's own @p port, which no browser writes and many a proxy does, is none. */
static bool same_host(const char *one, const char *other, const char *port)
{
    const size_t n = strlen(one), m = strlen(other), both = n < m ? n : m;
    const char *rest = n < m ? other + both : one + both;
    return !strncasecmp(one, other, both) && (!*rest || !strcmp(rest, port));
}

/* Where TLS ends in front of us a page's origin is https all the same; a browser says of such an address, and
 * of no plain one, whether the page is from there. */
bool origin_matches(const char *origin, const char *host, bool tls, const char *site)
{
    const bool in_front = !tls && !strncasecmp(origin, "https://", 8) && site && !strcmp(site, "same-origin");
    const char *const scheme = tls || in_front ? "https://" : "http://";
    const size_t n = strlen(scheme);
    return host && !strncasecmp(origin, scheme, n) &&
           same_host(origin + n, host, tls || in_front ? ":443" : ":80");
}

/* Cookies do not tell ports apart. With the prefix no other host, and nothing without TLS, can set it. */
void cookie_name(const struct ui *ui, const char *what, char name[COOKIE_NAME])
{
    snprintf(name, COOKIE_NAME, "%sapc-%s-%d", ui->tls ? "__Host-" : "", what, ui->port);
}

/* What the request is for: a target in absolute form says so itself, and its Host says nothing then. */
static const char *request_host(const struct request *r)
{
    return r->authority[0] ? r->authority : request_header(r, "Host");
}

static bool same_origin(const struct ui *ui, const struct request *r)
{
    const char *origin = request_header(r, "Origin"), *site = request_header(r, "Sec-Fetch-Site");
    if (origin && !origin_matches(origin, request_host(r), ui->tls, site))
        return false;
    return !site || !strcmp(site, "same-origin") || !strcmp(site, "none");
}

/* A machine's token, as `Bearer NAME~SECRET` or as Basic's name and password. */
static bool find_machine(struct ui *ui, struct request *r, const char *authorization)
{
    char bearer[USER_NAME_LEN + SECRET_LEN] = "", *password = NULL, *basic = NULL;
    const char *name = bearer, *secret = NULL;
    struct user token = {0};
    if (!strncasecmp(authorization, "Bearer ", 7)) {
        snprintf(bearer, sizeof bearer, "%s", authorization + 7 + strspn(authorization + 7, " "));
        char *tilde = strchr(bearer, '~');
        if (tilde) {
            *tilde = '\0';
            secret = tilde + 1;
        }
    } else {
        name = basic = MHD_basic_auth_get_username_password(r->connection, &password);
        secret = password;
    }
    pthread_mutex_lock(&ui->users_mutex);
    const struct user *found = name && secret ? users_find(&ui->tokens, name) : NULL;
    if (found)
        token = *found;
    pthread_mutex_unlock(&ui->users_mutex);
    const bool known = token.role != ROLE_NONE && user_verify(&token, secret),
               ended = known && user_ended(&token, apc_clock_utc(apc_clock_system()));
    bool ok =
        known && !ended && session_machine(&ui->sessions, &token, apc_clock_mono(NULL), &r->session) == 0;
    MHD_free(basic);
    MHD_free(password);
    return ok || fault_set(&r->fault, 401, "token", NULL, "%s: `apc user token` makes one",
                           ended ? "this token has ended" : "there is no such token");
}

/* Without users the page is the user's who runs the server. */
static bool is_own_request(struct request *r)
{
    if (r->from->peer == 0)
        r->from->peer = peer_is_own(r->from->fd) ? 1 : -1;
    return r->from->peer > 0 || fault_set(&r->fault, 401, "login", NULL, NOT_YOURS);
}

static bool find_session(struct ui *ui, struct request *r)
{
    const char *authorization = request_header(r, "Authorization");
    char name[COOKIE_NAME];
    if (authorization)
        return find_machine(ui, r, authorization);
    if (ui->open) {
        if (!is_own_request(r))
            return false;
        r->session = ui->sessions.local;
        return true;
    }
    cookie_name(ui, "session", name);
    const char *token = MHD_lookup_connection_value(r->connection, MHD_COOKIE_KIND, name);
    return (token && session_find(&ui->sessions, token, apc_clock_mono(NULL), &r->session)) ||
           fault_set(&r->fault, 401, "login", NULL, "please log in: there is no session, or it has ended");
}

static bool check_post(struct request *r)
{
    const char *csrf = request_header(r, "X-CSRF-Token"), *type = request_header(r, "Content-Type");
    const char *length = request_header(r, "Content-Length");
    bool form =
        r->route->role == ROLE_NONE && type && !strncasecmp(type, "application/x-www-form-urlencoded", 33);
    /* no browser sends a machine's token by itself */
    if (r->route->role != ROLE_NONE && !r->session.machine && !(csrf && text_same(csrf, r->session.csrf)))
        return fault_set(&r->fault, 403, "csrf", NULL,
                         "the request lacks this session's token: reload the page and try again");
    if (!form && !(type && !strncasecmp(type, "application/json", 16) && strchr("; ", type[16]) != NULL))
        return fault_set(&r->fault, 415, "type", NULL, "the request must be application/json");
    if (length && (strlen(length) > 9 || strtol(length, NULL, 10) > BODY_MOST(r->route)))
        return fault_set(&r->fault, 413, "size", NULL, "the request is larger than %d bytes",
                         BODY_MOST(r->route));
    return true;
}

bool authorize_request(struct ui *ui, struct request *r, const char *method)
{
    const struct route *route = r->route;
    struct change_fault why;
    bool post = !strcmp(method, "POST");
    if (!host_allowed(request_host(r), ui->options.names))
        return fault_set(&r->fault, 403, "host", NULL,
                         "this server is not known by that name: use its address, or start it with --name");
    if (post && !same_origin(ui, r))
        return fault_set(&r->fault, 403, "origin", NULL,
                         "the request comes from another page and is refused");
    if (!find_session(ui, r)) {
        if (!route || route->role != ROLE_NONE)
            return false;
        r->fault = (struct fault){0}; /* anyone may ask */
    }
    if (!route)
        return fault_set(&r->fault, 404, "path", NULL,
                         "there is no such address here: docs/http-api.md lists them");
    if (strcmp(method, route->method) != 0 && !(!strcmp(method, "HEAD") && !strcmp(route->method, "GET")))
        return fault_set(&r->fault, 405, "method", NULL, "%s takes %s only", route->path, r->methods);
    if (r->session.role < route->role) {
        (void)change_role(r->session.user, role_name(r->session.role), role_name(route->role), &why);
        return fault_set(&r->fault, 403, why.code, NULL, "%s", why.text);
    }
    return !post || check_post(r);
}
