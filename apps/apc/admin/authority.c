/* SPDX-License-Identifier: BSD-3-Clause */
#include "authority.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <openssl/bn.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#define PATH_LEN    4096
#define SERIAL_BITS 159 /* RFC 5280: no more than 20 octets, and positive */
#define LETTERS     "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789"

static bool is_name(const char *name)
{
    const size_t n = strlen(name);
    return n > 0 && n < AUTHORITY_NAME_LEN && strspn(name, LETTERS "._-") == n && strspn(name, "._-") == 0;
}

/* "DNS:plant,IP:10.0.0.1", as OpenSSL reads it: what stands in it was looked at. */
static int host_list(const struct authority_request *r, char *list, size_t size, struct apc_error *why)
{
    size_t used = 0;

    *list = '\0';
    for (size_t i = 0; i < r->n_hosts; i++) {
        struct in6_addr any;
        const char *host = r->hosts[i];
        const bool address = inet_pton(AF_INET, host, &any) == 1 || inet_pton(AF_INET6, host, &any) == 1;

        if (!address && (!*host || strspn(host, LETTERS "._-") != strlen(host)))
            return apc_fail(why, APC_EINVAL, "\"%s\" is neither an address nor a host name", host);
        used +=
            (size_t)snprintf(list + used, size - used, "%s%s:%s", i ? "," : "", address ? "IP" : "DNS", host);
        if (used >= size)
            return apc_fail(why, APC_EINVAL, "the hosts are more than fit into a certificate here");
    }
    return 0;
}

static int check_authority_request(const struct authority_request *r, struct apc_error *why)
{
    if (!is_name(r->name))
        return apc_fail(why, APC_EINVAL,
                        "\"%.70s\" is no name: 1 to %d letters, digits, and within them . _ -", r->name,
                        AUTHORITY_NAME_LEN - 1);
    if (r->role != ROLE_AUTHORITY && !strcmp(r->name, "authority"))
        return apc_fail(why, APC_EINVAL, "\"authority\" is the authority's own name: take another");
    if (r->role == ROLE_PLANT && !r->n_hosts)
        return apc_fail(why, APC_EINVAL,
                        "a plant's certificate names its hosts: give its host name or address by --host, as "
                        "in tls:HOST:PORT");
    return 0;
}

/* ---- Certificates -------------------------------------------------------------------------- */

static bool extend(X509 *x, X509 *issuer, int kind, const char *value)
{
    X509V3_CTX ctx;
    X509_EXTENSION *e;
    bool ok;

    X509V3_set_ctx(&ctx, issuer, x, NULL, NULL, 0);
    X509V3_set_ctx_nodb(&ctx);
    e = X509V3_EXT_conf_nid(NULL, &ctx, kind, value);
    ok = e && X509_add_ext(x, e, -1);
    X509_EXTENSION_free(e);
    return ok;
}

static bool describe_certificate(X509 *x, X509 *issuer, enum authority_role role, const char *hosts)
{
    if (role == ROLE_AUTHORITY)
        return extend(x, issuer, NID_basic_constraints, "critical,CA:TRUE,pathlen:0") &&
               extend(x, issuer, NID_key_usage, "critical,keyCertSign,cRLSign") &&
               extend(x, issuer, NID_subject_key_identifier, "hash");
    return extend(x, issuer, NID_basic_constraints, "critical,CA:FALSE") &&
           extend(x, issuer, NID_key_usage, "critical,digitalSignature") &&
           extend(x, issuer, NID_ext_key_usage, role == ROLE_PLANT ? "serverAuth" : "clientAuth") &&
           extend(x, issuer, NID_subject_key_identifier, "hash") &&
           extend(x, issuer, NID_authority_key_identifier, "keyid:always") &&
           (!*hosts || extend(x, issuer, NID_subject_alt_name, hosts));
}

static bool set_serial_number(X509 *x)
{
    BIGNUM *n = BN_new();
    bool ok = n && BN_rand(n, SERIAL_BITS, BN_RAND_TOP_ANY, BN_RAND_BOTTOM_ANY) &&
              BN_to_ASN1_INTEGER(n, X509_get_serialNumber(x));
    BN_free(n);
    return ok;
}

/* @p issuer NULL: by itself. */
static X509 *certify(const struct authority_request *r, const char *hosts, EVP_PKEY *key, X509 *issuer,
                     EVP_PKEY *by)
{
    X509 *x = X509_new();
    X509_NAME *name = x ? X509_get_subject_name(x) : NULL;

    if (x && X509_set_version(x, 2) && set_serial_number(x) && X509_set_pubkey(x, key) &&
        X509_NAME_add_entry_by_NID(name, NID_commonName, MBSTRING_UTF8, (const unsigned char *)r->name, -1,
                                   -1, 0) &&
        X509_set_issuer_name(x, issuer ? X509_get_subject_name(issuer) : name) &&
        ASN1_TIME_set(X509_getm_notBefore(x), r->from) && ASN1_TIME_set(X509_getm_notAfter(x), r->until) &&
        describe_certificate(x, issuer ? issuer : x, r->role, hosts) && X509_sign(x, by, EVP_sha256()))
        return x;
    X509_free(x);
    return NULL;
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* A file beside @p path becomes it when all is in it and on the disk. @p key, @p own and @p above: NULL: not. */
static int write_certificate(const char *path, EVP_PKEY *key, X509 *own, X509 *above, bool replace,
                             struct apc_error *why)
{
    char part[PATH_LEN];
    FILE *file = NULL;
    int fd = -1, failed = 0;

    if (snprintf(part, sizeof part, "%s.XXXXXX", path) >= (int)sizeof part ||
        (fd = mkostemp(part, O_CLOEXEC)) < 0)
        return apc_fail(why, APC_ESYS, "cannot write \"%s\": %s", path, strerrordesc_np(errno));
    file = fdopen(fd, "w");
    if (!file)
        close(fd);
    if (!file || (!key && fchmod(fd, 0644) < 0) ||
        (key && !PEM_write_PKCS8PrivateKey(file, key, NULL, NULL, 0, NULL, NULL)) ||
        (own && !PEM_write_X509(file, own)) || (above && !PEM_write_X509(file, above)) || fflush(file) != 0 ||
        fsync(fileno(file)) < 0)
        failed = errno ? errno : EIO;
    if (file && fclose(file) != 0 && !failed)
        failed = errno;
    /* link() does not take the place of a file that is there. */
    if (!failed && (replace ? rename(part, path) : link(part, path)) < 0)
        failed = errno;
    if (failed || !replace)
        (void)unlink(part);
    if (failed == EEXIST)
        return apc_fail(why, APC_EBUSY, "\"%s\" is there already", path);
    return failed ? apc_fail(why, APC_ESYS, "cannot write \"%s\": %s", path, strerrordesc_np(failed)) : 0;
}

static int path_in_authority(char path[PATH_LEN], const char *folder, const char *name, struct apc_error *why)
{
    return snprintf(path, PATH_LEN, "%s/%s", folder, name) < PATH_LEN - 8
               ? 0
               : apc_fail(why, APC_EINVAL, "\"%.100s...\" is too long for the path of a folder", folder);
}

static int read_authority(const char *folder, X509 **x, EVP_PKEY **key, struct apc_error *why)
{
    char path[PATH_LEN];
    FILE *file;
    int rc = path_in_authority(path, folder, "authority.pem", why);

    *x = NULL;
    *key = NULL;
    if (rc < 0)
        return rc;
    if ((file = fopen(path, "re"))) {
        *x = PEM_read_X509(file, NULL, NULL, NULL);
        fclose(file);
        memcpy(strrchr(path, '.'), ".key", 5);
        if (*x && (file = fopen(path, "re"))) {
            *key = PEM_read_PrivateKey(file, NULL, NULL, NULL);
            fclose(file);
        }
    }
    if (*key && X509_check_private_key(*x, *key))
        return 0;
    return apc_fail(
        why, APC_ENOTFOUND,
        "there is no authority in \"%s\" whose authority.pem and authority.key can be read: `apc cert "
        "authority` makes one",
        folder);
}

static int no_openssl(struct apc_error *why)
{
    const char *text = ERR_reason_error_string(ERR_peek_last_error());
    return apc_fail(why, APC_ESYS, "OpenSSL cannot make it: %s", text ? text : "no reason given");
}

int authority_create(const char *folder, const struct authority_request *r, struct apc_error *why)
{
    char path[PATH_LEN];
    EVP_PKEY *key = NULL;
    X509 *x = NULL;
    int rc = check_authority_request(r, why);

    if (rc == 0)
        rc = path_in_authority(path, folder, "authority.key", why);
    if (rc == 0 && mkdir(folder, 0755) < 0 && errno != EEXIST)
        rc = apc_fail(why, APC_ESYS, "cannot make the folder \"%s\": %s", folder, strerrordesc_np(errno));
    if (rc < 0)
        return rc;
    key = EVP_EC_gen("P-256");
    x = key ? certify(r, "", key, NULL, key) : NULL;
    rc = x ? write_certificate(path, key, NULL, NULL, false, why) : no_openssl(why);
    if (rc == 0) { /* the key first: whoever has that has the authority */
        memcpy(strrchr(path, '.'), ".pem", 5);
        rc = write_certificate(path, NULL, x, NULL, true, why);
    }
    X509_free(x);
    EVP_PKEY_free(key);
    return rc;
}

int authority_issue(const char *folder, const struct authority_request *r, struct apc_error *why)
{
    char path[PATH_LEN], name[AUTHORITY_NAME_LEN + 4], hosts[256];
    EVP_PKEY *by = NULL, *key = NULL;
    X509 *authority = NULL, *x = NULL;
    int rc = check_authority_request(r, why);

    if (rc == 0)
        rc = host_list(r, hosts, sizeof hosts, why);
    if (rc == 0)
        rc = read_authority(folder, &authority, &by, why);
    if (rc == 0) {
        snprintf(name, sizeof name, "%s.pem", r->name);
        rc = path_in_authority(path, folder, name, why);
    }
    if (rc == 0) {
        key = EVP_EC_gen("P-256");
        x = key ? certify(r, hosts, key, authority, by) : NULL;
        rc = x ? write_certificate(path, key, x, authority, r->replace, why) : no_openssl(why);
    }
    X509_free(x);
    X509_free(authority);
    EVP_PKEY_free(key);
    EVP_PKEY_free(by);
    return rc;
}

/* ---- To show ----------------------------------------------------------------------------------- */

static time_t time_of(const ASN1_TIME *time)
{
    struct tm tm;
    return ASN1_TIME_to_tm(time, &tm) ? timegm(&tm) : 0;
}

static void list_hosts(X509 *x, char *list, size_t size)
{
    GENERAL_NAMES *names = X509_get_ext_d2i(x, NID_subject_alt_name, NULL, NULL);
    size_t used = 0;

    *list = '\0';
    for (int i = 0; i < sk_GENERAL_NAME_num(names); i++) {
        int kind;
        char text[INET6_ADDRSTRLEN] = "?";
        const ASN1_STRING *value = GENERAL_NAME_get0_value(sk_GENERAL_NAME_value(names, i), &kind);
        const int length = kind == GEN_DNS || kind == GEN_IPADD ? ASN1_STRING_length(value) : 0;

        if (kind == GEN_IPADD && (length == 4 || length == 16))
            inet_ntop(length == 4 ? AF_INET : AF_INET6, ASN1_STRING_get0_data(value), text, sizeof text);
        used += (size_t)snprintf(list + used, size - used, "%s%.*s", i ? " " : "",
                                 kind == GEN_DNS ? length : (int)strlen(text),
                                 kind == GEN_DNS ? (const char *)ASN1_STRING_get0_data(value) : text);
        if (used >= size)
            break;
    }
    GENERAL_NAMES_free(names);
}

int authority_read(const char *path, struct authority_certificate *out, struct apc_error *why)
{
    FILE *file = fopen(path, "re");
    X509 *x = file ? PEM_read_X509(file, NULL, NULL, NULL) : NULL;

    if (file)
        fclose(file);
    if (!x)
        return apc_fail(why, APC_ENOTFOUND, "\"%s\": %s", path,
                        file ? "there is no certificate in it" : strerrordesc_np(errno));
    *out = (struct authority_certificate){.from = time_of(X509_get0_notBefore(x)),
                                          .until = time_of(X509_get0_notAfter(x))};
    X509_NAME_get_text_by_NID(X509_get_subject_name(x), NID_commonName, out->name, sizeof out->name);
    list_hosts(x, out->hosts, sizeof out->hosts);
    const uint32_t use = X509_get_extended_key_usage(x);
    if (X509_check_ca(x) > 0)
        out->role = ROLE_AUTHORITY;
    else if (use != UINT32_MAX && use & XKU_SSL_SERVER)
        out->role = ROLE_PLANT;
    else if (use != UINT32_MAX && use & XKU_SSL_CLIENT)
        out->role = ROLE_CLIENT;
    X509_free(x);
    return 0;
}
