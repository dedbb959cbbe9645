/* SPDX-License-Identifier: BSD-3-Clause */
/* JSON out: a growing text. JSON in: a request's body, member by member, with errors for people. */
#ifndef APC_UI_JSON_H
#define APC_UI_JSON_H

#include <jansson.h>

#include <apcbase.h>

/* Zeroed: empty. Out of memory makes it `failed` and leaves it empty; later calls do nothing. */
struct text {
    char *at; /* not terminated */
    size_t n, room;
    bool failed;
};

void text_free(struct text *t);
void text_put(struct text *t, const char *data, size_t n);
void text_add(struct text *t, const char *fmt, ...) APC_PRINTF(2, 3);
/* Drop the last character if it is this one: the comma after the last element. */
void text_chop(struct text *t, char last);

/* One JSON value each. What is not UTF-8 becomes U+FFFD; what is no finite number becomes null. */
void json_string_add(struct text *t, const char *string); /* NULL: null */
void json_number_add(struct text *t, double value);       /* the shortest that reads back the same */
void json_limit_add(struct text *t, double limit);        /* null where there is none */
const char *json_truth(bool is);                          /* true, false */
void json_time_add(struct text *t, apc_ns utc);           /* Unix seconds with microseconds */
void json_seconds_add(struct text *t, apc_ns duration);
void json_sample_add(struct text *t, const struct apc_sample *sample); /* [seq, time, value, status] */

/* What is wrong with a request: for the answer. */
struct fault {
    int http;         /* status; 0: nothing is wrong */
    const char *code; /* static */
    char field[32];
    char message[200];
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
