/* SPDX-License-Identifier: BSD-3-Clause */
/* As many bytes there and back by OpenSSL alone: TLS 1.3, both sides with a certificate, blocking sockets. */
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include <openssl/ssl.h>

#include "apc/admin/authority.h"
#include "link.h"

static void make(const struct keys *keys, const char *name, enum authority_role role)
{
    static const char *const host = "127.0.0.1";
    const struct authority_request request = {.name = name,
                                              .role = role,
                                              .hosts = &host,
                                              .n_hosts = role == ROLE_PLANT,
                                              .from = time(NULL) - 60,
                                              .until = time(NULL) + 24 * 3600};
    struct apc_error why;

    if ((role == ROLE_AUTHORITY ? authority_create(keys->folder, &request, &why)
                                : authority_issue(keys->folder, &request, &why)) < 0)
        die("%s", why.text);
}

void keys_make(struct keys *keys)
{
    struct apc_error why;

    snprintf(keys->folder, sizeof keys->folder, "/tmp/apc-bench-XXXXXX");
    if (!mkdtemp(keys->folder))
        die("cannot make a folder in /tmp");
    make(keys, "bench", ROLE_AUTHORITY);
    make(keys, "plant", ROLE_PLANT);
    make(keys, "client", ROLE_CLIENT);
    snprintf(keys->plant, sizeof keys->plant, "%s/plant.pem", keys->folder);
    snprintf(keys->client, sizeof keys->client, "%s/client.pem", keys->folder);
    if (apc_identity_load(&keys->its, keys->plant, &why) < 0 ||
        apc_identity_load(&keys->ours, keys->client, &why) < 0)
        die("%s", why.text);
}

void keys_drop(struct keys *keys)
{
    static const char *const files[] = {"plant.pem", "client.pem", "authority.pem", "authority.key"};
    char path[64];

    apc_identity_free(keys->its);
    apc_identity_free(keys->ours);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        snprintf(path, sizeof path, "%s/%s", keys->folder, files[i]);
        unlink(path);
    }
    rmdir(keys->folder);
}

struct bare_tls {
    const struct frames *frames;
    const struct keys *keys;
    int listener;
    pthread_t thread;
    SSL_CTX *context;
    SSL *ssl;
};

static SSL_CTX *context_of(const struct keys *keys, bool plant)
{
    const char *file = plant ? keys->plant : keys->client;
    char authority[64];
    SSL_CTX *c = SSL_CTX_new(plant ? TLS_server_method() : TLS_client_method());

    snprintf(authority, sizeof authority, "%s/authority.pem", keys->folder);
    if (!c || !SSL_CTX_set_min_proto_version(c, TLS1_3_VERSION) ||
        SSL_CTX_use_certificate_file(c, file, SSL_FILETYPE_PEM) != 1 ||
        SSL_CTX_use_PrivateKey_file(c, file, SSL_FILETYPE_PEM) != 1 ||
        SSL_CTX_load_verify_locations(c, authority, NULL) != 1)
        die("OpenSSL does not take the certificates");
    SSL_CTX_set_verify(c, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, NULL);
    return c;
}

static bool read_all(SSL *ssl, char *buffer, size_t length)
{
    for (size_t have = 0; have < length;) {
        int n = SSL_read(ssl, buffer + have, (int)(length - have));
        if (n <= 0)
            return false;
        have += (size_t)n;
    }
    return true;
}

static void *serve(void *arg)
{
    struct bare_tls *t = arg;
    const struct frames *f = t->frames;
    char buffer[FRAME_MAX];
    SSL_CTX *context = context_of(t->keys, true);
    SSL *ssl = SSL_new(context);
    int fd = accept_tuned(t->listener);

    SSL_set_fd(ssl, fd);
    if (SSL_accept(ssl) != 1)
        die("OpenSSL's own handshake failed");
    while (read_all(ssl, buffer, f->request_length) && SSL_write(ssl, f->reply, (int)f->reply_length) > 0)
        ;
    SSL_free(ssl);
    SSL_CTX_free(context);
    close(fd);
    return NULL;
}

struct bare_tls *bare_tls_open(const struct frames *frames, const struct keys *keys)
{
    struct bare_tls *t = allocate(1, sizeof *t);
    struct sockaddr_in at;

    t->frames = frames;
    t->keys = keys;
    t->listener = listen_somewhere(&at);
    if (pthread_create(&t->thread, NULL, serve, t) != 0)
        die("cannot start a thread");
    t->context = context_of(keys, false);
    t->ssl = SSL_new(t->context);
    SSL_set_fd(t->ssl, connect_to(&at));
    if (SSL_connect(t->ssl) != 1)
        die("OpenSSL's own handshake failed");
    return t;
}

void bare_tls_once(void *ctx)
{
    struct bare_tls *t = ctx;
    char buffer[FRAME_MAX];

    if (SSL_write(t->ssl, t->frames->request, (int)t->frames->request_length) <= 0 ||
        !read_all(t->ssl, buffer, t->frames->reply_length))
        die("the bare TLS connection broke");
}

void bare_tls_close(struct bare_tls *t)
{
    close(SSL_get_fd(t->ssl));
    pthread_join(t->thread, NULL);
    SSL_free(t->ssl);
    SSL_CTX_free(t->context);
    close(t->listener);
    free(t);
}
