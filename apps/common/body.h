/* SPDX-License-Identifier: BSD-3-Clause */
/* JSON in: a request's body, member by member, with errors for people. */
#ifndef APC_APPS_BODY_H
#define APC_APPS_BODY_H

#include <jansson.h>

#include <apcbase.h>

/* What is wrong with a request: for the answer. */
struct fault {
    int http;         /* status; 0: nothing is wrong */
    const char *code; /* static */
    char field[32];
    char message[320];
};
/* The first fault sticks. Returns false, so that `return fault_set(...)` reads well. */
bool fault_set(struct fault *f, int http, const char *code, const char *field, const char *fmt, ...)
    APC_PRINTF(5, 6);

/* The body as an object that has no members but these (the list ends with NULL). NULL: fault set. */
json_t *body_parse(const char *body, size_t n, const char *const *members, struct fault *f);
/* Members of an object; false: fault set. Numbers are finite. */
bool member_number(const json_t *object, const char *name, double *value, struct fault *f);
bool member_whole(const json_t *object, const char *name, int64_t low, int64_t high, int64_t *value,
                  struct fault *f);
bool member_text(const json_t *object, const char *name, const char **text, struct fault *f);
bool members_known(const json_t *object, const char *const *members, struct fault *f);

#endif
