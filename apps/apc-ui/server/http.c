/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The server. libmicrohttpd's one thread takes all requests; one that takes a store is put to sleep and given
 * to a pool of threads, one of which wakes it with its answer. A stream sleeps while there is nothing for it.
 * Long looks into the past have a pool of their own, so that no write waits behind them, and what is computed
 * has one thread, so that no look does.
 *
 * Who may keep a connection, and for how long without a request, is said in connection_limits.h: libmicrohttpd's own
 * limits know neither who is logged in nor who dribbles.
 */
#include "http.h"

#include <errno.h>
#include <inttypes.h>
#include <netdb.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <unistd.h>

#define WRITERS     2
#define READERS     3
#define QUEUE       64                         /* requests waiting for a pool */
#define PATIENCE    (10 * APC_NS_PER_S)        /* for history */
#define CONNECTIONS (STRANGERS + MEMBERS + 64) /* the last: on their way out */
#define SILENCE     30                         /* s */

struct exchange {
    struct ui *ui;
    struct request r;
    struct exchange *next;
    bool begun, queued, answered, nul; /* nul: %00 in its address */
    struct stream_reader *reader;
};

struct pool {
    struct ui *ui;
    apc_ns patience;
    pthread_mutex_t mutex;
    pthread_cond_t filled;
    struct exchange *first, **last;
    size_t queued;
    bool ending;
    pthread_t thread[WRITERS > READERS ? WRITERS : READERS];
    size_t threads;
};

struct server {
    struct ui *ui;
    const struct site *site;
    struct MHD_Daemon *daemon;
    char *cert, *key;
    struct connection_limits connection_limits;

    struct pool writers, readers, computer;
};

/* ---- Faults ------------------------------------------------------------------------------- */

void fault_store(struct request *r, int rc, const struct apc_store *store)
{
    fault_set(&r->fault, 503, "store", NULL, "%s%.180s", rc == APC_EPERM ? "" : "the database is offline: ",
              rc == APC_ENOMEM ? apc_err_text(rc) : apc_store_error(store));
}

bool fault_history(struct request *r, struct apc_store *store)
{
    const int history = apc_store_is_history(store);
    if (history < 0)
        fault_store(r, history, store);
    if (history > 0)
        fault_set(&r->fault, 503, "store", NULL,
                  "the database is a history, which no loop reads: write to the live store");
    return history != 0;
}

/* ---- Answers ------------------------------------------------------------------------------ */

static void add_headers(const struct ui *ui, struct MHD_Response *response, const char *nonce, bool sandbox)
{
    char csp[384] = "sandbox; default-src 'none'; frame-ancestors 'none'";
    if (!sandbox)
        snprintf(csp, sizeof csp,
                 "default-src 'self'; object-src 'none'; base-uri 'none'; frame-ancestors 'none'; "
                 "form-action 'self'; "
                 "img-src 'self' data: blob:%s%s%s%s%s",
                 nonce ? "; style-src 'nonce-" : "", nonce ? nonce : "", nonce ? "'; script-src 'nonce-" : "",
                 nonce ? nonce : "", nonce ? "'" : "");
    MHD_add_response_header(response, "Content-Security-Policy", csp);
    MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
    MHD_add_response_header(response, "X-Frame-Options", "DENY");
    /* with "no-referrer" a browser sends "Origin: null" with the form of the login page */
    MHD_add_response_header(response, "Referrer-Policy", "same-origin");
    MHD_add_response_header(response, "Cross-Origin-Opener-Policy", "same-origin");
    MHD_add_response_header(response, "Cross-Origin-Resource-Policy", "same-origin");
    if (ui->tls)
        MHD_add_response_header(response, "Strict-Transport-Security", "max-age=31536000");
}

static enum MHD_Result queue(struct exchange *x, int status, struct MHD_Response *response)
{
    if (!response)
        return MHD_NO;
    connection_limits_busy(&x->ui->server->connection_limits, x->r.from);
    x->answered = true;
    x->ui->requests[status / 100 < 6 ? status / 100 : 0]++;
    enum MHD_Result ok = MHD_queue_response(x->r.connection, (unsigned)status, response);
    MHD_destroy_response(response);
    return ok;
}

static void fault_json(struct request *r)
{
    text_free(&r->reply);
    r->type = NULL;
    r->status = r->fault.http;
    const bool within = !strcmp(r->fault.code, "stale");
    json_add(&r->reply, "{error:{code:%s, message:%s", r->fault.code, r->fault.message);
    if (r->fault.field[0])
        json_add(&r->reply, "field:%s", r->fault.field);
    json_add(&r->reply, within ? "%.*s}" : "}%.*s", (int)r->extra.n, r->extra.at);
    json_add(&r->reply, "}");
}

/* A person without a session, who asked for a page: not JSON but the form, where he could log in. */
static bool wants_form(const struct request *r)
{
    const char *accept = request_header(r, "Accept");
    return r->fault.http == 401 && r->route && r->route->where == PAGE && accept &&
           strstr(accept, "text/html");
}

/* Whoever tried to write, and was refused, leaves a row. Logins leave their own. */
static void record_refusal(struct exchange *x)
{
    const struct request *r = &x->r;
    if (r->fault.http && strcmp(r->fault.code, "unknown") != 0 && r->route && r->route->role != ROLE_NONE &&
        !strcmp(r->route->method, "POST"))
        audit_refusal(x->ui, r->session.user, r->from->address, r->route->path, r->fault.message);
}

static enum MHD_Result answer_http(struct exchange *x)
{
    struct request *r = &x->r;
    char seconds[24];
    record_refusal(x);

    if (wants_form(r) && x->ui->open) {
        r->type = "text/plain; charset=utf-8";
        r->status = 401;
        text_add(&r->reply, "%s\n", r->fault.message);
    } else if (wants_form(r))
        login_page(r, "");
    else if (r->fault.http)
        fault_json(r);
    if (r->reply.failed) {
        text_free(&r->reply);
        r->status = 503;
    }
    zip_reply(r);
    struct MHD_Response *response =
        MHD_create_response_from_buffer(r->reply.n, r->reply.at, MHD_RESPMEM_MUST_FREE);
    if (!response)
        return MHD_NO;
    r->reply = (struct text){0};
    add_headers(x->ui, response, r->nonce[0] ? r->nonce : NULL, r->sandbox);
    MHD_add_response_header(response, "Cache-Control", "no-store");
    MHD_add_response_header(response, "Content-Type", r->type ? r->type : "application/json");
    MHD_add_response_header(response, "Vary", "Accept-Encoding");
    if (r->former)
        MHD_add_response_header(response, "Link", r->former->link);
    if (r->zipped)
        MHD_add_response_header(response, "Content-Encoding", "gzip");
    if (r->cookie[0])
        MHD_add_response_header(response, "Set-Cookie", r->cookie);
    if (r->device[0])
        MHD_add_response_header(response, "Set-Cookie", r->device);
    if (r->fault.http == 401)
        MHD_add_response_header(response, "WWW-Authenticate", "Bearer realm=\"apc-ui\"");
    if (r->location)
        MHD_add_response_header(response, "Location", r->location);
    if (r->close)
        MHD_add_response_header(response, "Connection", "close");
    if (r->status == 405)
        MHD_add_response_header(response, "Allow", r->methods);
    if (r->retry_after > 0) {
        snprintf(seconds, sizeof seconds, "%" PRId64, (r->retry_after + APC_NS_PER_S - 1) / APC_NS_PER_S);
        MHD_add_response_header(response, "Retry-After", seconds);
    }
    return queue(x, r->status ? r->status : 200, response);
}

static void free_nothing(void *data)
{
    (void)data;
}

static enum MHD_Result answer_file(struct exchange *x, const char *path)
{
    const struct file *file = files_find(x->ui->files, path);
    const char *known = request_header(&x->r, "If-None-Match");
    if (!file) {
        if (!strcmp(path, "/"))
            fault_set(&x->r.fault, 404, "path", NULL,
                      "the page was not built: install Node, and build again without -DAPC_PAGE=OFF "
                      "(scripts/setup "
                      "&& scripts/build); the API works");
        else
            fault_set(&x->r.fault, 404, "path", NULL,
                      "there is no such address here: docs/http-api.md lists them");
        return answer_http(x);
    }
    bool same = known && strstr(known, file->etag), zipped = file->zipped && request_takes_zip(&x->r);
    const char *data = zipped ? file->zipped : file->data;
    struct MHD_Response *response =
        MHD_create_response_from_buffer_with_free_callback(same     ? 0
                                                           : zipped ? file->n_zipped
                                                                    : file->n,
                                                           (void *)(uintptr_t)data, free_nothing);
    if (!response)
        return MHD_NO;
    add_headers(x->ui, response, NULL, false);
    MHD_add_response_header(response, "Content-Type", file->type);
    MHD_add_response_header(response, "ETag", file->etag);
    MHD_add_response_header(response, "Vary", "Accept-Encoding");
    MHD_add_response_header(response, "Cache-Control",
                            file->immutable ? "private, max-age=31536000, immutable" : "private, no-cache");
    if (zipped && !same)
        MHD_add_response_header(response, "Content-Encoding", "gzip");
    return queue(x, same ? 304 : 200, response);
}

/* ---- Streams ------------------------------------------------------------------------------ */

static void rest_stream(void *ctx)
{
    const struct exchange *x = ctx;
    MHD_suspend_connection(x->r.connection);
}

static void wake_stream(void *ctx)
{
    const struct exchange *x = ctx;
    MHD_resume_connection(x->r.connection);
}

static ssize_t read_stream(void *ctx, uint64_t pos, char *to, size_t size)
{
    const struct exchange *x = ctx;
    (void)pos;
    long n = stream_read(x->reader, to, size);
    return n == STREAM_END ? MHD_CONTENT_READER_END_OF_STREAM : n;
}

static void greet(struct exchange *x, bool resumed)
{
    struct text t = {0};
    json_add(&t, "{t:%.6jd, resumed:%i, beat:1}", apc_clock_utc(NULL), resumed);
    stream_greet(x->reader, "hello", t.at, t.n);
    text_free(&t);
    if (resumed)
        return;
    x->ui->server->site->greet(x->ui, &t);
    stream_greet(x->reader, "state", t.at, t.n);
    text_free(&t);
}

static enum MHD_Result answer_stream(struct exchange *x)
{
    struct ui *ui = x->ui;
    const char *last = request_header(&x->r, "Last-Event-ID");
    bool resumed;
    const struct session *session = &x->r.session;
    const struct stream_watcher watcher = {.session = session->token,
                                           .privileged = session->role >= ROLE_OPERATOR};
    int rc = stream_open(ui->stream, &watcher, last ? last : request_query(&x->r, "last"), rest_stream,
                         wake_stream, x, &x->reader, &resumed);
    if (rc < 0) {
        fault_set(&x->r.fault, 503, "busy", NULL,
                  rc == APC_EFULL ? "too many pages are watching in this session: try again later"
                                  : "too many pages are watching: try again later");
        x->r.retry_after = 10 * APC_NS_PER_S;
        return answer_http(x);
    }
    greet(x, resumed);
    struct MHD_Response *response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, (size_t)(32 * 1024),
                                                                      read_stream, x, free_nothing);
    if (!response)
        return MHD_NO;
    add_headers(ui, response, NULL, false);
    MHD_add_response_header(response, "Content-Type", "text/event-stream");
    MHD_add_response_header(response, "Cache-Control", "no-store");
    MHD_add_response_header(response, "X-Accel-Buffering", "no");
    return queue(x, 200, response);
}

static bool session_over(void *ctx, void *arg)
{
    const struct exchange *x = ctx;
    struct session session;
    (void)arg;
    const char *token = x->r.session.token;
    return token[0] ? !session_find(&x->ui->sessions, token, apc_clock_mono(NULL), &session) : !x->ui->open;
}

/* ---- Pools -------------------------------------------------------------------------------- */

/*
 * Connect if need be. A store that failed pauses before it tries again; when the database is back, as the
 * live thread knows, that pause is waited out and not made a failure of the request.
 */
static void connect_store(struct ui *ui, struct apc_store *store)
{
    const apc_ns give_up = apc_clock_mono(NULL) + APC_NS_PER_S;
    while (store && !apc_store_connected(store) && apc_store_connect(store) == APC_ECONN) {
        if (!ui->server->site->connected(ui) || apc_clock_mono(NULL) > give_up)
            break;
        ui_pause(ui, 25 * APC_NS_PER_MS);
    }
}

static void *work_on_requests(void *arg)
{
    struct pool *p = arg;
    struct apc_store *store = NULL;
    struct apc_error why;
    if (ui_open_store(p->ui, "apc-ui", p->patience, &store, &why) < 0)
        apc_log_write(p->ui->log, APC_LOG_ERROR, "%s", why.text);
    pthread_mutex_lock(&p->mutex);
    for (;;) {
        while (!p->first && !p->ending)
            pthread_cond_wait(&p->filled, &p->mutex);
        struct exchange *x = p->first;
        if (!x)
            break;
        p->first = x->next;
        if (!p->first)
            p->last = &p->first;
        p->queued--;
        pthread_mutex_unlock(&p->mutex);
        connect_store(p->ui, store);
        x->r.route->handle(p->ui, &x->r, store);
        if (p == &p->ui->server->writers)
            atomic_fetch_sub(&p->ui->writing, 1);
        if (!x->r.fault.http)
            zip_reply(&x->r);
        MHD_resume_connection(x->r.connection);
        pthread_mutex_lock(&p->mutex);
    }
    pthread_mutex_unlock(&p->mutex);
    apc_store_close(store);
    return NULL;
}

static int pool_start(struct pool *p, struct ui *ui, size_t threads, apc_ns patience)
{
    p->ui = ui;
    p->patience = patience;
    p->last = &p->first;
    if (pthread_mutex_init(&p->mutex, NULL) || pthread_cond_init(&p->filled, NULL))
        return APC_ESYS;
    while (p->threads < threads && pthread_create(&p->thread[p->threads], NULL, work_on_requests, p) == 0)
        p->threads++;
    return p->threads > 0 ? 0 : APC_ESYS;
}

/* What is waiting is still answered. */
static void pool_stop(struct pool *p)
{
    if (!p->ui)
        return;
    pthread_mutex_lock(&p->mutex);
    p->ending = true;
    pthread_cond_broadcast(&p->filled);
    pthread_mutex_unlock(&p->mutex);
    for (size_t i = 0; i < p->threads; i++)
        pthread_join(p->thread[i], NULL);
}

/* Once nobody can give it anything any more. */
static void pool_free(struct pool *p)
{
    if (!p->ui)
        return;
    pthread_cond_destroy(&p->filled);
    pthread_mutex_destroy(&p->mutex);
}

static enum MHD_Result give_to(struct pool *p, struct exchange *x)
{
    connection_limits_busy(&x->ui->server->connection_limits, x->r.from);
    pthread_mutex_lock(&p->mutex);
    bool room = p->queued < QUEUE && !p->ending;
    if (room) {
        MHD_suspend_connection(x->r.connection);
        x->queued = true;
        x->next = NULL;
        *p->last = x;
        p->last = &x->next;
        p->queued++;
        if (p == &p->ui->server->writers)
            atomic_fetch_add(&p->ui->writing, 1);
        pthread_cond_signal(&p->filled);
    }
    pthread_mutex_unlock(&p->mutex);
    if (room)
        return MHD_YES;
    fault_set(&x->r.fault, 503, "busy", NULL, "too many requests at once: try again");
    x->r.retry_after = APC_NS_PER_S;
    return answer_http(x);
}

/* ---- libmicrohttpd's calls ---------------------------------------------------------------- */

/* Is it the route's path, where that has {name} with something in its place? */
static bool path_fits(const char *pattern, const char *path, char name[APC_TAG_LEN])
{
    static const char hole[] = "{name}";
    const char *at = strstr(pattern, hole);
    if (!at)
        return !strcmp(path, pattern);
    const char *tail = at + sizeof hole - 1;
    const size_t head = (size_t)(at - pattern), rest = head + strlen(tail), n = strlen(path);
    if (n <= rest || n - rest >= APC_TAG_LEN || strncmp(path, pattern, head) != 0 ||
        strcmp(path + n - strlen(tail), tail) != 0)
        return false;
    snprintf(name, APC_TAG_LEN, "%.*s", (int)(n - rest), path + head);
    return true;
}

static const struct route *find_route(const struct ui *ui, const char *method, const char *path,
                                      char name[APC_TAG_LEN])
{
    const struct site *site = ui->server->site;
    const struct route *found = NULL;
    for (size_t i = 0; i < site->n; i++)
        if (path_fits(site->route[i].path, path, name) && (!found || !strcmp(method, site->route[i].method)))
            found = &site->route[i];
    bool reading = !strcmp(method, "GET") || !strcmp(method, "HEAD");
    /* a file of the page is there for every method, and is 405 for all but these */
    if (!found && strncmp(path, "/api/", 5) != 0 && (reading || files_find(ui->files, path)))
        found = &site->route[site->n - 1];
    return found;
}

/* Each method of a path has a route of its own. */
static const char *methods_of(const struct ui *ui, const struct route *route)
{
    const struct site *site = ui->server->site;
    for (size_t i = 0; i < site->n; i++)
        if (&site->route[i] != route && !strcmp(site->route[i].path, route->path))
            return "GET, POST";
    return route->method;
}

static enum MHD_Result known_parameter(void *ctx, enum MHD_ValueKind kind, const char *name,
                                       const char *value)
{
    struct request *r = ctx;
    const size_t n = strlen(name);
    (void)kind;
    const char *at = strchr(name, ' ') ? NULL : r->route->query; /* two names are not one */
    for (; at && n > 0 && (at = strstr(at, name)) != NULL; at += n)
        if ((at == r->route->query || at[-1] == ' ') && (at[n] == ' ' || at[n] == '\0')) {
            if (!value)
                fault_set(&r->fault, 400, "parameter", name, "\"%.30s\" has no value", name);
            else if (value != request_query(r, name)) /* that is the first one's */
                fault_set(&r->fault, 400, "parameter", name, "\"%.30s\" is given twice", name);
            return r->fault.http ? MHD_NO : MHD_YES;
        }
    fault_set(&r->fault, 400, "parameter", name, "\"%.30s\" is not known here", name);
    return MHD_NO;
}

struct heads {
    unsigned host, length, coding;
};

static enum MHD_Result count_head(void *ctx, enum MHD_ValueKind kind, const char *name, const char *value)
{
    struct heads *heads = ctx;
    (void)kind;
    (void)value;
    heads->host += !strcasecmp(name, "Host");
    heads->length += !strcasecmp(name, "Content-Length");
    heads->coding += !strcasecmp(name, "Transfer-Encoding");
    return MHD_YES;
}

/* One host, and one way to tell where the body ends: else two servers in a row may see two requests in one. */
static bool framed(struct request *r)
{
    struct heads heads = {0};
    MHD_get_connection_values(r->connection, MHD_HEADER_KIND, count_head, &heads);
    if (heads.host <= 1 && heads.length + heads.coding <= 1)
        return true;
    r->close = true;
    return fault_set(&r->fault, 400, "framing", NULL,
                     heads.host > 1 ? "the request has more than one Host"
                                    : "the request says twice where its body ends");
}

/* Headers are there: refuse now, or go on to the body. */
static enum MHD_Result begin_http(struct exchange *x, const char *method, const char *path)
{
    struct request *r = &x->r;
    x->begun = true;
    connection_limits_asked(&x->ui->server->connection_limits, x->r.from);
    for (size_t i = 0; i < x->ui->server->site->n_former; i++)
        if (!strcmp(x->ui->server->site->former[i].former, path))
            r->former = &x->ui->server->site->former[i];
    r->route = find_route(x->ui, method, r->former ? r->former->present : path, r->name);
    r->methods = r->route ? methods_of(x->ui, r->route) : NULL;
    if (!framed(r) || !authorize_request(x->ui, r, method)) {
        fault_set(&r->fault, 403, "role", NULL, "the request is refused"); /* unless it says why */
        return answer_http(x);
    }
    if (r->route->role != ROLE_NONE)
        connection_limits_member(&x->ui->server->connection_limits, x->r.from, r->session.token);
    if (x->nul) /* text would end there: what was asked for is not what would be answered */
        fault_set(&r->fault, 400, "parameter", NULL, "the address has a zero byte in it");
    else if (r->route->query)
        MHD_get_connection_values(r->connection, MHD_GET_ARGUMENT_KIND, known_parameter, r);
    return r->fault.http ? answer_http(x) : MHD_YES;
}

static enum MHD_Result take_body(struct exchange *x, const char *data, size_t *n)
{
    struct request *r = &x->r;
    if (r->n + *n > BODY_MOST(r->route)) {
        r->too_large = true;
    } else {
        char *body = realloc(r->body, r->n + *n + 1);
        if (!body)
            return MHD_NO;
        r->body = body;
        memcpy(body + r->n, data, *n);
        r->n += *n;
        body[r->n] = '\0';
    }
    *n = 0;
    return MHD_YES;
}

static enum MHD_Result finish_http(struct exchange *x, const char *path)
{
    struct request *r = &x->r;
    if (r->too_large) {
        fault_set(&r->fault, 413, "size", NULL, "the request is larger than %d bytes", BODY_MOST(r->route));
        return answer_http(x);
    }
    switch (r->route->where) {
    case NOW:
        if (request_query(r, "at"))
            return give_to(&x->ui->server->readers, x);
        r->route->handle(x->ui, r, NULL);
        return answer_http(x);
    case DIRECT:
        r->route->handle(x->ui, r, NULL);
        return answer_http(x);
    case WRITER:
        return give_to(&x->ui->server->writers, x);
    case PAST:
        return give_to(&x->ui->server->readers, x);
    case COMPUTED:
        return give_to(&x->ui->server->computer, x);
    case STREAM:
        return answer_stream(x);
    case PAGE:
    default:
        return answer_file(x, path);
    }
}

static enum MHD_Result on_http_request(void *cls, struct MHD_Connection *connection, const char *path,
                                       const char *method, const char *version, const char *data, size_t *n,
                                       void **ctx)
{
    struct ui *ui = cls;
    struct exchange *x = *ctx;
    path = target_path(path);
    (void)version;
    if (!x)
        return MHD_NO;
    x->r.connection = connection;
    if (!x->begun) {
        const union MHD_ConnectionInfo *info =
            MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
        x->ui = ui;
        x->r.from = info->socket_context;
        if (!x->r.from)
            return MHD_NO;
        return begin_http(x, method, path);
    }
    if (x->answered)
        return MHD_YES;
    if (x->queued)
        return answer_http(x);
    return *n > 0 ? take_body(x, data, n) : finish_http(x, path);
}

/* The first call of a request; what it returns is *ctx of the others. */
static void *on_uri(void *cls, const char *uri, struct MHD_Connection *connection)
{
    struct exchange *x = calloc(1, sizeof *x);
    (void)cls;
    (void)connection;
    if (x) {
        x->nul = strstr(uri, "%00") != NULL;
        target_authority(uri, x->r.authority, sizeof x->r.authority);
    }
    return x;
}

static void on_completed(void *cls, struct MHD_Connection *connection, void **ctx,
                         enum MHD_RequestTerminationCode code)
{
    struct ui *ui = cls;
    struct exchange *x = *ctx;
    (void)connection;
    (void)code;
    if (!x)
        return;
    stream_close(x->reader);
    if (x->r.from)
        connection_limits_answered(&ui->server->connection_limits, x->r.from, apc_clock_mono(NULL));
    free(x->r.body);
    text_free(&x->r.reply);
    text_free(&x->r.extra);
    free(x);
    *ctx = NULL;
}

static void on_connection(void *cls, struct MHD_Connection *connection, void **ctx,
                          enum MHD_ConnectionNotificationCode code)
{
    struct server *s = ((struct ui *)cls)->server;
    struct connection *c = *ctx;
    if (code == MHD_CONNECTION_NOTIFY_CLOSED && !c)
        return;
    if (code == MHD_CONNECTION_NOTIFY_CLOSED) { /* its socket is still open, so its number is still its own */
        connection_limits_leave(&s->connection_limits, c);
        return;
    }
    /* copied: from libmicrohttpd 1.0 on what the next question has for an answer takes its place */
    const int fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    const union MHD_ConnectionInfo *client =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
    char address[64] = "";
    socklen_t size =
        client->client_addr->sa_family == AF_INET6 ? sizeof(struct sockaddr_in6) : sizeof(struct sockaddr_in);
    getnameinfo(client->client_addr, size, address, sizeof address, NULL, 0, NI_NUMERICHOST);
    /* if it is NULL it cannot be refused here: its first request is */
    *ctx = connection_limits_enter(&s->connection_limits, fd, address, apc_clock_mono(NULL));
}

/* ---- Start and stop ----------------------------------------------------------------------- */

static int read_pem(const char *path, char **text, struct apc_error *why)
{
    const size_t most = 1 << 20;
    errno = 0;
    FILE *file = fopen(path, "re");
    *text = file ? calloc(1, most + 1) : NULL;
    size_t n = *text ? fread(*text, 1, most, file) : 0;
    bool ok = file && *text && n > 0 && !ferror(file);
    if (file)
        fclose(file);
    return ok ? 0
              : apc_fail(why, APC_ESYS, "%s: cannot be read: %s", path,
                         errno ? strerror(errno) : "it is empty");
}

APC_PRINTF(2, 0) static void log_library(void *arg, const char *fmt, va_list args)
{
    char text[400];
    vsnprintf(text, sizeof text, fmt, args);
    text[strcspn(text, "\n")] = '\0';
    apc_log_write(arg, APC_LOG_DEBUG, "libmicrohttpd: %s", text);
}

/* Forward secrecy and authenticated ciphers only, also in TLS 1.2. */
#define TLS_PRIORITIES                                                                                       \
    "NORMAL:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2:-KX-ALL:+ECDHE-ECDSA:+ECDHE-RSA:-CIPHER-ALL:+AES-256-GCM:"   \
    "+CHACHA20-POLY1305:+AES-128-GCM:-MAC-ALL:+AEAD"

static int start_daemon(struct server *s, int fd, struct apc_error *why)
{
    const struct ui *ui = s->ui;
    struct MHD_OptionItem tls[] = {{MHD_OPTION_HTTPS_MEM_CERT, 0, s->cert},
                                   {MHD_OPTION_HTTPS_MEM_KEY, 0, s->key},
                                   {MHD_OPTION_HTTPS_PRIORITIES, 0, (void *)(uintptr_t)TLS_PRIORITIES},
                                   {MHD_OPTION_END, 0, NULL}};
    unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG;
    if (ui->tls)
        flags |= MHD_USE_TLS;
    else
        tls[0].option = MHD_OPTION_END;
    s->daemon = MHD_start_daemon(flags, 0, NULL, NULL, on_http_request, s->ui,             //
                                 MHD_OPTION_EXTERNAL_LOGGER, log_library, (void *)ui->log, //
                                 MHD_OPTION_LISTEN_SOCKET, fd,                             //
                                 MHD_OPTION_URI_LOG_CALLBACK, on_uri, s->ui,               //
                                 MHD_OPTION_NOTIFY_COMPLETED, on_completed, s->ui,         //
                                 MHD_OPTION_NOTIFY_CONNECTION, on_connection, s->ui,       //
                                 MHD_OPTION_CONNECTION_LIMIT, (unsigned)CONNECTIONS,       //
                                 MHD_OPTION_STRICT_FOR_CLIENT, 1,                          //
                                 MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)SILENCE,         //
                                 MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)(48 * 1024),  //
                                 MHD_OPTION_ARRAY, tls, MHD_OPTION_END);
    if (s->daemon)
        return 0;
    /* it has closed fd, whose number may be another's by now */
    return apc_fail(why, APC_ESYS, "the server cannot be started%s",
                    ui->tls ? ": certificate and key must be PEM and belong together" : "");
}

int server_start(struct ui *ui, const struct site *site, struct apc_error *why)
{
    struct server *s = ui->server = calloc(1, sizeof *s);
    if (!s)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    s->ui = ui;
    s->site = site;
    ui->tls = ui->options.tls_cert != NULL;
    if (connection_limits_init(&s->connection_limits) < 0)
        return apc_fail(why, APC_ESYS, "no mutex");
    int rc = 0;
    if (ui->tls && ((rc = read_pem(ui->options.tls_cert, &s->cert, why)) < 0 ||
                    (rc = read_pem(ui->options.tls_key, &s->key, why)) < 0))
        return rc;
    int fd = listen_on_addresses(ui, why);
    if (fd < 0)
        return fd;
    if (pool_start(&s->writers, ui, WRITERS, 0) < 0 || pool_start(&s->readers, ui, READERS, PATIENCE) < 0 ||
        pool_start(&s->computer, ui, 1, PATIENCE) < 0) {
        close(fd);
        return apc_fail(why, APC_ESYS, "no thread can be made");
    }
    return start_daemon(s, fd, why);
}

void server_look(struct ui *ui)
{
    stream_drop(ui->stream, session_over, NULL, "session", "the session has ended: please log in");
    connection_limits_look(&ui->server->connection_limits, apc_clock_mono(NULL));
}

/* And let the streams read it. */
static void end_streams(struct ui *ui, const char *reason, const char *message)
{
    struct stream_stats stats = {.readers = 1};
    stream_end(ui->stream, reason, message);
    for (int i = 0; i < 250 && ui->server->daemon && stats.readers > 0; i++) {
        if (i > 0)
            poll(NULL, 0, 2);
        stream_stats(ui->stream, &stats);
    }
}

int server_hand_over(struct ui *ui)
{
    end_streams(ui, "restart", "the simulated plant went back in time");
    return MHD_quiesce_daemon(ui->server->daemon);
}

void server_stop(struct ui *ui)
{
    struct server *s = ui->server;
    if (!s)
        return;
    pool_stop(&s->writers);
    pool_stop(&s->readers);
    pool_stop(&s->computer);
    end_streams(ui, "shutdown", "the server is being stopped");
    if (s->daemon)
        MHD_stop_daemon(s->daemon); /* no connection sleeps now: it would not have that */
    pool_free(&s->writers);
    pool_free(&s->readers);
    pool_free(&s->computer);
    connection_limits_free(&s->connection_limits);
    free(s->cert);
    free(s->key);
    free(s);
    ui->server = NULL;
}
