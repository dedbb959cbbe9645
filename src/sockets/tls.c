/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * TLS 1.3 by OpenSSL, which only this file includes: who a program is, and sessions over sockets that do not
 * block.
 *
 * Either side proves by a certificate who it is. A server's must be of the host that was asked for; a
 * client's of a name that the server was told, which is looked at in the handshake, so that a stranger never
 * gets to say a word. Nothing is resumed: each connection is proven anew. The one session ticket that a
 * server sends is the sign by which a client knows that it was accepted; without it a client is done before
 * the server has looked at its certificate, and would learn of a refusal from its first exchange.
 *
 * A handshake takes memory and gives some back much later, so the asking side has it in a thread of its own
 * (tls_link.c). A frame takes a few pieces below 1 KiB within OpenSSL and gives them back before the call
 * returns; malloc has those in its thread's cache, without a lock or a system call. That is all that a tick
 * ever takes.
 *
 * OpenSSL reads ahead, what is there of the socket at once: one system call a frame instead of two. So there
 * may be something to receive of which poll(2) knows nothing; `more` says so until a call found nothing.
 */
#include "base/text.h"
#include "sockets/sockets_internal.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#define NAME_MAX_LEN 64 /* of a certificate: X.520's upper bound of a common name */

struct apc_identity {
    char *file;
    BIO_METHOD *socket;
    pthread_mutex_t mutex; /* of what follows */
    SSL_CTX *context;
    apc_ns expiry;
    struct stat read; /* the file when it was read */
};

struct apc_tls {
    SSL *ssl;
    const char *const *clients; /* that may connect; NULL: the asking side */
    size_t n_clients;
    bool accepted; /* by the other side */
    bool more;
    short events;
    char peer[NAME_MAX_LEN + 1];
    struct apc_error error;
};

/* ---- The socket, as OpenSSL sees it: as it would itself, but without SIGPIPE ------------------- */

static int socket_of(BIO *bio)
{
    return (int)(intptr_t)BIO_get_data(bio);
}

static int moved_bytes(BIO *bio, ssize_t n)
{
    BIO_clear_flags(bio, BIO_FLAGS_RWS | BIO_FLAGS_SHOULD_RETRY | BIO_FLAGS_IN_EOF);
    if (n == 0)
        BIO_set_flags(bio, BIO_FLAGS_IN_EOF);
    return (int)n;
}

static int socket_write(BIO *bio, const char *data, int length)
{
    int n = moved_bytes(bio, send(socket_of(bio), data, (size_t)length, MSG_NOSIGNAL));
    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        BIO_set_retry_write(bio);
    return n;
}

static int socket_read(BIO *bio, char *data, int size)
{
    int n = moved_bytes(bio, recv(socket_of(bio), data, (size_t)size, 0));
    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        BIO_set_retry_read(bio);
    return n;
}

static long socket_control(BIO *bio, int command, long number, void *pointer)
{
    (void)number, (void)pointer;
    if (command == BIO_CTRL_EOF)
        return BIO_test_flags(bio, BIO_FLAGS_IN_EOF) != 0;
    return command == BIO_CTRL_FLUSH;
}

/* ---- Identity ------------------------------------------------------------------------------- */

/* What OpenSSL says; of a peer's alert what the peer says. */
static const char *last_tls_error(void)
{
    const unsigned long e = ERR_peek_last_error();
    const int reason = ERR_GET_REASON(e);
    const char *text = ERR_reason_error_string(e);

    if (ERR_GET_LIB(e) == ERR_LIB_SSL && reason > SSL_AD_REASON_OFFSET && reason < SSL_AD_REASON_OFFSET + 256)
        text = SSL_alert_desc_string_long(reason - SSL_AD_REASON_OFFSET);
    return text ? text : "no reason given";
}

static int refuse_password(char *buffer, int size, int writing, void *ctx)
{
    (void)buffer, (void)size, (void)writing, (void)ctx;
    return -1;
}

/* INT64_MAX: beyond the years of apc_ns, as where there is no end (RFC 5280: 99991231235959Z). False: it has
 * no date. */
static bool expiry_of(const X509 *certificate, apc_ns *expiry)
{
    struct tm tm;
    const bool good = ASN1_TIME_to_tm(X509_get0_notAfter(certificate), &tm);

    if (good && __builtin_mul_overflow(timegm(&tm), APC_NS_PER_S, expiry))
        *expiry = tm.tm_year < 70 ? INT64_MIN : INT64_MAX;
    return good;
}

static int on_ticket(SSL *ssl, SSL_SESSION *session)
{
    struct apc_tls *tls = SSL_get_app_data(ssl);
    (void)session;
    tls->accepted = true;
    return 0; /* it is not kept */
}

static SSL_CTX *new_context(void)
{
    SSL_CTX *c = SSL_CTX_new(TLS_method());

    if (!c || !SSL_CTX_set_min_proto_version(c, TLS1_3_VERSION) ||
        !SSL_CTX_set_max_proto_version(c, TLS1_3_VERSION) || !SSL_CTX_set_num_tickets(c, 1) ||
        !SSL_CTX_set_session_id_context(c, (const unsigned char *)"apc", 3)) {
        SSL_CTX_free(c);
        return NULL;
    }
    SSL_CTX_set_options(c, SSL_OP_NO_TICKET | SSL_OP_IGNORE_UNEXPECTED_EOF);
    SSL_CTX_set_mode(c, SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER);
    SSL_CTX_set_session_cache_mode(c, SSL_SESS_CACHE_CLIENT | SSL_SESS_CACHE_NO_INTERNAL);
    SSL_CTX_sess_set_new_cb(c, on_ticket);
    SSL_CTX_set_read_ahead(c, 1);
    return c;
}

/* The certificates of the file: the first is its own, the others are of authorities. */
static int take_certificates(SSL_CTX *context, BIO *bio, apc_ns *expiry)
{
    size_t n = 0, authorities = 0;
    X509 *x;

    *expiry = INT64_MAX;
    for (; (x = PEM_read_bio_X509(bio, NULL, refuse_password, NULL)); n++) {
        apc_ns until = INT64_MAX;
        int ok = expiry_of(x, &until);
        if (ok && n == 0)
            ok = SSL_CTX_use_certificate(context, x);
        else if (ok)
            ok = X509_check_ca(x) > 0 && X509_STORE_add_cert(SSL_CTX_get_cert_store(context), x);
        authorities += n > 0;
        *expiry = until < *expiry ? until : *expiry;
        X509_free(x);
        if (!ok)
            return APC_EPROTO;
    }
    return authorities ? 0 : APC_ENOTFOUND;
}

/* Into @p context and @p expiry. */
static int read_identity(const char *file, SSL_CTX **context, apc_ns *expiry, struct apc_error *why)
{
    BIO *bio = BIO_new_file(file, "re");
    EVP_PKEY *key = NULL;
    int rc = 0;

    *context = NULL;
    ERR_clear_error();
    if (!bio)
        return apc_fail(why, APC_ENOTFOUND, "identity \"%s\" cannot be read: %s", file,
                        strerrordesc_np(errno));
    *context = new_context();
    if (!*context)
        rc = apc_fail(why, APC_ENOMEM, "identity \"%s\": %s", file, last_tls_error());
    else if (!(key = PEM_read_bio_PrivateKey(bio, NULL, refuse_password, NULL)))
        rc = apc_fail(why, APC_EINVAL, "identity \"%s\" has no private key, or one with a password", file);
    else if (BIO_seek(bio, 0) < 0 || (rc = take_certificates(*context, bio, expiry)) < 0)
        rc = apc_fail(why, APC_EINVAL,
                      rc == APC_ENOTFOUND
                          ? "identity \"%s\" must hold a certificate, and behind it that of the "
                            "authority; `apc cert` makes such a file"
                          : "identity \"%s\": a certificate behind its own is of no authority, "
                            "or cannot be used",
                      file);
    else if (!SSL_CTX_use_PrivateKey(*context, key) || !SSL_CTX_check_private_key(*context))
        rc = apc_fail(why, APC_EINVAL, "identity \"%s\": the key is not that of the first certificate", file);
    EVP_PKEY_free(key);
    BIO_free(bio);
    ERR_clear_error(); /* also the end of the file is one */
    if (rc < 0) {
        SSL_CTX_free(*context);
        *context = NULL;
    }
    return rc;
}

static BIO_METHOD *new_method(void)
{
    BIO_METHOD *m = BIO_meth_new(BIO_TYPE_SOURCE_SINK, "apc socket");

    if (m && BIO_meth_set_write(m, socket_write) && BIO_meth_set_read(m, socket_read) &&
        BIO_meth_set_ctrl(m, socket_control))
        return m;
    BIO_meth_free(m);
    return NULL;
}

int apc_identity_load(struct apc_identity **identity, const char *file, struct apc_error *why)
{
    struct apc_identity *i;
    int rc;

    if (!identity || !file)
        return apc_fail(why, APC_EINVAL, "an identity needs a place to go and a file");
    *identity = NULL;
    i = calloc(1, sizeof *i);
    if (!i || apc_mutex_init(&i->mutex) < 0) {
        free(i);
        return apc_fail(why, APC_ENOMEM, "identity \"%s\": no memory", file);
    }
    i->file = strdup(file);
    i->socket = new_method();
    rc = i->file && i->socket ? 0 : apc_fail(why, APC_ENOMEM, "identity \"%s\": no memory", file);
    if (rc == 0 && stat(file, &i->read) < 0)
        rc = apc_fail(why, APC_ENOTFOUND, "identity \"%s\" cannot be read: %s", file, strerrordesc_np(errno));
    if (rc == 0)
        rc = read_identity(file, &i->context, &i->expiry, why);
    if (rc < 0)
        apc_identity_free(i);
    else
        *identity = i;
    return rc;
}

void apc_identity_free(struct apc_identity *i)
{
    if (!i)
        return;
    SSL_CTX_free(i->context);
    BIO_meth_free(i->socket);
    pthread_mutex_destroy(&i->mutex);
    free(i->file);
    free(i);
}

/* ---- A new one in its place ------------------------------------------------------------------- */

/* The common name, if it is one line of text and there is just one. */
static bool common_name_of(const X509 *certificate, char name[NAME_MAX_LEN + 1])
{
    X509_NAME *subject = X509_get_subject_name(certificate);
    const int at = X509_NAME_get_index_by_NID(subject, NID_commonName, -1);
    unsigned char *text = NULL;
    int length = -1;

    if (at >= 0 && X509_NAME_get_index_by_NID(subject, NID_commonName, at) < 0)
        length = ASN1_STRING_to_UTF8(&text, X509_NAME_ENTRY_get_data(X509_NAME_get_entry(subject, at)));
    const bool ok = length > 0 && length <= NAME_MAX_LEN && strlen((const char *)text) == (size_t)length &&
                    text_is_clean((const char *)text);
    if (ok)
        memcpy(name, text, (size_t)length + 1);
    OPENSSL_free(text);
    return ok;
}

/* XKU_SSL_CLIENT, XKU_SSL_SERVER: what it says that it is for. One that says nothing is for neither. */
static uint32_t use_of(X509 *certificate)
{
    const uint32_t use = X509_get_extended_key_usage(certificate);

    return use == UINT32_MAX ? 0 : use & (XKU_SSL_CLIENT | XKU_SSL_SERVER);
}

static bool same_name(const X509 *was, const X509 *is)
{
    char before[NAME_MAX_LEN + 1], now[NAME_MAX_LEN + 1];

    return !common_name_of(was, before) || (common_name_of(is, now) && strcmp(before, now) == 0);
}

/* Is @p is of all hosts that @p was is of? */
static bool same_hosts(const X509 *was, const X509 *is)
{
    GENERAL_NAMES *before = X509_get_ext_d2i(was, NID_subject_alt_name, NULL, NULL),
                  *now = X509_get_ext_d2i(is, NID_subject_alt_name, NULL, NULL);
    bool there = true;

    for (int i = 0; i < sk_GENERAL_NAME_num(before) && there; i++) {
        there = false;
        for (int k = 0; k < sk_GENERAL_NAME_num(now) && !there; k++)
            there = GENERAL_NAME_cmp(sk_GENERAL_NAME_value(before, i), sk_GENERAL_NAME_value(now, k)) == 0;
    }
    GENERAL_NAMES_free(before);
    GENERAL_NAMES_free(now);
    return there;
}

/* Does an authority of @p believer vouch for @p certificate, whatever the day? */
static bool believes(SSL_CTX *believer, X509 *certificate)
{
    X509_STORE_CTX *c = X509_STORE_CTX_new();
    bool ok = c && X509_STORE_CTX_init(c, SSL_CTX_get_cert_store(believer), certificate, NULL);

    if (ok) {
        X509_STORE_CTX_set_flags(c, X509_V_FLAG_NO_CHECK_TIME);
        ok = X509_verify_cert(c) == 1;
    }
    X509_STORE_CTX_free(c);
    return ok;
}

/* NULL: whoever accepts what @p before says of us, and whom it accepts, is to go on with @p now. Else why
 * not. Peers have an authority of ours: it must vouch for both. */
static const char *unlike(SSL_CTX *before, SSL_CTX *now)
{
    X509 *const was = SSL_CTX_get0_certificate(before), *const is = SSL_CTX_get0_certificate(now);

    if (use_of(was) & ~use_of(is))
        return use_of(was) & XKU_SSL_SERVER ? "it is none of a plant" : "it is none of a client";
    if (!same_name(was, is))
        return "it has another name";
    if (!same_hosts(was, is))
        return "it is not of all hosts that it was of";
    if (!believes(before, is) || !believes(now, was))
        return "it is of another authority";
    if (X509_cmp_current_time(X509_get0_notAfter(is)) <= 0)
        return "it has expired";
    return X509_cmp_current_time(X509_get0_notBefore(is)) < 0 ? NULL : "it is not good yet";
}

static bool same_file(const struct stat *a, const struct stat *b)
{
    return a->st_ino == b->st_ino && a->st_size == b->st_size && a->st_mtim.tv_sec == b->st_mtim.tv_sec &&
           a->st_mtim.tv_nsec == b->st_mtim.tv_nsec;
}

int apc_identity_refresh(struct apc_identity *i, struct apc_error *why)
{
    struct stat now;
    SSL_CTX *context, *old;
    apc_ns expiry;
    int rc;

    if (stat(i->file, &now) < 0)
        return apc_fail(why, APC_ENOTFOUND, "identity \"%s\" cannot be read: %s", i->file,
                        strerrordesc_np(errno));
    if (same_file(&now, &i->read))
        return 0;
    rc = read_identity(i->file, &context, &expiry, why);
    const char *const differs = rc == 0 ? unlike(i->context, context) : NULL;
    if (differs) {
        rc = apc_fail(why, APC_EINVAL, "identity \"%.90s\": %s", i->file, differs);
        SSL_CTX_free(context);
    }
    if (rc < 0) /* looked at again: it may be half written, or of tomorrow */
        return rc;
    i->read = now;
    pthread_mutex_lock(&i->mutex);
    old = i->context;
    i->context = context;
    i->expiry = expiry;
    pthread_mutex_unlock(&i->mutex);
    SSL_CTX_free(old);
    return 1;
}

apc_ns apc_identity_expiry(struct apc_identity *i)
{
    pthread_mutex_lock(&i->mutex);
    const apc_ns expiry = i->expiry;
    pthread_mutex_unlock(&i->mutex);
    return expiry;
}

/* ---- Who is on the other side ---------------------------------------------------------------- */

/* OpenSSL has looked at one certificate of the peer's chain; the last one is the peer's own. */
static int on_certificate(int ok, X509_STORE_CTX *context)
{
    SSL *ssl = X509_STORE_CTX_get_ex_data(context, SSL_get_ex_data_X509_STORE_CTX_idx());
    struct apc_tls *tls = SSL_get_app_data(ssl);

    if (X509_STORE_CTX_get_error_depth(context) > 0)
        return ok;
    X509 *const own = X509_STORE_CTX_get_current_cert(context);
    if (ok && !(use_of(own) & (tls->clients ? XKU_SSL_CLIENT : XKU_SSL_SERVER))) {
        X509_STORE_CTX_set_error(context,
                                 X509_V_ERR_INVALID_PURPOSE); /* OpenSSL takes one that says nothing */
        return 0;
    }
    const bool named = common_name_of(own, tls->peer);
    if (!ok || !tls->clients)
        return ok;
    for (size_t i = 0; named && i < tls->n_clients; i++)
        if (!strcmp(tls->clients[i], tls->peer))
            return ok;
    X509_STORE_CTX_set_error(context, X509_V_ERR_APPLICATION_VERIFICATION);
    return 0;
}

/* ---- Sessions -------------------------------------------------------------------------------- */

static int open_session(struct apc_tls **tls, struct apc_identity *identity, int fd)
{
    struct apc_tls *t = calloc(1, sizeof *t);
    BIO *bio = BIO_new(identity->socket);

    *tls = t;
    pthread_mutex_lock(&identity->mutex);
    if (t)
        t->ssl = SSL_new(identity->context);
    pthread_mutex_unlock(&identity->mutex);
    if (!t || !bio || !t->ssl || !SSL_set_app_data(t->ssl, t)) {
        BIO_free(bio);
        apc_tls_free(t);
        *tls = NULL;
        return APC_ENOMEM;
    }
    BIO_set_data(bio, (void *)(intptr_t)fd);
    BIO_set_init(bio, 1);
    SSL_set_bio(t->ssl, bio, bio);
    SSL_set_verify(t->ssl, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, on_certificate);
    t->events = POLLIN;
    return 0;
}

int apc_tls_ask(struct apc_tls **tls, struct apc_identity *identity, int fd, const struct apc_hostport *host)
{
    char name[sizeof host->host];
    int ok, rc = open_session(tls, identity, fd);

    if (rc < 0)
        return rc;
    SSL_set_connect_state((*tls)->ssl);
    (*tls)->events = POLLOUT;
    SSL_set_hostflags((*tls)->ssl, X509_CHECK_FLAG_NO_WILDCARDS | X509_CHECK_FLAG_NEVER_CHECK_SUBJECT);
    if (host->numeric)
        ok = X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param((*tls)->ssl), host->host);
    else {
        /* a copy, since OpenSSL's macro takes it without const */
        memcpy(name, host->host, sizeof name);
        ok = SSL_set1_host((*tls)->ssl, name) && SSL_set_tlsext_host_name((*tls)->ssl, name);
    }
    if (ok)
        return 0;
    apc_tls_free(*tls);
    *tls = NULL;
    return APC_ENOMEM;
}

int apc_tls_answer(struct apc_tls **tls, struct apc_identity *identity, int fd, const char *const *clients,
                   size_t n)
{
    int rc = open_session(tls, identity, fd);

    if (rc < 0)
        return rc;
    SSL_set_accept_state((*tls)->ssl);
    (*tls)->clients = clients;
    (*tls)->n_clients = n;
    (*tls)->accepted = true; /* its certificate comes before the peer's */
    return 0;
}

void apc_tls_free(struct apc_tls *tls)
{
    if (!tls)
        return;
    SSL_free(tls->ssl);
    free(tls);
}

static void say_why(struct apc_tls *t)
{
    const long verified = SSL_get_verify_result(t->ssl);

    if (verified == X509_V_ERR_APPLICATION_VERIFICATION)
        apc_fail(&t->error, APC_EPROTO, "\"%s\" is none of the clients that may connect", t->peer);
    else if (verified != X509_V_OK)
        apc_fail(&t->error, APC_EPROTO, "the peer's certificate is refused: %s",
                 X509_verify_cert_error_string(verified));
    else if (ERR_GET_REASON(ERR_peek_last_error()) > SSL_AD_REASON_OFFSET)
        apc_fail(&t->error, APC_EPROTO, "the peer refuses us: %s", last_tls_error());
    else
        apc_fail(&t->error, APC_EPROTO, "TLS: %s", last_tls_error());
}

/* What became of a call that returned @p n: as of recv(2). */
static ssize_t outcome(struct apc_tls *t, int n)
{
    const int number = errno;

    if (n > 0) {
        t->events = POLLIN;
        return n;
    }
    switch (SSL_get_error(t->ssl, n)) {
    case SSL_ERROR_WANT_READ:
        t->events = POLLIN;
        errno = EAGAIN;
        return -1;
    case SSL_ERROR_WANT_WRITE:
        t->events = POLLOUT;
        errno = EAGAIN;
        return -1;
    case SSL_ERROR_ZERO_RETURN:
        return 0;
    case SSL_ERROR_SYSCALL:
        errno = number ? number : ECONNRESET;
        return -1;
    default:
        say_why(t);
        errno = EPROTO;
        return -1;
    }
}

int apc_tls_handshake(struct apc_tls *t, struct apc_error *why)
{
    char byte;
    ssize_t n;

    ERR_clear_error();
    errno = 0;
    n = outcome(t, SSL_do_handshake(t->ssl));
    if (n > 0 && !t->accepted) {
        n = outcome(t, SSL_peek(t->ssl, &byte, 1));
        t->accepted = t->accepted || n > 0;
        t->more = n > 0;
    }
    if (t->accepted && (n > 0 || (n < 0 && errno == EAGAIN && SSL_is_init_finished(t->ssl)))) {
        t->more = t->more || SSL_has_pending(t->ssl);
        t->events = POLLIN;
        return 1;
    }
    if (n < 0 && errno == EAGAIN)
        return 0;
    if (n == 0)
        return apc_fail(why, APC_EPROTO, "the peer closed the connection in the TLS handshake");
    return apc_fail(why, APC_EPROTO, "%s", errno == EPROTO ? t->error.text : strerrordesc_np(errno));
}

ssize_t apc_tls_recv(struct apc_tls *t, char *data, size_t size)
{
    ERR_clear_error();
    errno = 0;
    const ssize_t n = outcome(t, SSL_read(t->ssl, data, size > INT32_MAX ? INT32_MAX : (int)size));
    t->more = n > 0 && SSL_has_pending(t->ssl);
    return n;
}

ssize_t apc_tls_send(struct apc_tls *t, const char *data, size_t size)
{
    ERR_clear_error();
    errno = 0;
    return outcome(t, SSL_write(t->ssl, data, size > INT32_MAX ? INT32_MAX : (int)size));
}

short apc_tls_events(const struct apc_tls *t)
{
    return t->events;
}

bool apc_tls_more(const struct apc_tls *t)
{
    return t->more;
}

bool apc_tls_heard(const struct apc_tls *t)
{
    return BIO_number_read(SSL_get_rbio(t->ssl)) > 0;
}

const char *apc_tls_error(const struct apc_tls *t)
{
    return t->error.text;
}

const char *apc_tls_peer(const struct apc_tls *t)
{
    return t->peer;
}
