/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Requests and their answers, on libmicrohttpd. Every request goes through one gate (host, session, role,
 * CSRF, type, size), by what its route in the table says; a path that is in no route answers strangers as all
 * others do.
 */
#ifndef APC_UI_HTTP_H
#define APC_UI_HTTP_H

#include <microhttpd.h>

#include "apc-ui/ui.h"
#include "common/body.h"
#include "connection_limits.h"

#define BODY_MAX         65536                                                       /* bytes */
#define BODY_MOST(route) ((route)->role == ROLE_ENGINEER ? 32 * BODY_MAX : BODY_MAX) /* it may be a drawing */
#define COOKIE_NAME      40
#define COOKIE_LEN       256
/* On a server without users, to everybody but the one who started it. */
#define NOT_YOURS                                                                                            \
    "this page is for the user who started it, on this host; for others make users with `apc user add`, or " \
    "a token with "                                                                                          \
    "`apc user token`"

enum where {
    DIRECT = 1, /* in the server's thread: never waits */
    NOW,        /* the same; as PAST with the parameter "at" */
    WRITER,     /* in a writer's, with a store */
    PAST,       /* in a reader's, with a store that may take its time */
    COMPUTED,   /* the same in the one thread that computes long: neither writes nor readers wait for it */
    STREAM,
    PAGE
};

struct request;

struct route {
    const char *method, *path;
    enum role role; /* ROLE_NONE: anyone */
    enum where where;
    void (*handle)(struct ui *ui, struct request *r, struct apc_store *store);
    const char *query; /* names of parameters, with a space between */
    const char *doc;
};

/* A path of the version before, taken for one version more. */
struct former_path {
    const char *former, *present, *link; /* link: the header that leads from the one to the other */
};

/* What is served. The server itself knows nothing of a plant. */
struct site {
    const struct route *route; /* [n]; the last one is the page, whatever its path */
    size_t n;
    const struct former_path *former; /* [n_former] */
    size_t n_former;
    void (*greet)(struct ui *ui, struct text *t); /* what a new reader of the stream is told first */
    bool (*connected)(struct ui *ui);             /* the store, as far as somebody who looks at it knows */
};

struct request {
    const struct route *route;
    const char *methods; /* of its path: "GET", "POST" or "GET, POST" */
    struct MHD_Connection *connection;
    struct connection *from;
    struct session session;
    char *body;
    size_t n;
    bool too_large;
    char authority[264];              /* of a target in absolute form, instead of Host; else "" */
    char name[APC_TAG_LEN];           /* what stands in the path for {name} */
    const struct former_path *former; /* by which it was asked for; NULL: by its present path */

    /* The answer. */
    int status; /* 0: 200 */
    struct fault fault;
    struct text extra; /* members beside "error", beginning with a comma */
    struct text reply;
    bool zipped;                                 /* the reply is */
    const char *type;                            /* default application/json */
    char cookie[COOKIE_LEN], device[COOKIE_LEN]; /* Set-Cookie, or "" */
    const char *location;
    char nonce[TOKEN_LEN]; /* of style and script in an HTML answer, or "" */
    bool sandbox;          /* what a browser that is led to it must not run, nor load anything for */
    apc_ns retry_after;
    bool close; /* the connection, after the answer */
};

/* A target in absolute form, "http://HOST/PATH", is taken as well: its host, "" of any other; and its path. */
void target_authority(const char *target, char *host, size_t n);
const char *target_path(const char *target);
/* A parameter, or NULL. */
const char *request_query(const struct request *r, const char *name);
const char *request_header(const struct request *r, const char *name);
bool request_takes_zip(const struct request *r);
/* Where its client takes that, and it is worth it. */
void zip_reply(struct request *r);
/* Number parameters; false: fault set. An absent one leaves *value alone. */
bool query_whole(struct request *r, const char *name, int64_t low, int64_t high, int64_t *value);
/* Unix seconds, RFC 3339, or negative seconds before now. */
bool query_time(struct request *r, const char *name, apc_ns now, apc_ns *value);
bool time_parse(const char *text, apc_ns now, apc_ns *value);
/* since and until, by default @p back before now, and now; at most @p most, 0: any. False: fault set. */
bool query_range(struct request *r, apc_ns back, apc_ns most, apc_ns *since, apc_ns *until);
void range_json(struct text *t, apc_ns since, apc_ns until); /* three members: now, and these */
/* The key of a write: the body's, or a new one; false: fault set. */
bool request_key(struct request *r, const json_t *body, char key[KEY_LEN]);
#define REASON_LEN (CHANGE_REASON + 1)
/* Why somebody wants it, "" where he does not say. */
bool request_reason(struct request *r, const json_t *body, char reason[REASON_LEN]);
/* Is it to be carried out? False: a fault is set, or the reply is what became of it when it was asked for
 * before. */
bool request_begin(struct ui *ui, struct request *r, const struct write *write, struct apc_store *store);
/* Has its user written too much lately? False: a fault is set. */
bool request_may_write(struct ui *ui, struct request *r);
/* What operate says is wrong, with the status of its code. Returns false. */
bool fault_change(struct request *r, const struct change_fault *why, const char *field);
/* The store's answer as a fault: nothing was written. */
void fault_store(struct request *r, int rc, const struct apc_store *store);
/* Nobody reads what is written into a history: then, or when it does not answer, a fault is set. */
bool fault_history(struct request *r, struct apc_store *store);

/* Returns 0 or an error in why; ui->server and ui->port are set. */
int server_start(struct ui *ui, const struct site *site, struct apc_error *why);
/* Close what has not sent its request in time; each second. */
void server_look(struct ui *ui);
/* Before the process begins anew: the streams end, no connection is accepted any more. Returns the listening socket, or
 * -1. */
int server_hand_over(struct ui *ui);
void server_stop(struct ui *ui);

/* listen.c: a socket that listens where the options say; ui->port is set. Returns it, or an error in why: a
 * place that others can reach is refused without users, and without TLS unless it was asked for. */
int listen_on_addresses(struct ui *ui, struct apc_error *why);

/* authorization.c: may this request go on? False: the fault is set. Body not looked at. */
bool authorize_request(struct ui *ui, struct request *r, const char *method);
bool host_allowed(const char *host, const char *const *names);
/* Is it this server's? TLS may also end in front of it: then it does not know of it. */
bool origin_matches(const char *origin, const char *host, bool tls, const char *site);
void cookie_name(const struct ui *ui, const char *what, char name[COOKIE_NAME]);

/* files.c: the page. */
int files_load(struct files **files, const char *folder, struct apc_error *why);
void files_free(struct files *files);
size_t files_count(const struct files *files);
struct file {
    const char *path, *type, *etag; /* path begins with / */
    bool immutable;
    const char *data, *zipped; /* zipped: NULL where it would be no smaller */
    size_t n, n_zipped;
};
/* gzip, at a level from 1 (fast) to 9, in memory that is the caller's; NULL where it would be no smaller. */
char *zip(const char *data, size_t n, int level, size_t *n_zipped);
/* "/" is "/index.html". NULL: there is none. */
const struct file *files_find(const struct files *files, const char *path);
/* The drawing of the plant, at most 1 MiB. APC_ENOTFOUND: there is none there. */
int graphic_load(struct text *graphic, const char *path, struct apc_error *why);

/* ---- login.c ---- */
void get_session(struct ui *ui, struct request *r, struct apc_store *store);
void post_login(struct ui *ui, struct request *r, struct apc_store *store);
void post_logout(struct ui *ui, struct request *r, struct apc_store *store);
/* The login form as the answer to a browser without a session. */
void login_page(struct request *r, const char *message);

#endif
