/* SPDX-License-Identifier: BSD-3-Clause */
/* tls: who gets in, who does not, and what it costs the others. */
#define UNDER_TEST connected
#include "apc/admin/authority.h"
#include "sockets/sockets_internal.h"
#include "sockets_faults.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <openssl/ssl.h>

#define PATIENCE (60 * APC_NS_PER_S) /* a hang is a failure, not a hung test */
#define YEAR     (365 * 24 * 3600L)
#define FRAME    (100u << 10) /* more than a TLS record, than what a socket takes at once */

static char folder[] = "/tmp/apc-tls-XXXXXX";

/* ---- A wall clock that OpenSSL asks, and its memory, counted ---------------------------------- */

static _Atomic long clock_offset;         /* s */
static atomic_long taken, given, largest; /* pieces; bytes */

/* OpenSSL's own calls are to find it. */
__attribute__((visibility("default"))) time_t shifted_time(time_t *at) __asm__("time");
time_t shifted_time(time_t *at)
{
    struct timespec t;
    syscall(SYS_clock_gettime, CLOCK_REALTIME, &t);
    t.tv_sec += atomic_load(&clock_offset);
    if (at)
        *at = t.tv_sec;
    return t.tv_sec;
}

static void count(size_t size)
{
    if (atomic_load(&largest) < (long)size)
        atomic_store(&largest, (long)size);
    atomic_fetch_add(&taken, 1);
}

static void *counted_malloc(size_t size, const char *file, int line)
{
    (void)file, (void)line;
    count(size);
    return malloc(size);
}

static void *counted_realloc(void *old, size_t size, const char *file, int line)
{
    (void)file, (void)line;
    if (!old)
        count(size);
    return realloc(old, size);
}

static void counted_free(void *memory, const char *file, int line)
{
    (void)file, (void)line;
    if (memory)
        atomic_fetch_add(&given, 1);
    free(memory);
}

/* ---- Certificates of every kind ---------------------------------------------------------------- */

static const char *in(const char *name)
{
    static char path[4][128];
    static unsigned next;
    char *p = path[next++ % 4];
    snprintf(p, sizeof path[0], "%s/%s", folder, name);
    return p;
}

static void issue(const char *authority, const char *name, enum authority_role role, const char *host,
                  long from, long until, bool replace)
{
    const time_t now = time(NULL);
    const struct authority_request request = {.name = name,
                                              .role = role,
                                              .hosts = &host,
                                              .n_hosts = host != NULL,
                                              .from = now + from,
                                              .until = now + until,
                                              .replace = replace};
    struct apc_error why;
    int rc = role == ROLE_AUTHORITY ? authority_create(in(authority), &request, &why)
                                    : authority_issue(in(authority), &request, &why);
    if (rc < 0)
        fail_msg("%s", why.text);
}

/* The texts of some files, one after the other, become a file. */
static void join(const char *to, const char *const *from)
{
    FILE *out = fopen(in(to), "w");
    assert_non_null(out);
    for (; *from; from++) {
        FILE *file = fopen(in(*from), "r");
        char text[8192];
        assert_non_null(file);
        const size_t n = fread(text, 1, sizeof text, file);
        fwrite(text, 1, n, out);
        fclose(file);
    }
    assert_int_equal(fclose(out), 0);
}

/* The key and certificate of @p from, with the authority @p believes in: as who is cheated has it. */
static void cheat(const char *to, const char *from, const char *believes)
{
    char text[8192] = {0}, *end;
    FILE *file = fopen(in(from), "r"), *out;
    assert_non_null(file);
    assert_true(fread(text, 1, sizeof text - 1, file) > 0);
    fclose(file);
    end = strstr(text, "-----END CERTIFICATE-----");
    assert_non_null(end);
    end[strlen("-----END CERTIFICATE-----")] = '\n';
    end[strlen("-----END CERTIFICATE-----") + 1] = '\0';
    out = fopen(in("part"), "w");
    assert_non_null(out);
    fputs(text, out);
    fclose(out);
    join(to, (const char *const[]){"part", believes, NULL});
}

/* As an authority makes it that does not say what a certificate is for. */
static void without_use(const char *to, const char *from)
{
    FILE *file = fopen(in(from), "r");
    assert_non_null(file);
    EVP_PKEY *key = PEM_read_PrivateKey(file, NULL, NULL, NULL);
    X509 *own = PEM_read_X509(file, NULL, NULL, NULL), *above = PEM_read_X509(file, NULL, NULL, NULL);
    fclose(file);
    file = fopen(in("ours/authority.key"), "r");
    assert_non_null(file);
    EVP_PKEY *by = PEM_read_PrivateKey(file, NULL, NULL, NULL);
    fclose(file);
    assert_true(key && own && above && by);
    X509_EXTENSION_free(X509_delete_ext(own, X509_get_ext_by_NID(own, NID_ext_key_usage, -1)));
    assert_true(X509_sign(own, by, EVP_sha256()) > 0);
    file = fopen(in(to), "w");
    assert_true(file && PEM_write_PKCS8PrivateKey(file, key, NULL, NULL, 0, NULL, NULL) &&
                PEM_write_X509(file, own) && PEM_write_X509(file, above));
    assert_int_equal(fclose(file), 0);
    X509_free(own);
    X509_free(above);
    EVP_PKEY_free(key);
    EVP_PKEY_free(by);
}

/* As `openssl pkcs8 -topk8` asks for a password. */
static void with_password(const char *to, const char *from)
{
    FILE *file = fopen(in(from), "r");
    assert_non_null(file);
    EVP_PKEY *key = PEM_read_PrivateKey(file, NULL, NULL, NULL);
    fclose(file);
    file = fopen(in(to), "w");
    assert_true(key && file &&
                PEM_write_PKCS8PrivateKey(file, key, EVP_aes_256_cbc(), "secret", 6, NULL, NULL));
    assert_int_equal(fclose(file), 0);
    EVP_PKEY_free(key);
}

static int make_certificates(void **state)
{
    (void)state;
    assert_non_null(mkdtemp(folder));
    issue("ours", "authority-1", ROLE_AUTHORITY, NULL, -YEAR, 9 * YEAR, false);
    issue("theirs", "authority-1", ROLE_AUTHORITY, NULL, -YEAR, 9 * YEAR, false); /* of the same name */
    issue("self", "client", ROLE_AUTHORITY, NULL, -YEAR, 9 * YEAR, false);
    for (int i = 0; i < 2; i++) {
        const char *whose = i ? "theirs" : "ours";
        issue(whose, "plant", ROLE_PLANT, "127.0.0.1", -60, YEAR, false);
        issue(whose, "elsewhere", ROLE_PLANT, "127.0.0.2", -60, YEAR, false);
        issue(whose, "old-plant", ROLE_PLANT, "127.0.0.1", -YEAR, -60, false);
        issue(whose, "early-plant", ROLE_PLANT, "127.0.0.1", 3600, YEAR, false);
        issue(whose, "client", ROLE_CLIENT, NULL, -60, YEAR, false);
        issue(whose, "stranger", ROLE_CLIENT, NULL, -60, YEAR, false);
        issue(whose, "client2", ROLE_CLIENT, NULL, -60, YEAR, false);
        issue(whose, "old", ROLE_CLIENT, NULL, -YEAR, -60, false);
        issue(whose, "early", ROLE_CLIENT, NULL, 3600, YEAR, false);
    }
    cheat("their-client.pem", "theirs/client.pem", "ours/authority.pem");
    cheat("their-plant.pem", "theirs/plant.pem", "ours/authority.pem");
    without_use("any-client.pem", "ours/client.pem");
    without_use("any-plant.pem", "ours/plant.pem");
    join("self-client.pem",
         (const char *const[]){"self/authority.key", "self/authority.pem", "ours/authority.pem", NULL});
    return 0;
}

static int remove_certificates(void **state)
{
    char command[64];
    (void)state;
    snprintf(command, sizeof command, "rm -r %s", folder);
    return system(command);
}

static struct apc_identity *load(const char *file)
{
    struct apc_identity *identity;
    struct apc_error why;
    if (apc_identity_load(&identity, in(file), &why) < 0)
        fail_msg("%s", why.text);
    return identity;
}

/* ---- A plant, and clients ----------------------------------------------------------------------- */

struct plant {
    struct apc_identity *identity;
    struct apc_server *server;
    pthread_mutex_t mutex;
    char peer[APC_PEER_LEN]; /* who asked last */
    atomic_int asked;
};

static int echo(void *ctx, uint64_t connection, const char *request, size_t length, char *reply, size_t size)
{
    struct plant *p = ctx;
    (void)size;
    pthread_mutex_lock(&p->mutex);
    apc_server_peer(p->server, connection, p->peer);
    pthread_mutex_unlock(&p->mutex);
    atomic_fetch_add(&p->asked, 1);
    memcpy(reply, request, length);
    return (int)length;
}

static const char *const clients[] = {"client", "client2", "old", "early", "plant"};

static struct plant *open_plant(const char *identity, apc_ns frame_timeout)
{
    struct plant *p = calloc(1, sizeof *p);
    struct apc_error why;

    assert_non_null(p);
    pthread_mutex_init(&p->mutex, NULL);
    p->identity = load(identity);
    const struct apc_server_options options = {.size = sizeof options,
                                               .frame_max = FRAME,
                                               .frame_timeout = frame_timeout,
                                               .identity = p->identity,
                                               .clients = clients,
                                               .n_clients = sizeof clients / sizeof *clients};
    if (apc_server_create(&p->server, "tls:127.0.0.1:0", &options, echo, p, &why) < 0)
        fail_msg("%s", why.text);
    return p;
}

static void close_plant(struct plant *p)
{
    apc_server_destroy(p->server);
    apc_identity_free(p->identity);
    pthread_mutex_destroy(&p->mutex);
    free(p);
}

struct client {
    struct apc_identity *identity;
    struct apc_link *link;
};

static struct client open_client(const char *identity, const char *host, int port)
{
    struct client c = {.identity = load(identity)};
    const struct apc_link_options options = {.size = sizeof options,
                                             .frame_max = FRAME,
                                             .backoff_min = 1,
                                             .backoff_max = 1,
                                             .identity = c.identity};
    struct apc_error why;
    char uri[64];

    snprintf(uri, sizeof uri, "tls:%s:%d", host, port);
    if (apc_link_create(&c.link, uri, &options, &why) < 0)
        fail_msg("%s", why.text);
    return c;
}

static void close_client(struct client *c)
{
    apc_link_destroy(c->link);
    apc_identity_free(c->identity);
}

static int ask(struct client *c)
{
    const char *reply;
    int n = apc_link_exchange(c->link, "hello\n", 6, &reply, apc_clock_mono(NULL) + PATIENCE);
    if (n == 6)
        assert_memory_equal(reply, "hello\n", 6);
    return n;
}

static struct apc_server_stats stats_of(const struct plant *p)
{
    struct apc_server_stats stats = {.size = sizeof stats};
    apc_server_stats(p->server, &stats);
    return stats;
}

/* ---- What must hold ------------------------------------------------------------------------------ */

static void who_proves_his_name_is_answered_and_known_by_it(void **state)
{
    struct plant *p = open_plant("ours/plant.pem", 0);
    struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server)),
                  d = open_client("ours/client2.pem", "127.0.0.1", apc_server_port(p->server));
    (void)state;
    for (int i = 0; i < 100; i++)
        assert_int_equal(ask(&c), 6);
    assert_int_equal(apc_link_connects(c.link), 1);
    assert_has(p->peer, " (client)");
    assert_int_equal(ask(&d), 6);
    assert_has(p->peer, " (client2)");
    assert_int_equal(ask(&c), 6);
    apc_link_reset(c.link);
    assert_int_equal(ask(&c), 6);
    assert_int_equal(apc_link_connects(c.link), 2);
    close_client(&c);
    close_client(&d);
    close_plant(p);
}

static void frames_of_any_size_pass_in_pieces_of_any_size(void **state)
{
    static char text[FRAME];
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    const size_t sizes[] = {2, 100, 16383, 16384, 16385, 3 * 16384, FRAME - 1};
    (void)state;
    for (size_t i = 0; i < FRAME; i++)
        text[i] = (char)('a' + i % 23);
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes - 3 * (size_t)pass; i++) {
            const char *reply;
            const size_t n = sizes[i];
            text[n - 1] = '\n';
            assert_int_equal(apc_link_exchange(c.link, text, n, &reply, apc_clock_mono(NULL) + PATIENCE), n);
            assert_memory_equal(reply, text, n);
            text[n - 1] = 'x';
        }
        apc_link_reset(c.link); /* and now byte by byte, the handshake as well */
        atomic_store(&kernel[SEND].most, 1);
        atomic_store(&kernel[RECV].most, 1);
    }
    close_client(&c);
    close_plant(p);
}

/*
 * Promise(links/tls-nobody-heard): Over `tls:` nobody is heard but a client that the plant was told of,
 *   with a good certificate of its authority, by TLS 1.3; no plant is told a word that does not prove its
 *   host.
 */
static void a_client_with_a_wrong_certificate_never_gets_a_word_in(void **state)
{
    static const struct {
        const char *identity, *said;
    } wrong[] = {{"ours/old.pem", "the peer refuses us: certificate expired"},
                 {"ours/early.pem", "the peer refuses us: bad certificate"},
                 {"their-client.pem", "the peer refuses us: "},
                 {"self-client.pem", "the peer refuses us: "},
                 {"ours/stranger.pem", "the peer refuses us: "},
                 {"ours/plant.pem", "the peer refuses us: unsupported certificate"},
                 {"any-client.pem", "the peer refuses us: unsupported certificate"},
                 {"theirs/client.pem", "the peer's certificate is refused: "}};
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    struct client rightful = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    (void)state;
    assert_int_equal(ask(&rightful), 6);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct client c = open_client(wrong[i].identity, "127.0.0.1", apc_server_port(p->server));
        const int before = atomic_load(&p->asked);
        for (int k = 0; k < 3; k++) {
            assert_int_equal(ask(&c), APC_ECONN);
            assert_has(apc_link_error(c.link), wrong[i].said);
        }
        assert_int_equal(atomic_load(&p->asked), before);
        assert_int_equal(ask(&rightful), 6);
        close_client(&c);
    }
    assert_int_equal(apc_link_connects(rightful.link), 1); /* and it was never in anybody's way */
    close_client(&rightful);
    close_plant(p);
}

/* Promise(links/tls-nobody-heard) */
static void a_plant_with_a_wrong_certificate_is_never_told_a_word(void **state)
{
    static const struct {
        const char *identity, *said;
    } wrong[] = {{"ours/old-plant.pem", "has expired"},
                 {"ours/early-plant.pem", "not yet valid"},
                 {"their-plant.pem", "is refused: "},
                 {"self-client.pem", "is refused: "},
                 {"ours/elsewhere.pem", "IP address mismatch"},
                 {"ours/client.pem", "purpose"},
                 {"any-plant.pem", "purpose"}};
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct plant *p = open_plant(wrong[i].identity, PATIENCE);
        struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
        assert_int_equal(ask(&c), APC_ECONN);
        assert_has(apc_link_error(c.link), "the peer's certificate is refused: ");
        assert_has(apc_link_error(c.link), wrong[i].said);
        assert_int_equal(atomic_load(&p->asked), 0);
        close_client(&c);
        close_plant(p);
    }
}

/* A name of the host is proven as an address is, and one is not the other. */
static void a_plant_is_known_by_the_name_that_was_asked_for(void **state)
{
    (void)state;
    issue("ours", "named", ROLE_PLANT, "localhost", -60, YEAR, false);
    struct plant *p = open_plant("ours/named.pem", PATIENCE);
    struct client name = open_client("ours/client.pem", "localhost", apc_server_port(p->server)),
                  address = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    assert_int_equal(ask(&name), 6);
    assert_int_equal(ask(&address), APC_ECONN);
    assert_has(apc_link_error(address.link), "IP address mismatch");
    close_client(&name);
    close_client(&address);
    close_plant(p);
}

/* ---- Peers that are none of ours --------------------------------------------------------------- */

static int connect_raw(int port)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    assert_int_equal(connect(fd, (struct sockaddr *)&at, sizeof at), 0);
    return fd;
}

/* Everything that comes until the other side closes. */
static ssize_t drain(int fd)
{
    char text[4096];
    ssize_t n, all = 0;
    while ((n = read(fd, text, sizeof text)) > 0)
        all += n;
    return all;
}

/* By OpenSSL alone: with a certificate or without, of whatever version. False: it was not let in. */
static bool gets_in(int port, const char *identity, int version)
{
    SSL_CTX *context = SSL_CTX_new(TLS_client_method());
    char reply[6];
    int fd = connect_raw(port);
    bool in_there;

    assert_true(SSL_CTX_set_max_proto_version(context, version));
    if (identity) {
        assert_int_equal(SSL_CTX_use_certificate_file(context, in(identity), SSL_FILETYPE_PEM), 1);
        assert_int_equal(SSL_CTX_use_PrivateKey_file(context, in(identity), SSL_FILETYPE_PEM), 1);
    }
    SSL *ssl = SSL_new(context);
    SSL_set_fd(ssl, fd);
    signal(SIGPIPE, SIG_IGN);
    in_there = SSL_connect(ssl) == 1 && SSL_write(ssl, "hello\n", 6) == 6 && SSL_read(ssl, reply, 6) == 6;
    SSL_free(ssl);
    SSL_CTX_free(context);
    close(fd);
    return in_there;
}

/* Promise(links/tls-nobody-heard) */
static void without_a_certificate_or_with_an_old_protocol_nobody_gets_in(void **state)
{
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    const int port = apc_server_port(p->server);
    (void)state;
    assert_true(gets_in(port, "ours/client.pem", TLS1_3_VERSION)); /* so it is not this test that cannot */
    assert_false(gets_in(port, NULL, TLS1_3_VERSION));
    assert_false(gets_in(port, "ours/client.pem", TLS1_2_VERSION));
    assert_false(gets_in(port, "ours/client.pem", TLS1_1_VERSION));
    int fd = connect_raw(port);
    assert_int_equal(write(fd, "apc1 query 1 0;\n", 16), 16);
    (void)drain(fd); /* an alert, and the end */
    close(fd);
    assert_int_equal(atomic_load(&p->asked), 1);
    close_plant(p);
}

/* The other way round: a server of TLS 1.2, and one that speaks no TLS. */
static void *serve_old(void *arg)
{
    int fd = accept(*(int *)arg, NULL, NULL);
    SSL_CTX *context = SSL_CTX_new(TLS_server_method());
    assert_true(SSL_CTX_set_max_proto_version(context, TLS1_2_VERSION));
    SSL_CTX_use_certificate_file(context, in("ours/plant.pem"), SSL_FILETYPE_PEM);
    SSL_CTX_use_PrivateKey_file(context, in("ours/plant.pem"), SSL_FILETYPE_PEM);
    SSL *ssl = SSL_new(context);
    SSL_set_fd(ssl, fd);
    (void)SSL_accept(ssl);
    SSL_free(ssl);
    SSL_CTX_free(context);
    close(fd);
    return NULL;
}

/* Promise(links/tls-nobody-heard) */
static void a_plant_of_an_old_protocol_is_refused(void **state)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;
    int listener = socket(AF_INET, SOCK_STREAM, 0);
    pthread_t thread;
    (void)state;
    assert_int_equal(bind(listener, (struct sockaddr *)&at, sizeof at), 0);
    assert_int_equal(listen(listener, 1), 0);
    assert_int_equal(getsockname(listener, (struct sockaddr *)&at, &length), 0);
    assert_int_equal(pthread_create(&thread, NULL, serve_old, &listener), 0);
    struct client c = open_client("ours/client.pem", "127.0.0.1", ntohs(at.sin_port));
    assert_int_equal(ask(&c), APC_ECONN);
    assert_has(apc_link_error(c.link), "protocol version");
    pthread_join(thread, NULL);
    close_client(&c);
    close(listener);
}

/* ---- Nobody in anybody's way -------------------------------------------------------------------- */

/*
 * Promise(links/handshake-stalls-crowd): A handshake that stalls, and a crowd of strangers, hold nobody up;
 *   who cannot wait for a handshake finds it done.
 */
static void a_handshake_that_stalls_ends_and_holds_nobody_up(void **state)
{
    struct plant *p = open_plant("ours/plant.pem", 2 * APC_NS_PER_S);
    const int port = apc_server_port(p->server);
    struct client c = open_client("ours/client.pem", "127.0.0.1", port);
    static const char hello[] = {22, 3, 1,          2, 0, 1,
                                 0,  1, (char)0xfc, 3, 3}; /* the beginning of a ClientHello */
    int begun = connect_raw(port), silent = connect_raw(port);
    (void)state;
    assert_int_equal(write(begun, hello, sizeof hello), sizeof hello);
    assert_int_equal(ask(&c), 6);
    (void)drain(begun); /* the server ends it */
    assert_int_equal(drain(silent), 0);
    assert_int_equal(stats_of(p).rejected, 1); /* who never spoke is none that was refused */
    assert_int_equal(ask(&c), 6);
    assert_int_equal(apc_link_connects(c.link), 1);
    close(begun);
    close(silent);
    close_client(&c);
    close_plant(p);
}

/* Promise(links/handshake-stalls-crowd) */
static void strangers_cannot_lock_the_client_out(void **state)
{
    enum { CROWD = 40 };
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    const int port = apc_server_port(p->server);
    struct client c = open_client("ours/client.pem", "127.0.0.1", port);
    int crowd[CROWD];
    (void)state;
    for (int i = 0; i < CROWD; i++)
        crowd[i] = connect_raw(port);
    assert_int_equal(ask(&c), 6);
    for (int i = 0; i < CROWD; i++) {
        close(crowd[i]);
        crowd[i] = connect_raw(port);
        assert_int_equal(ask(&c), 6);
    }
    assert_int_equal(apc_link_connects(c.link), 1);
    for (int i = 0; i < CROWD; i++)
        close(crowd[i]);
    close_client(&c);
    close_plant(p);
}

/* Its own pieces are small enough for malloc's cache of a thread, which knows neither locks nor the kernel. */
/*
 * Promise(links/nothing-tick-allocates): Nothing in a tick allocates, but for small pieces that OpenSSL
 *   takes for a frame of `tls:` and gives back at once.
 */
static void an_exchange_keeps_no_memory_and_takes_small_pieces_only(void **state)
{
    enum { EXCHANGES = 1000, CACHED = 1032 };
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    (void)state;
    for (int i = 0; i < 2; i++) /* connects */
        assert_int_equal(ask(&c), 6);
    assert_true(atomic_load(&largest) > CACHED); /* they are counted */
    const long before = atomic_load(&taken), kept = before - atomic_load(&given);
    atomic_store(&largest, 0);
    for (int i = 0; i < EXCHANGES; i++)
        assert_int_equal(ask(&c), 6);
    assert_true(atomic_load(&largest) <= CACHED);
    assert_in_range(atomic_load(&taken) - before, 0, 20 * EXCHANGES); /* of both sides */
    close_client(&c);
    close_plant(p);
    assert_true(atomic_load(&taken) - atomic_load(&given) <= kept); /* the server's thread is over */
}

/* A task that cannot wait leaves with its own deadline; the connection is there for the next one. */
/* Promise(links/handshake-stalls-crowd) */
static void who_cannot_wait_for_the_handshake_finds_it_done(void **state)
{
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    const char *reply;
    (void)state;
    assert_int_equal(apc_link_exchange(c.link, "hello\n", 6, &reply, apc_clock_mono(NULL)), APC_ETIMEDOUT);
    assert_int_equal(ask(&c), 6);
    assert_int_equal(apc_link_connects(c.link), 1);
    assert_int_equal(stats_of(p).accepted, 1);
    assert_int_equal(atomic_load(&p->asked), 1); /* what was not sent in time never is */
    close_client(&c);
    close_plant(p);
}

/* ---- Time goes by -------------------------------------------------------------------------------- */

/*
 * Promise(links/certificate-expires-said): A certificate that expires is said ahead of time, ends no
 *   connection and begins none; a new file is taken up, a broken one is not.
 */
static void what_expires_ends_no_connection_and_begins_none(void **state)
{
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    const apc_ns expiry = apc_identity_expiry(c.identity);
    (void)state;
    assert_true(llabs(expiry - (apc_clock_utc(NULL) + YEAR * APC_NS_PER_S)) < 3600 * APC_NS_PER_S);
    assert_int_equal(ask(&c), 6);
    atomic_store(&clock_offset, 2 * YEAR);
    assert_int_equal(ask(&c), 6);
    assert_int_equal(apc_link_connects(c.link), 1);
    apc_link_reset(c.link);
    assert_int_equal(ask(&c), APC_ECONN);
    assert_has(apc_link_error(c.link), "expired");
    atomic_store(&clock_offset, 0);
    assert_int_equal(ask(&c), 6);
    close_client(&c);
    close_plant(p);
}

/* Promise(links/certificate-expires-said) */
static void a_new_certificate_is_taken_up_and_a_broken_file_is_not(void **state)
{
    struct plant *p = open_plant("ours/plant.pem", PATIENCE);
    struct apc_error why;
    (void)state;
    issue("ours", "client2", ROLE_CLIENT, NULL, -YEAR, -60, true);
    struct client c = open_client("ours/client2.pem", "127.0.0.1", apc_server_port(p->server));
    assert_int_equal(ask(&c), APC_ECONN);
    assert_int_equal(apc_identity_refresh(c.identity, &why), 0);
    issue("ours", "client2", ROLE_CLIENT, NULL, -60, YEAR, true);
    assert_int_equal(apc_identity_refresh(c.identity, &why), 1);
    assert_true(apc_identity_expiry(c.identity) > apc_clock_utc(NULL));
    assert_int_equal(ask(&c), 6);
    FILE *file = fopen(in("ours/client2.pem"), "w");
    fputs("nothing\n", file);
    fclose(file);
    assert_int_equal(apc_identity_refresh(c.identity, &why), APC_EINVAL);
    assert_has(why.text, "private key");
    apc_link_reset(c.link);
    assert_int_equal(ask(&c), 6); /* by what there was */
    assert_int_equal(unlink(in("ours/client2.pem")), 0);
    assert_int_equal(apc_identity_refresh(c.identity, &why), APC_ENOTFOUND);
    issue("ours", "client2", ROLE_CLIENT, NULL, -60, YEAR, false);
    close_client(&c);
    close_plant(p);
}

/* The file of a plant becomes another good identity: whoever commands the plant must get in afterwards too. */
/* Promise(links/certificate-expires-said) */
static void an_identity_that_peers_would_not_take_for_the_same_is_left_alone(void **state)
{
    static const struct {
        const char *file, *said;
    } others[] = {{"ours/client.pem", "it is none of a plant"},
                  {"ours/elsewhere.pem", "it has another name"},
                  {"theirs/plant.pem", "it is of another authority"},
                  {"their-plant.pem", "it is of another authority"},
                  {"any-plant.pem", "it is none of a plant"},
                  {"moved.pem", "it is not of all hosts that it was of"},
                  {"late.pem", "it is not good yet"},
                  {"gone.pem", "it has expired"}};
    struct apc_error why;
    (void)state;
    issue("ours", "plant", ROLE_PLANT, "127.0.0.2", -60, YEAR, true);
    join("moved.pem", (const char *const[]){"ours/plant.pem", NULL});
    issue("ours", "plant", ROLE_PLANT, "127.0.0.1", 3600, YEAR, true);
    join("late.pem", (const char *const[]){"ours/plant.pem", NULL});
    issue("ours", "plant", ROLE_PLANT, "127.0.0.1", -YEAR, -60, true);
    join("gone.pem", (const char *const[]){"ours/plant.pem", NULL});
    issue("ours", "plant", ROLE_PLANT, "127.0.0.1", -60, YEAR, true);
    join("plant-in-use.pem", (const char *const[]){"ours/plant.pem", NULL});
    struct plant *p = open_plant("plant-in-use.pem", PATIENCE);
    struct client c = open_client("ours/client.pem", "127.0.0.1", apc_server_port(p->server));
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        assert_int_equal(unlink(in("plant-in-use.pem")), 0);
        join("plant-in-use.pem", (const char *const[]){others[i].file, NULL});
        for (int k = 0; k < 2; k++) { /* looked at again: it may come into force, or be mended */
            assert_int_equal(apc_identity_refresh(p->identity, &why), APC_EINVAL);
            assert_has(why.text, others[i].said);
        }
        apc_link_reset(c.link);
        assert_int_equal(ask(&c), 6);
    }
    assert_int_equal(unlink(in("plant-in-use.pem")), 0);
    join("plant-in-use.pem", (const char *const[]){"ours/plant.pem", NULL});
    assert_int_equal(apc_identity_refresh(p->identity, &why), 1);
    apc_link_reset(c.link);
    assert_int_equal(ask(&c), 6);
    close_client(&c);
    close_plant(p);
}

/* Both authorities, then the new one's certificate, then the new one alone: nobody is ever shut out. */
/* Promise(links/certificate-expires-said) */
static void an_authority_is_changed_in_three_steps(void **state)
{
    struct apc_error why;
    (void)state;
    join("changing.pem", (const char *const[]){"ours/client.pem", NULL});
    struct apc_identity *identity = load("changing.pem");
    const char *const steps[][3] = {{"ours/client.pem", "theirs/authority.pem", NULL},
                                    {"theirs/client.pem", "ours/authority.pem", NULL},
                                    {"theirs/client.pem", NULL}};
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        assert_int_equal(unlink(in("changing.pem")), 0);
        join("changing.pem", steps[i]);
        assert_int_equal(apc_identity_refresh(identity, &why), 1);
    }
    assert_int_equal(unlink(in("changing.pem")), 0);
    join("changing.pem", steps[0]);
    assert_int_equal(apc_identity_refresh(identity, &why), APC_EINVAL);
    apc_identity_free(identity);
}

/* Promise(links/certificate-expires-said) */
static void an_end_beyond_all_years_is_no_end_and_not_one_of_the_past(void **state)
{
    const time_t now = time(NULL);
    const time_t ends[] = {253402300799, 9223372037, 9223372036};
    const apc_ns expected[] = {INT64_MAX, INT64_MAX, INT64_C(9223372036) * APC_NS_PER_S};
    (void)state;
    issue("endless", "authority-9", ROLE_AUTHORITY, NULL, -YEAR, ends[0] - now, false);
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        struct apc_error why;
        const struct authority_request request = {
            .name = "endless", .role = ROLE_CLIENT, .from = now - 60, .until = ends[i], .replace = i > 0};
        assert_int_equal(authority_issue(in("endless"), &request, &why), 0);
        struct apc_identity *identity = load("endless/endless.pem");
        assert_true(apc_identity_expiry(identity) == expected[i]);
        apc_identity_free(identity);
    }
}

/* ---- Files and options --------------------------------------------------------------------------- */

static void what_is_no_identity_is_refused_with_its_reason(void **state)
{
    static const struct {
        const char *file, *parts[4], *said;
        int rc;
    } cases[] = {
        {"missing", {NULL}, "No such file", APC_ENOTFOUND},
        {"empty", {NULL}, "private key", APC_EINVAL},
        {"no-key", {"ours/authority.pem"}, "private key", APC_EINVAL},
        {"no-certificate", {"ours/authority.key"}, "must hold a certificate", APC_EINVAL},
        {"no-authority", {"ours/authority.key", "ours/authority.pem"}, "must hold", APC_EINVAL},
        {"anothers", {"self/authority.key", "ours/client.pem"}, "the key is not that", APC_EINVAL},
        {"two", {"ours/client.pem", "ours/stranger.pem"}, "of no authority", APC_EINVAL},
        {"password", {"locked.key", "ours/authority.pem"}, "private key", APC_EINVAL}}; /* nobody is asked */
    struct apc_identity *identity;
    struct apc_error why;
    (void)state;
    with_password("locked.key", "ours/authority.key");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        if (strcmp(cases[i].file, "missing") != 0)
            join(cases[i].file, cases[i].parts);
        assert_int_equal(apc_identity_load(&identity, in(cases[i].file), &why), cases[i].rc);
        assert_null(identity);
        assert_has(why.text, cases[i].said);
    }
    assert_int_equal(apc_identity_load(NULL, "file", &why), APC_EINVAL);
    assert_int_equal(apc_identity_load(&identity, NULL, &why), APC_EINVAL);
    apc_identity_free(NULL);
}

static void without_an_identity_or_a_client_there_is_no_tls(void **state)
{
    struct apc_identity *identity = load("ours/plant.pem");
    struct apc_server_options options = {.size = sizeof options};
    struct apc_server *server;
    struct apc_link *link;
    struct apc_error why;
    (void)state;
    assert_int_equal(apc_link_create(&link, "tls:127.0.0.1:80", NULL, &why), APC_EINVAL);
    assert_has(why.text, "apc cert");
    assert_int_equal(apc_server_create(&server, "tls:127.0.0.1:0", &options, echo, NULL, &why), APC_EINVAL);
    assert_has(why.text, "apc cert");
    options.identity = identity;
    assert_int_equal(apc_server_create(&server, "tls:127.0.0.1:0", &options, echo, NULL, &why), APC_EINVAL);
    assert_has(why.text, "names of the clients");
    options.clients = clients;
    options.n_clients = 1;
    assert_int_equal(apc_server_create(&server, "tls:0.0.0.0:0", &options, echo, NULL, &why), 0);
    apc_server_destroy(server);
    assert_int_equal(apc_server_create(&server, "tcp:0.0.0.0:0", &options, echo, NULL, &why), APC_EPERM);
    assert_has(why.text, "listen by tls:");
    const struct apc_link_options asking = {.size = sizeof asking, .identity = identity};
    assert_int_equal(apc_link_create(&link, "tls:127.0.0.1:0", &asking, &why), APC_EINVAL);
    assert_int_equal(apc_link_create(&link, "tls:127.0.0.1", &asking, &why), APC_EINVAL);
    assert_has(why.text, "expected tls:HOST:PORT");
    apc_identity_free(identity);
}

/*
 * Promise(links/apc-cert-makes): What `apc cert` makes is its owner's, whole or not at all, and in the
 *   place of nothing.
 */
static void keys_are_their_owners_and_nothing_is_overwritten(void **state)
{
    static const char *const hosts[] = {"plant", "10.0.0.7", "::1"};
    const time_t now = time(NULL);
    struct authority_request r = {.name = "several",
                                  .role = ROLE_PLANT,
                                  .hosts = hosts,
                                  .n_hosts = 3,
                                  .from = now,
                                  .until = now + YEAR};
    struct authority_certificate c;
    struct apc_error why;
    struct stat at;
    (void)state;
    assert_int_equal(stat(in("ours/authority.key"), &at), 0);
    assert_int_equal(at.st_mode & 0777, 0600);
    assert_int_equal(stat(in("ours/client.pem"), &at), 0);
    assert_int_equal(at.st_mode & 0777, 0600);
    assert_int_equal(authority_issue(in("ours"), &r, &why), 0);
    assert_int_equal(authority_issue(in("ours"), &r, &why), APC_EBUSY);
    assert_int_equal(authority_read(in("ours/several.pem"), &c, &why), 0);
    assert_string_equal(c.name, "several");
    assert_string_equal(c.hosts, "plant 10.0.0.7 ::1");
    assert_int_equal(c.role, ROLE_PLANT);
    assert_int_equal(c.until, now + YEAR);
    assert_int_equal(authority_issue(in("nowhere"), &r, &why), APC_ENOTFOUND);
    r.n_hosts = 0;
    r.name = "another";
    assert_int_equal(authority_issue(in("ours"), &r, &why), APC_EINVAL);
    r.role = ROLE_AUTHORITY;
    assert_int_equal(authority_create(in("ours"), &r, &why), APC_EBUSY);
    r.role = ROLE_CLIENT;
    for (size_t i = 0; i < 6; i++) {
        static const char *const names[] = {"", "../x", "a/b", ".hidden", "authority", "a b"};
        r.name = names[i];
        assert_int_equal(authority_issue(in("ours"), &r, &why), APC_EINVAL);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(who_proves_his_name_is_answered_and_known_by_it),
        cmocka_unit_test_teardown(frames_of_any_size_pass_in_pieces_of_any_size, mend),
        cmocka_unit_test(a_client_with_a_wrong_certificate_never_gets_a_word_in),
        cmocka_unit_test(a_plant_with_a_wrong_certificate_is_never_told_a_word),
        cmocka_unit_test(a_plant_is_known_by_the_name_that_was_asked_for),
        cmocka_unit_test(without_a_certificate_or_with_an_old_protocol_nobody_gets_in),
        cmocka_unit_test(a_plant_of_an_old_protocol_is_refused),
        cmocka_unit_test(a_handshake_that_stalls_ends_and_holds_nobody_up),
        cmocka_unit_test(strangers_cannot_lock_the_client_out),
        cmocka_unit_test(an_exchange_keeps_no_memory_and_takes_small_pieces_only),
        cmocka_unit_test(who_cannot_wait_for_the_handshake_finds_it_done),
        cmocka_unit_test(what_expires_ends_no_connection_and_begins_none),
        cmocka_unit_test(a_new_certificate_is_taken_up_and_a_broken_file_is_not),
        cmocka_unit_test(an_identity_that_peers_would_not_take_for_the_same_is_left_alone),
        cmocka_unit_test(an_authority_is_changed_in_three_steps),
        cmocka_unit_test(an_end_beyond_all_years_is_no_end_and_not_one_of_the_past),
        cmocka_unit_test(what_is_no_identity_is_refused_with_its_reason),
        cmocka_unit_test(without_an_identity_or_a_client_there_is_no_tls),
        cmocka_unit_test(keys_are_their_owners_and_nothing_is_overwritten),
    };
    if (!CRYPTO_set_mem_functions(counted_malloc, counted_realloc, counted_free))
        return 1;
    return cmocka_run_group_tests(tests, make_certificates, remove_certificates);
}
