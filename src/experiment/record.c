/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <openssl/evp.h>

#include "files/settings.h"

int record_hash(const char *path, char hash[RECORD_HASH_LEN], struct apc_error *why)
{
    unsigned char block[8192], digest[EVP_MAX_MD_SIZE];
    unsigned length = 0;
    FILE *in = fopen(path, "re");
    EVP_MD_CTX *sha = in ? EVP_MD_CTX_new() : NULL;
    bool ok = sha && EVP_DigestInit_ex(sha, EVP_sha256(), NULL) == 1;
    size_t n;

    errno = in ? ENOMEM : errno;
    while (ok && (n = fread(block, 1, sizeof block, in)) > 0)
        ok = EVP_DigestUpdate(sha, block, n) == 1;
    ok = ok && !ferror(in) && EVP_DigestFinal_ex(sha, digest, &length) == 1;
    if (!ok)
        apc_fail(why, APC_ESYS, "%s: cannot be read: %s", path, strerror(errno));
    for (unsigned i = 0; ok && i < length; i++)
        snprintf(hash + (size_t)2 * i, 3, "%02x", digest[i]);
    EVP_MD_CTX_free(sha);
    if (in)
        fclose(in);
    return ok ? 0 : APC_ESYS;
}

/* Is the file still the one that ran? */
static void check_hash(struct settings *s, const config_setting_t *in, const char *path)
{
    char wanted[RECORD_HASH_LEN] = "", hash[RECORD_HASH_LEN];
    struct apc_error why;
    settings_text(s, in, "sha256", REQUIRED, wanted, sizeof wanted);
    if (s->failed)
        return;
    if (record_hash(path, hash, &why) < 0)
        settings_fail(s, in, "%s", why.text);
    else if (strcmp(hash, wanted) != 0)
        settings_fail(
            s, in,
            "%s is not the file that ran: its SHA-256 is no longer the recorded one; to work on it, "
            "copy it out of the run folder",
            path);
}

static void read_plugin(struct settings *s, const config_setting_t *group, const char *dir,
                        struct record_plugin *plugin)
{
    static const char *const known[] = {"name", "chosen", "file", "from", "sha256", NULL};
    char file[RECORD_LAW_LEN] = "";
    if (!group || s->failed)
        return;
    settings_known(s, group, known);
    settings_flag(s, group, "chosen", &plugin->chosen);
    settings_text(s, group, "name", REQUIRED, plugin->name, sizeof plugin->name);
    settings_text(s, group, "file", OPTIONAL, file, sizeof file);
    if (s->failed || !*file)
        return;
    if (strchr(file, '/'))
        settings_fail(s, group, "\"file\" is \"%s\": must lie in the run folder", file);
    snprintf(plugin->name, sizeof plugin->name, "%.440s%s", dir, file);
    check_hash(s, group, plugin->name);
}

/* Of one controller a group, of several a list of groups. */
static void read_recorded_laws(struct settings *s, const config_setting_t *root, const char *dir,
                               struct record *r)
{
    const config_setting_t *list = settings_list(s, root, "laws", OPTIONAL);
    const size_t n = list ? (size_t)config_setting_length(list) : 1;
    r->law = calloc(n + 1, sizeof *r->law);
    if (!r->law && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    for (; r->n_laws < n && !s->failed; r->n_laws++) {
        const config_setting_t *group = list ? config_setting_get_elem(list, (unsigned)r->n_laws)
                                             : settings_group(s, root, "law", REQUIRED);
        if (group && !config_setting_is_group(group))
            settings_fail(s, group, "expected a group: { name = \"...\"; ... }");
        read_plugin(s, group, dir, &r->law[r->n_laws]);
    }
}

void record_free(struct record *r)
{
    free(r->law);
    *r = (struct record){0};
}

static void read_record_file(struct settings *s, const config_setting_t *root, const char *dir,
                             const char *file, struct record *r)
{
    int64_t seed = 0;
    double ended = 0;
    char start[APC_TIME_LEN] = "";
    settings_text(s, root, "start", OPTIONAL, start, sizeof start);
    if (!s->failed && *start && apc_time_parse(start, &r->start) < 0)
        settings_fail(s, config_setting_get_member(root, "start"), "\"start\" is \"%s\": must be a time",
                      start);
    settings_number(s, root, "duration", REQUIRED, 0, 366 * 86400.0, &r->duration);
    settings_number(s, root, "ended", OPTIONAL, 0, 1e9, &ended);
    settings_number(s, root, "past", OPTIONAL, 0, 366 * 86400.0, &r->past);
    settings_whole(s, root, "seed", REQUIRED, INT64_MIN + 1, INT64_MAX, &seed);
    settings_text(s, root, "net", OPTIONAL, r->net, sizeof r->net);
    const config_setting_t *experiment = settings_group(s, root, "experiment", REQUIRED);
    if (experiment)
        check_hash(s, experiment, file);
    read_recorded_laws(s, root, dir, r);
    read_plugin(s, settings_group(s, root, "plant", REQUIRED), dir, &r->model);
    r->seed = (uint64_t)seed; /* one above 2^63 stands there as the negative number of the same bits */
    r->duration = ended > 0 ? ended : r->duration;
}

int record_read(struct record *r, const char *file, struct apc_error *why)
{
    char path[600], dir[600] = "./";
    const char *slash = strrchr(file, '/');
    struct settings s = {.file = path, .why = why};
    config_t config;

    *r = (struct record){0};
    if (strcmp(slash ? slash + 1 : file, "run.conf") != 0)
        return 0;
    if (slash)
        snprintf(dir, sizeof dir, "%.*s", (int)(slash + 1 - file), file);
    snprintf(path, sizeof path, "%.580s" RECORD_FILE, dir);
    if (access(path, F_OK) != 0)
        return 0;
    s.failed = settings_load(&config, path, why);
    if (!s.failed)
        read_record_file(&s, config_root_setting(&config), dir, file, r);
    config_destroy(&config);
    r->there = s.failed == 0;
    return s.failed;
}

bool experiment_run_dir(const struct experiment *e, char dir[EXPERIMENT_PATH])
{
    const char *slash = strrchr(e->file, '/'), *name = slash ? slash + 1 : e->file;
    snprintf(dir, EXPERIMENT_PATH, "%.*s", slash ? (int)(slash - e->file) : 1, slash ? e->file : ".");
    return !strcmp(name, "run.conf");
}

/* The record of the run folder @p dir; config_destroy() in either case. */
static int load_record(struct settings *s, config_t *config, char path[600], const char *dir)
{
    snprintf(path, 600, "%.580s/" RECORD_FILE, dir);
    if (access(path, F_OK) == 0)
        return s->failed = settings_load(config, path, s->why);
    config_init(config);
    return s->failed =
               apc_fail(s->why, APC_ENOTFOUND, "%s: there is none, so %s is no run folder", path, dir);
}

int record_stores(struct record_stores *stores, const char *dir, struct apc_error *why)
{
    char path[600];
    struct settings s = {.file = path, .why = why};
    config_t config;

    *stores = (struct record_stores){0};
    if (load_record(&s, &config, path, dir) == 0) {
        const config_setting_t *root = config_root_setting(&config);
        settings_text(&s, root, "live", OPTIONAL, stores->live, sizeof stores->live);
        settings_text(&s, root, "store", OPTIONAL, stores->history, sizeof stores->history);
    }
    config_destroy(&config);
    return s.failed;
}

void record_build_here(struct record_build *build)
{
    struct utsname machine;
    snprintf(build->libapc, sizeof build->libapc, "%s", apc_version());
    snprintf(build->cvode, sizeof build->cvode, "%s", APC_CVODE_VERSION);
    snprintf(build->machine, sizeof build->machine, "%.31s", uname(&machine) == 0 ? machine.machine : "");
}

int record_build(struct record_build *build, const char *dir, struct apc_error *why)
{
    char path[600];
    struct settings s = {.file = path, .why = why};
    config_t config;

    *build = (struct record_build){0};
    if (load_record(&s, &config, path, dir) == 0) {
        const config_setting_t *root = config_root_setting(&config);
        settings_text(&s, root, "version", OPTIONAL, build->libapc, sizeof build->libapc);
        settings_text(&s, root, "cvode", OPTIONAL, build->cvode, sizeof build->cvode);
        settings_text(&s, root, "machine", OPTIONAL, build->machine, sizeof build->machine);
    }
    config_destroy(&config);
    return s.failed;
}

int experiment_read(const char *name, char path[EXPERIMENT_PATH], struct record *record, char **text,
                    struct apc_error *why)
{
    struct stat at;
    const bool folder = stat(name, &at) == 0 && S_ISDIR(at.st_mode);
    snprintf(path, EXPERIMENT_PATH, folder ? "%.500s/run.conf" : "%.510s", name);
    int rc = record_read(record, path, why);
    if (rc == 0 && folder && access(path, F_OK) != 0)
        rc = apc_fail(why, APC_ENOTFOUND, "%s is no run folder: it has no run.conf", name);
    if (rc == 0 && access(path, F_OK) != 0 && errno == ENOENT)
        rc = apc_fail(why, APC_ENOTFOUND,
                      "%s: there is no such file or folder: expected an experiment file or a run folder",
                      name);
    return rc == 0 ? settings_read(path, text, why) : rc;
}
