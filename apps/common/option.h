/* SPDX-License-Identifier: BSD-3-Clause */
/* Options of programs and commands: each is listed once, with what it takes, where that goes, and what is said of it. */
#ifndef APC_OPTION_H
#define APC_OPTION_H

#include <argp.h>
#include <stdbool.h>
#include <stddef.h>

enum option_kind {
    OPTION_FLAG = 1, /* bool */
    OPTION_TEXT,     /* const char *, among the choices if there are any */
    OPTION_NUMBER,   /* double */
    OPTION_COUNT,    /* unsigned, whole */
    OPTION_WHOLE,    /* uint64_t, size_t */
    OPTION_CHOICE,   /* the number of the choice, in an enumeration */
    OPTION_OWN       /* whatever `take` makes of it */
};

struct option_spec {
    const char *name;
    int letter;      /* 0: it has none */
    const char *arg; /* what --help calls its argument; NULL: it takes none */
    const char *help;
    enum option_kind kind;
    size_t to;                  /* where it goes: an offset in the options of the command */
    size_t given;               /* 1 + that of a bool which is set as well; 0: none */
    double low, high;           /* of numbers; both 0: any above 0 */
    bool above;                 /* low itself is too low */
    bool optional;              /* its argument is: NULL without one */
    const char *const *choices; /* up to a NULL */
    const char *must; /* --NAME "ARG": must ...; NULL: of a number its limits. Of a text: not be "" */
    const char *once; /* what is said where it is given again; NULL: the last one holds */
    void (*take)(void *to, char *arg, const struct argp_state *state);
    const char *former; /* its name in the version before, taken for one version more; NULL: the same */
};

#define OPTIONS_MAX 32
#define YEAR        (366 * 86400.0) /* the longest duration, s */

struct option_input {
    const struct option_spec *option;                         /* up to one without a name */
    void (*check)(void *own, const struct argp_state *state); /* of all of them, at the end; may be NULL */
    void *own;
    unsigned long long given, by_former; /* which of them, by the present name and by the former one */
};

/* A library that is older than the program may lack what it relies on, without a word: then it exits, and says which one. */
void option_library(void);
/* As argp takes them. */
void option_list(const struct option_spec *option, struct argp_option list[2 * OPTIONS_MAX + 1]);
/* An argp parser, whose input is a struct option_input. */
error_t option_parse(int key, char *arg, struct argp_state *state);
/* All options of a program that takes no arguments: common ones, and its own, @in[1].option, or NULL. It exits
 * where they are wrong, and after --help and --version. */
void option_program(struct option_input in[2], const char *doc, int argc, char **argv);

#endif
