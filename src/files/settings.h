/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * libconfig's settings with errors for people: every failure names file and line, the setting, and
 * what was expected. The first failure sticks; later calls then do nothing, so that a whole group can
 * be read and the outcome asked for once.
 */
#ifndef APC_SETTINGS_H
#define APC_SETTINGS_H

#include <libconfig.h>
#include <stdio.h>

#include <apcbase.h>

struct settings {
    const char *file;
    const char
        *change; /* "plant.period = 0", said instead of file and line where that is to blame; or NULL */
    struct apc_error *why;
    int failed; /* 0, or the first error */
};

/*
 * Read a file into @p config, which config_destroy() ends in either case. It may begin with a byte order
 * mark. Refused with file, line and reason: what is not there, is no text, is larger than 16 MiB, or is no
 * libconfig;
 * @include, since the file is kept as the record of a run and must be whole; a whole number without an L that
 * needs more than 32 bits, which libconfig cuts off without a word. Returns 0 or a negative error.
 */
int settings_load(config_t *config, const char *file, struct apc_error *why);
/* The two halves of it: the text, to be freed, or NULL; and what the text of a file says. */
int settings_read(const char *file, char **text, struct apc_error *why);
int settings_parse(config_t *config, const char *file, const char *text, struct apc_error *why);

enum settings_presence { OPTIONAL, REQUIRED };

int settings_fail(struct settings *s, const config_setting_t *at, const char *fmt, ...) APC_PRINTF(3, 4);
/* Refuse members of a group that are not in the NULL-terminated list: a misspelt name must not be ignored. */
void settings_known(struct settings *s, const config_setting_t *group, const char *const *names);
/* The member that must be a group or list; NULL when it is absent (and that is a failure if REQUIRED). */
config_setting_t *settings_group(struct settings *s, const config_setting_t *in, const char *name,
                                 enum settings_presence presence);
config_setting_t *settings_list(struct settings *s, const config_setting_t *in, const char *name,
                                enum settings_presence presence);
/* Leave *value alone when the member is absent and OPTIONAL. */
void settings_number(struct settings *s, const config_setting_t *in, const char *name,
                     enum settings_presence presence, double low, double high, double *value);
/* The same of what is at hand. */
void settings_number_at(struct settings *s, const config_setting_t *at, const char *name, double low,
                        double high, double *value);
/*
 * Values whose names are somebody else's, as a model's: members of a group or, where such a name is none that
 * a file can have (tank.level, x[1]), of a list: { name = "tank.level"; value = 1.0; }. NULL when it is
 * absent.
 */
const config_setting_t *settings_values(struct settings *s, const config_setting_t *in, const char *name);
/* Number @i of them, and its *name; NULL after a failure. */
const config_setting_t *settings_value(struct settings *s, const config_setting_t *values, int i,
                                       const char **name);
/* Can it be the name of a member? */
bool settings_is_word(const char *name);
/* As it stands there: 1.5 is refused, not rounded. */
void settings_whole(struct settings *s, const config_setting_t *in, const char *name,
                    enum settings_presence presence, int64_t low, int64_t high, int64_t *value);
void settings_period(struct settings *s, const config_setting_t *in, const char *name,
                     enum settings_presence presence, apc_ns *value);
void settings_flag(struct settings *s, const config_setting_t *in, const char *name, bool *value);
void settings_text(struct settings *s, const config_setting_t *in, const char *name,
                   enum settings_presence presence, char *value, size_t size);
/* The required text "name": not empty, one line. */
void settings_name(struct settings *s, const config_setting_t *in, char *value, size_t size);
/* An array or list of exactly n numbers. */
void settings_numbers(struct settings *s, const config_setting_t *array, size_t n, double *values);

/* Text as it stands in a file, in double quotes, whatever is in it. */
void settings_put_text(FILE *out, const char *text);

#endif
