/* SPDX-License-Identifier: BSD-3-Clause */
/* apc cert: a small authority, and the certificates of a plant and its clients for tls:. */
#include <dirent.h>
#include <stdlib.h>
#include <string.h>

#include "apc/common/cli.h"
#include "authority.h"
#include "base/text.h"

#define DAYS           825
#define AUTHORITY_DAYS 3650
#define DAYS_MAX       36500
#define DAY            (24 * 3600L)
#define EARLIER        300 /* s: clocks differ */
#define HOSTS_MAX      32

struct options {
    const char *folder;
    const char *hosts[HOSTS_MAX];
    size_t n_hosts;
    uint64_t days; /* 0: not given */
    bool replace;
};

static void take_host(void *options, char *arg, const struct argp_state *state)
{
    struct options *o = options;
    if (o->n_hosts == HOSTS_MAX)
        argp_error(state, "--host may be given %d times at most", HOSTS_MAX);
    o->hosts[o->n_hosts++] = arg;
}

#define AT(member) .to = offsetof(struct options, member)
static const struct option_spec own_options[] = {
    {"dir", 0, "DIR", "Folder of the authority and of the identities [APC_CERTS]; default certs", OPTION_TEXT,
     AT(folder), .must = "name a folder"},
    {"host", 0, "HOST",
     "plant: a name or address at which clients reach it, as in tls:HOST:PORT; may be repeated", OPTION_OWN,
     .take = take_host},
    {"days", 0, "N", "Validity in days; default 825, of an authority 3650", OPTION_WHOLE, AT(days), .low = 1,
     .high = DAYS_MAX, .must = "be a whole number, 1 to 36500"},
    {"replace", 0, NULL, "Renew an existing certificate, for instance because it expires", OPTION_FLAG,
     AT(replace)},
    {0},
};

static const struct cli_spec spec = {
    .args_doc = "authority [NAME] | plant NAME --host HOST | client NAME | list",
    .doc =
        "Make the certificates of a link tls:HOST:PORT. `authority` makes, once, a certificate authority of "
        "your own in a folder: authority.pem, and its private key authority.key, which stays there. `plant` "
        "and `client` make an identity, DIR/NAME.pem: a private key, its certificate, and that of the "
        "authority. apc-plant and apc-client take this file (--identity). A plant is known by its address "
        "(--host), a client by its name: apc-plant takes commands from the names of its --client options, "
        "and rejects all others. `list` shows all identities, and how long each is valid. Files with a key "
        "are readable by their owner only (0600). Copy each to its computer over a secure channel, and keep "
        "the authority's key off both. Daemons load a renewed identity (--replace) by themselves.",
    .takes = 0,
    .min_args = 1,
    .max_args = 2,
    .options = own_options,
};

static int make_certificate(const struct cli *cli, const struct options *o, enum authority_role role,
                            const char *name)
{
    const long days = o->days ? (long)o->days : role == ROLE_AUTHORITY ? AUTHORITY_DAYS : DAYS;
    const time_t now = time(NULL);
    const struct authority_request request = {.name = name,
                                              .role = role,
                                              .hosts = o->hosts,
                                              .n_hosts = o->n_hosts,
                                              .from = now - EARLIER,
                                              .until = now + days * DAY,
                                              .replace = o->replace};
    struct apc_error why;
    int rc = role == ROLE_AUTHORITY ? authority_create(o->folder, &request, &why)
                                    : authority_issue(o->folder, &request, &why);

    if (rc < 0)
        return cli_error(
            cli, rc, "%s%s", why.text,
            rc != APC_EBUSY ? ""
            : role == ROLE_AUTHORITY
                ? "; the certificates it has signed would become invalid: take another folder, or remove it"
                : "; --replace renews it");
    printf("%s/%s.pem made, valid for %ld day%s\n", o->folder, role == ROLE_AUTHORITY ? "authority" : name,
           days, PLURAL(days));
    return EXIT_OK;
}

static void show_certificate(const struct authority_certificate *c)
{
    static const char *const roles[] = {"other", "authority", "plant", "client"};
    const time_t now = time(NULL);
    const long days = (long)(c->until - now + DAY / 2) / DAY;
    struct tm tm;
    char until[32] = "";

    if (gmtime_r(&c->until, &tm))
        strftime(until, sizeof until, "%Y-%m-%d", &tm);
    printf("%-20s  %-9s  until %s", c->name, roles[c->role], until);
    if (c->until <= now)
        printf("  EXPIRED");
    else if (c->from > now)
        printf("  NOT YET GOOD");
    else
        printf("  %ld day%s", days, PLURAL(days));
    printf("%s%s\n", *c->hosts ? "  " : "", c->hosts);
}

static int is_certificate(const struct dirent *entry)
{
    const char *dot = strrchr(entry->d_name, '.');
    return dot && dot != entry->d_name && !strcmp(dot, ".pem");
}

static int list_certificates(const struct cli *cli, const struct options *o)
{
    struct dirent **entry;
    int n = scandir(o->folder, &entry, is_certificate, alphasort), status = EXIT_OK;

    if (n < 0)
        return cli_error(cli, APC_ENOTFOUND, "there is no folder \"%s\": `apc cert authority` makes one",
                         o->folder);
    for (int i = 0; i < n; i++) {
        struct authority_certificate c;
        struct apc_error why;
        char path[4096];

        snprintf(path, sizeof path, "%s/%s", o->folder, entry[i]->d_name);
        int rc = authority_read(path, &c, &why);
        if (rc < 0)
            status = cli_error(cli, rc, "%s", why.text);
        else
            show_certificate(&c);
        free(entry[i]);
    }
    free(entry);
    return cli_done(cli, status);
}

int command_cert(int argc, char **argv)
{
    struct options o = {.folder = getenv("APC_CERTS")};
    struct cli cli;

    if (!o.folder || !*o.folder)
        o.folder = "certs";
    cli_parse(&cli, &spec, &o, argc, argv);
    const char *what = cli.args[0], *name = cli.n_args > 1 ? cli.args[1] : NULL;
    const bool plant = !strcmp(what, "plant");

    if (!plant && o.n_hosts)
        return cli_usage(&cli, "--host goes with a plant: apc cert plant NAME --host HOST");
    if (!strcmp(what, "list") && !name)
        return list_certificates(&cli, &o);
    if (!strcmp(what, "authority") && !o.replace)
        return make_certificate(&cli, &o, ROLE_AUTHORITY, name ? name : "apc-authority");
    if ((plant || !strcmp(what, "client")) && name)
        return make_certificate(&cli, &o, plant ? ROLE_PLANT : ROLE_CLIENT, name);
    return cli_usage(
        &cli, "\"%s%s%s\": must be authority (which is never replaced), plant NAME, client NAME or list",
        what, name ? " " : "", name ? name : "");
}
