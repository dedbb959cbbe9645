/* SPDX-License-Identifier: BSD-3-Clause */
#include "option.h"

#include <assert.h>
#include <dlfcn.h>
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <apcbase.h>

#include "common/exitcode.h"

#define WITHOUT_LETTER 0x400 /* the keys of options without one; cli.c's own are below */
#define FORMER         0x800 /* those of former names */

static int option_key(const struct option_spec *option, int i)
{
    return option[i].letter ? option[i].letter : WITHOUT_LETTER + i;
}

void option_list(const struct option_spec *option, struct argp_option list[2 * OPTIONS_MAX + 1])
{
    for (int i = 0; option[i].name; i++) {
        const int optional = option[i].optional ? OPTION_ARG_OPTIONAL : 0;
        assert(i < OPTIONS_MAX);
        *list++ = (struct argp_option){.name = option[i].name,
                                       .key = option_key(option, i),
                                       .arg = option[i].arg,
                                       .flags = optional,
                                       .doc = option[i].help};
        if (option[i].former)
            *list++ = (struct argp_option){.name = option[i].former,
                                           .key = FORMER + i,
                                           .arg = option[i].arg,
                                           .flags = optional | OPTION_HIDDEN};
    }
    *list = (struct argp_option){0};
}

static void refuse_option(const struct option_spec *o, const char *arg, const struct argp_state *state)
{
    if (o->must)
        argp_error(state, "--%s \"%s\": must %s", o->name, arg, o->must);
    else
        argp_error(state, "--%s \"%s\": must be a number from %g to %g", o->name, arg, o->low, o->high);
}

static bool option_is_within(const struct option_spec *o, double value)
{
    return (o->above || (o->low >= o->high) ? value > o->low : value >= o->low) &&
           (o->low >= o->high || value <= o->high);
}

/* Exact in all digits, as seeds are; nothing but digits. */
static bool option_whole(const char *text, uint64_t *whole)
{
    errno = 0;
    *whole = strtoull(text, NULL, 10);
    return *text && text[strspn(text, "0123456789")] == '\0' && errno == 0;
}

/* A count may be written as any number: 1e4. */
static bool option_count(const char *text, uint64_t *whole)
{
    double value;
    if (apc_number_parse(text, &value) < 0 || !(value >= 0 && value <= UINT32_MAX))
        return false;
    *whole = (uint64_t)value;
    return (double)*whole >= value;
}

static bool take_whole_option(const struct option_spec *o, const char *arg, uint64_t *whole)
{
    return (o->kind == OPTION_COUNT ? option_count(arg, whole) : option_whole(arg, whole)) &&
           option_is_within(o, (double)*whole);
}

static bool take_number_option(const struct option_spec *o, const char *arg, double *to)
{
    return apc_number_parse(arg, to) == 0 && option_is_within(o, *to);
}

/* Which it is; -1: none. */
static int option_choice(const struct option_spec *o, const char *arg)
{
    for (int i = 0; o->choices[i]; i++)
        if (strcmp(o->choices[i], arg) == 0)
            return i;
    return -1;
}

static bool take_text_option(const struct option_spec *o, const char *arg)
{
    return o->choices ? option_choice(o, arg) >= 0 : !o->must || *arg;
}

static void take_option(const struct option_spec *o, void *own, char *arg, const struct argp_state *state)
{
    void *const to = (char *)own + o->to;
    uint64_t whole = 0;
    bool good = true;
    switch (o->kind) {
    case OPTION_FLAG:
        *(bool *)to = true;
        break;
    case OPTION_TEXT:
        if (o->once && *(const char **)to)
            argp_error(state, "--%s: %s", o->name, o->once);
        good = take_text_option(o, arg);
        *(const char **)to = arg;
        break;
    case OPTION_NUMBER:
        good = take_number_option(o, arg, (double *)to);
        break;
    case OPTION_COUNT:
        good = take_whole_option(o, arg, &whole);
        *(unsigned *)to = (unsigned)whole;
        break;
    case OPTION_WHOLE:
        good = take_whole_option(o, arg, &whole);
        *(uint64_t *)to = whole;
        break;
    case OPTION_CHOICE:
        good = option_choice(o, arg) >= 0;
        *(unsigned *)to = (unsigned)option_choice(o, arg);
        break;
    case OPTION_OWN:
        o->take(to, arg, state);
        break;
    }
    if (!good)
        refuse_option(o, arg, state);
    if (o->given)
        *((bool *)own + o->given - 1) = true;
}

/* Both names at once may mean two numbers. */
static void check_former(struct option_input *in, int i, bool former, const struct argp_state *state)
{
    const struct option_spec *o = &in->option[i];
    *(former ? &in->by_former : &in->given) |= 1ull << i;
    if (in->given & in->by_former & 1ull << i)
        argp_error(state, "--%s is the former name of --%s, and both are given: leave --%s out", o->former,
                   o->name, o->former);
    else if (former)
        fprintf(stderr,
                "%s: warning: --%s is called --%s now; this version is the last that takes the former name\n",
                state->name, o->former, o->name);
}

error_t option_parse(int key, char *arg, struct argp_state *state)
{
    struct option_input *in = state->input;
    if (key == ARGP_KEY_END && in->check)
        in->check(in->own, state);
    for (int i = 0; in->option[i].name; i++)
        if (option_key(in->option, i) == key || FORMER + i == key) {
            check_former(in, i, FORMER + i == key, state);
            take_option(&in->option[i], in->own, arg, state);
            return 0;
        }
    return key == ARGP_KEY_END ? 0 : ARGP_ERR_UNKNOWN;
}

/* ---- A program ------------------------------------------------------------------------------ */

static error_t parse_program(int key, char *arg, struct argp_state *state)
{
    struct option_input *in = state->input;
    if (key == ARGP_KEY_INIT) {
        if (in[1].option)
            state->child_inputs[0] = &in[1];
        return 0;
    }
    if (key == ARGP_KEY_ARG)
        argp_error(state, "unexpected argument \"%s\"", arg);
    return option_parse(key, arg, state);
}

static void print_program_version(FILE *stream, struct argp_state *state)
{
    fprintf(stream, "%s (libapc) %s\n", state->name, apc_version());
}

void option_library(void)
{
    const char *(*version)(void) = apc_version;
    void *address;
    Dl_info found;

    if (strverscmp(apc_version(), APC_VERSION) >= 0)
        return;
    memcpy(&address, &version, sizeof address);
    fprintf(
        stderr,
        "%s: this program is of version %s, and the library %s of version %s: install both of one version; "
        "`ldd` with this program shows which libraries are found\n",
        program_invocation_short_name, APC_VERSION, dladdr(address, &found) ? found.dli_fname : "libapc.so",
        apc_version());
    exit(EXIT_ERROR);
}

void option_program(struct option_input in[2], const char *doc, int argc, char **argv)
{
    struct argp_option list[2 * OPTIONS_MAX + 1], own_list[2 * OPTIONS_MAX + 1];
    const struct argp own = {own_list, option_parse, NULL, NULL, NULL, NULL, NULL};
    const struct argp_child children[] = {{&own, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse_program, NULL, doc, in[1].option ? children : NULL, NULL, NULL};

    option_library();
    option_list(in[0].option, list);
    if (in[1].option)
        option_list(in[1].option, own_list);
    argp_program_version_hook = print_program_version;
    argp_err_exit_status = EXIT_USAGE;
    argp_parse(&argp, argc, argv, 0, NULL, in);
}
