/* SPDX-License-Identifier: BSD-3-Clause */
/* An experiment with settings of the command line, over those of its file. */
#include "experiment_parts.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "experiment.h"
#include "files/files.h"

char *setting_equals(const char *text)
{
    bool quoted = false;
    for (const char *c = text; *c; c++) {
        if (*c == '\'' && (quoted || c == text || c[-1] == '.'))
            quoted = !quoted;
        else if (quoted && *c == '\\' && c[1])
            c++;
        else if (!quoted && *c == '=')
            return (char *)(uintptr_t)c;
    }
    return quoted ? strchr(text, '=') : NULL; /* it was no name in quotes */
}

void experiment_forget(struct record *record, const char *path)
{
    if (!strcmp(path, "duration"))
        record->duration = (double)NAN;
    else if (!strcmp(path, "seed"))
        record->file_seed = true;
    else if (!strcmp(path, "controller.law"))
        record->n_laws = 0;
    else if (!strcmp(path, "plant.model"))
        record->model = (struct record_plugin){.chosen = false};
}

/* What of @path comes after @group and a dot; NULL: it lies elsewhere. */
static const char *below(const char *path, const char *group)
{
    const size_t n = strlen(group);
    return !strncmp(path, group, n) && path[n] == '.' ? path + n + 1 : NULL;
}

static bool begins_with_any(const char *path, const char *const *names)
{
    for (; *names; names++) {
        const size_t n = strlen(*names);
        if (!strncmp(path, *names, n) && (!path[n] || path[n] == '.'))
            return true;
    }
    return false;
}

/* Of a law or model that is not the file's: what is set would be passed over without a word. */
static int check_effect(const struct experiment *e, const char *path, struct apc_error *why)
{
    static const char *const of_model[] = {"parameters", "x0", "noise", "disturbances", "faults", NULL};
    static const char *const of_law[] = {"tuning", "measurement_tuning", "settings", "model", "limits", "law",
                                         NULL};
    const char *rest = below(path, "plant");
    if (rest && e->plant.plugin.chosen && begins_with_any(rest, of_model))
        return apc_fail(why, APC_EINVAL,
                        "%s: is of the file's model, and another one was chosen, which has its own", path);
    for (size_t i = 0; i < e->n_controllers; i++) {
        const struct controller *c = &e->controllers[i];
        char list[APC_TAG_LEN + 16], place[40];
        snprintf(list, sizeof list, "controllers.%s", c->name);
        snprintf(place, sizeof place, "controllers.[%zu]", i);
        rest = below(path, list);
        if (!rest)
            rest = below(path, place);
        if (!rest && e->n_controllers == 1)
            rest = below(path, "controller");
        if (rest && c->plugin.chosen &&
            (begins_with_any(rest, of_law) || !experiment_knows_of_controller(rest)))
            return apc_fail(why, APC_EINVAL,
                            "%s: is of the file's law, and another one was chosen, which has its own", path);
    }
    return 0;
}

/* A path may end in a former name where the file has the present one. */
static void note_former(struct experiment *e, const char *path)
{
    const char *dot = strrchr(path, '.'), *name = dot ? dot + 1 : path;
    for (size_t i = 0; i < e->n_controllers; i++)
        if (experiment_is_former(&e->controllers[i], name))
            e->controllers[i].former = former_of(former_name(name));
}

static void list_overrides(const struct experiment_overrides *o, char *text, size_t size)
{
    size_t used = 0;
    *text = '\0';
    if (o->model_file)
        used = (size_t)snprintf(text, size, "--model %.150s%s", o->model_file, o->n_set ? ", " : "");
    for (size_t i = 0; i < o->n_set && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%.120s = %.70s", i ? ", " : "", o->set[i].path,
                                 o->set[i].value);
}

/* What stands before the "=" of [CONTROLLER=]FILE; the first controller where nothing does. */
static const char *split_controller_name(const char *wanted, char controller[APC_TAG_LEN])
{
    const char *equals = strchr(wanted, '=');
    const size_t n = equals ? (size_t)(equals - wanted) : 0;

    if (!equals || n >= APC_TAG_LEN || memchr(wanted, '/', n)) {
        snprintf(controller, APC_TAG_LEN, "[0]");
        return wanted;
    }
    snprintf(controller, APC_TAG_LEN, "%.*s", (int)n, wanted);
    return equals + 1;
}

static int change_model(const char *text, const char *wanted, char **next, struct apc_error *why)
{
    char controller[APC_TAG_LEN];
    const char *file = split_controller_name(wanted, controller);
    char *path = realpath(file, NULL);
    int rc = path ? experiment_change_model(text, controller, path, next, why)
                  : apc_fail(why, APC_ENOTFOUND, "--model %s: %s", file, strerror(errno));

    free(path);
    return rc;
}

static int check_model_override(const struct experiment *e, const char *wanted, struct apc_error *why)
{
    char controller[APC_TAG_LEN], path[APC_TAG_LEN + 32];

    split_controller_name(wanted, controller);
    if (*controller == '[' && e->n_controllers > 1)
        return apc_fail(why, APC_EINVAL, "--model %s: there are %zu controllers: say whose it is, as %s=%s",
                        wanted, e->n_controllers, e->controllers->name, wanted);
    snprintf(path, sizeof path, "controllers.%s.model", controller);
    return check_effect(e, path, why);
}

int experiment_parse_changed(struct experiment *e, const struct experiment_source *from, unsigned parts,
                             const struct experiment_overrides *overrides, struct apc_error *why)
{
    char said[200], *text = strdup(from->text), *next;
    struct record record = from->record ? *from->record : (struct record){.there = false};
    struct experiment_source changed = *from;
    struct apc_error of_file;
    int rc = text ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");

    if (overrides->model_file && rc == 0) {
        rc = change_model(text, overrides->model_file, &next, why);
        if (rc == 0) {
            free(text);
            text = next;
        }
    }
    for (size_t i = 0; i < overrides->n_set && rc == 0; i++) {
        rc = experiment_change(text, overrides->set[i].path, overrides->set[i].value, &next, why);
        if (rc < 0)
            break;
        experiment_forget(&record, overrides->set[i].path);
        free(text);
        text = next;
    }
    list_overrides(overrides, said, sizeof said);
    changed.text = text;
    changed.change = said;
    changed.record = &record;
    if (rc == 0 && (rc = experiment_parse(e, &changed, parts, overrides, why)) < 0 &&
        !overrides->model_file && experiment_parse(e, from, parts, overrides, &of_file) < 0)
        *why = of_file; /* it was so before */
    else if (rc < 0)
        experiment_free(e);
    if (overrides->model_file && rc == 0 && (rc = check_model_override(e, overrides->model_file, why)) < 0)
        experiment_free(e);
    for (size_t i = 0; i < overrides->n_set && rc == 0; i++) {
        note_former(e, overrides->set[i].path);
        if ((rc = check_effect(e, overrides->set[i].path, why)) < 0)
            experiment_free(e);
    }
    free(text);
    return rc;
}
