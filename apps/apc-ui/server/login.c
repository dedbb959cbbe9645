/* SPDX-License-Identifier: BSD-3-Clause */
/* Logging in and out. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "http.h"

static void session_json(const struct ui *ui, const struct session *s, struct text *t)
{
    const apc_ns now = apc_clock_mono(NULL);
    const bool idles = !ui->open && s->role > ROLE_OBSERVER && ui->options.idle > 0;
    json_add(t, "{user:%s, role:%s, protected:%i, csrf:%s, expires:%.6jd, idle:%.6g}", s->user,
             role_name(s->role), !ui->open, s->csrf,
             ui->open ? JSON_NONE : apc_clock_utc(NULL) + session_end(&ui->sessions, s, now) - now,
             idles ? ui->options.idle : (double)NAN);
}

void get_session(struct ui *ui, struct request *r, struct apc_store *store)
{
    (void)store;
    session_json(ui, &r->session, &r->reply);
}

static void tell_login(struct ui *ui, struct apc_store *store, enum apc_event_severity severity,
                       const char *source, const char *text, const char *address)
{
    struct apc_event event = {.time = apc_clock_utc(NULL), .severity = severity, .kind = "access"};
    snprintf(event.source, sizeof event.source, "%s", source);
    snprintf(event.text, sizeof event.text, "%s from %s", text, address);
    apc_log_write(ui->log, severity == APC_EVENT_INFO ? APC_LOG_INFO : APC_LOG_WARN, "%s: %s", event.source,
                  event.text);
    audit(ui, store, &event);
}

/* ---- The form ----------------------------------------------------------------------------- */

/* A browser takes what is behind # of the address along to where an answer leads: to what was asked for. */
#define KEEP_PLACE "document.forms[0].onsubmit=e=>{e.target.action=\"/api/login\"+location.hash}"

void login_page(struct request *r, const char *message)
{
    text_free(&r->reply);
    r->type = "text/html; charset=utf-8";
    r->status = r->fault.http ? r->fault.http : 401;
    if (token_make(r->nonce) < 0)
        r->nonce[0] = '\0';
    text_add(
        &r->reply,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>libapc: log in</title>\n"
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
        "<style nonce=\"%s\">\n"
        ":root{color-scheme:light dark}\n"
        "body{font:16px system-ui,sans-serif;background:#DCDCDC;color:#1F1F1F;display:grid;"
        "place-items:center;min-height:95vh;margin:0}\n"
        "form{background:#E8E8E8;border:1px solid #6E6E6E;padding:24px;width:min(300px,85vw)}\n"
        "label{display:block;margin:12px 0 4px;color:#4A4A4A}\n"
        "input,button{font:inherit;width:100%%;min-height:44px;box-sizing:border-box;padding:4px 8px;"
        "border:1px solid #6E6E6E;background:#fff;color:#1F1F1F}\n"
        "button{margin-top:20px;background:#0B57D0;color:#fff}\n"
        ":focus-visible{outline:3px solid #0B57D0;outline-offset:2px}\n"
        "h1{font-size:20px;margin:0}p{margin:12px 0 0;font-weight:bold}\n"
        "@media(prefers-color-scheme:dark){body{background:#2B2B2B;color:#E6E6E6}form{background:#363636;"
        "border-color:#8F8F8F}label{color:#B8B8B8}input{background:#2B2B2B;color:#E6E6E6;"
        "border-color:#8F8F8F}button{background:#8AB4F8;color:#1F1F1F}"
        ":focus-visible{outline-color:#8AB4F8}}\n"
        "</style></head>\n<body><main><form method=\"post\" action=\"/api/login\"><h1>libapc</h1>\n"
        "%s%s%s<label for=\"user\">Name</label><input id=\"user\" name=\"user\" "
        "autocomplete=\"username\" autocapitalize=\"none\" required autofocus>\n"
        "<label for=\"password\">Password</label><input id=\"password\" name=\"password\" type=\"password\" "
        "autocomplete=\"current-password\" required>\n<button>Log in</button></form></main>"
        "<script nonce=\"%s\">" KEEP_PLACE "</script></body></html>\n",
        r->nonce, *message ? "<p role=\"alert\">" : "", message, *message ? "</p>\n" : "", r->nonce);
}

/* The value of a field of a form, decoded in place; NULL: it is not there. */
static const char *form_field(char *body, const char *name)
{
    size_t n = strlen(name);
    for (char *at = body; at; at = strchr(at, '&') ? strchr(at, '&') + 1 : NULL) {
        if (strncmp(at, name, n) != 0 || at[n] != '=')
            continue;
        char *from = at + n + 1, *to = from, *value = from;
        for (; *from && *from != '&'; from++) {
            char hex[3] = {from[0] == '%' ? from[1] : '\0', from[0] == '%' && from[1] ? from[2] : '\0', '\0'};
            bool coded = strlen(hex) == 2 && strspn(hex, "0123456789abcdefABCDEF") == 2;
            *to++ = coded ? (char)strtol(hex, NULL, 16) : *from == '+' ? ' ' : *from;
            from += coded ? 2 : 0;
        }
        *to = '\0';
        return value;
    }
    return NULL;
}

/* ---- Logging in --------------------------------------------------------------------------- */

struct credentials {
    char user[USER_NAME_LEN], password[PASSWORD_MAX + 1];
};

static bool take_credentials(struct request *r, const char *user, const char *password, struct credentials *c)
{
    if (!user || !password)
        return fault_set(&r->fault, 400, "json", user ? "password" : "user", "name and password are needed");
    /* What is longer is nobody's; it is cut so that it stays nobody's. */
    snprintf(c->user, sizeof c->user, "%s", strlen(user) < sizeof c->user ? user : "?");
    snprintf(c->password, sizeof c->password, "%s", strlen(password) < sizeof c->password ? password : "");
    return true;
}

static bool read_form(struct request *r, struct credentials *c)
{
    char *copy = strdup(r->body ? r->body : "");
    char *again = strdup(r->body ? r->body : "");
    bool ok =
        copy && again && take_credentials(r, form_field(copy, "user"), form_field(again, "password"), c);
    free(copy);
    free(again);
    return ok;
}

static bool read_json(struct request *r, struct credentials *c)
{
    static const char *const members[] = {"user", "password", NULL};
    const char *user = NULL, *password = NULL;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    bool ok = body && member_text(body, "user", &user, &r->fault) &&
              member_text(body, "password", &password, &r->fault) && take_credentials(r, user, password, c);
    json_decref(body);
    return ok;
}

/* One password at a time is checked: a flood of them takes one worker and 19 MiB, no more. */
static bool verify(struct ui *ui, const struct credentials *c, struct user *found)
{
    static pthread_mutex_t one = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&ui->users_mutex);
    const struct user *user = users_find(&ui->users, c->user);
    bool known = user && !user_ended(user, apc_clock_utc(apc_clock_system()));
    if (known)
        *found = *user;
    pthread_mutex_unlock(&ui->users_mutex);
    pthread_mutex_lock(&one);
    bool ok = user_verify(known ? found : NULL, c->password);
    pthread_mutex_unlock(&one);
    return ok;
}

/*
 * By what failures are counted. Who guesses for one name at one address is slowed down soon; who guesses from
 * many addresses, or for many names, later. None of that touches a browser with which this user has logged in
 * before, and which counts for itself: so nobody locks another out by guessing for his name.
 */
struct counts {
    struct {
        char key[BACKOFF_KEY];
        unsigned allowed;
    } of[3];
    size_t n;
};

static void count_by(struct counts *c, unsigned allowed, const char *kind, const char *first,
                     const char *second)
{
    c->of[c->n].allowed = allowed;
    snprintf(c->of[c->n++].key, BACKOFF_KEY, "%s %.32s %.64s", kind, first, second);
}

static void choose_counts(const struct request *r, const char *name, const char *device, struct counts *c)
{
    c->n = 0;
    if (device) {
        count_by(c, 3, "device", name, device);
        return;
    }
    count_by(c, 3, "pair", name, r->from->address);
    count_by(c, 30, "name", name, "");
    count_by(c, 100, "address", "", r->from->address);
}

/* The device that the browser shows, if it is one of this user; NULL: none. */
static const char *known_device(struct ui *ui, const struct request *r, const char *name)
{
    char cookie[COOKIE_NAME];
    cookie_name(ui, "device", cookie);
    const char *device = MHD_lookup_connection_value(r->connection, MHD_COOKIE_KIND, cookie);
    pthread_mutex_lock(&ui->users_mutex);
    const struct user *user = users_find(&ui->users, name);
    bool known = device && user && user_device_ok(user, device);
    pthread_mutex_unlock(&ui->users_mutex);
    return known ? device : NULL;
}

static void set_cookie(const struct ui *ui, char cookie[COOKIE_LEN], const char *what, const char *value,
                       const char *more)
{
    char name[COOKIE_NAME];
    cookie_name(ui, what, name);
    snprintf(cookie, COOKIE_LEN, "%s=%s; Path=/; HttpOnly; SameSite=Strict%s%s", name, value,
             ui->tls ? "; Secure" : "", more);
}

static bool log_in(struct ui *ui, struct request *r, struct apc_store *store, const struct credentials *c)
{
    apc_ns now = apc_clock_mono(NULL);
    struct counts counts;
    struct user user;
    char device[DEVICE_LEN];
    choose_counts(r, c->user, known_device(ui, r, c->user), &counts);
    for (size_t i = 0; i < counts.n; i++) {
        apc_ns wait = backoff_wait(&ui->backoff, counts.of[i].key, now);
        r->retry_after = wait > r->retry_after ? wait : r->retry_after;
    }
    if (r->retry_after > 0)
        return fault_set(&r->fault, 429, "backoff", NULL, "too many failed logins: wait %.0f s",
                         apc_ns_to_s(r->retry_after) + 0.5);
    if (!verify(ui, c, &user)) {
        for (size_t i = 0; i < counts.n; i++)
            backoff_failed(&ui->backoff, counts.of[i].key, counts.of[i].allowed, now);
        tell_login(ui, store, APC_EVENT_WARNING, c->user, "login failed", r->from->address);
        return fault_set(&r->fault, 401, "credentials", NULL, "name or password is wrong");
    }
    for (size_t i = 0; i < counts.n; i++)
        backoff_succeeded(&ui->backoff, counts.of[i].key);
    if (session_open(&ui->sessions, &user, now, &r->session) < 0 || user_device_make(&user, device) < 0)
        return fault_set(&r->fault, 503, "busy", NULL, "no session can be made");
    set_cookie(ui, r->cookie, "session", r->session.token, "");
    set_cookie(ui, r->device, "device", device, "; Max-Age=31536000");
    tell_login(ui, store, APC_EVENT_INFO, c->user, "logged in", r->from->address);
    return true;
}

void post_login(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct credentials c;
    const char *type = request_header(r, "Content-Type");
    bool form = type && !strncasecmp(type, "application/x-www-form-urlencoded", 33);
    bool ok = form ? read_form(r, &c) : read_json(r, &c);
    if (ok && ui->open && !r->session.user[0])
        ok = fault_set(&r->fault, 401, "login", NULL, NOT_YOURS);
    else if (ok && !ui->open)
        ok = log_in(ui, r, store, &c);
    explicit_bzero(&c, sizeof c);
    explicit_bzero(r->body ? r->body : (char[1]){0}, r->n);
    if (!form && ok) {
        session_json(ui, &r->session, &r->reply);
    } else if (ok) {
        r->status = 303;
        r->location = "/";
    } else if (form) {
        login_page(r, r->fault.message);
        r->fault.http = 0;
    }
}

void post_logout(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {NULL};
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    if (!body)
        return;
    json_decref(body);
    session_close(&ui->sessions, r->session.token);
    if (!ui->open) {
        set_cookie(ui, r->cookie, "session", "", "; Max-Age=0");
        tell_login(ui, store, APC_EVENT_INFO, r->session.user, "logged out", r->from->address);
    }
    json_add(&r->reply, "{}");
}
