/* SPDX-License-Identifier: BSD-3-Clause */
/* Talking to an apc-ui in a test. */
#ifndef APC_TEST_API_H
#define APC_TEST_API_H

#include <jansson.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "http.h"

/* Somebody at one server. */
struct client {
    int port;
    char cookie[256], csrf[80]; /* "": an open server's, or nobody */
};

/* Of a text that is one; fails the test else. */
int whole_number(const char *text);
/* Number in the environment: the ports. */
int environment_port(const char *name);
/* Log in; on an open server (user NULL) only ask for the token. */
struct client client_make(int port, const char *user, const char *password);
/* A request in the client's name; the status, and the answer's JSON in *json (NULL: it is none, or not
 * wanted). */
int client_get(const struct client *c, const char *path, json_t **json);
int client_post(const struct client *c, const char *path, const char *body, json_t **json);
/* Exactly this status, and this code of its error. */
void expect_error(const struct client *c, const char *method, const char *path, const char *header,
                  const char *body, int status, const char *code);

/* The newest sample in /api/state. */
int64_t seq_of(const struct client *c, const char *ref);
double value_of(const struct client *c, const char *ref);

struct http_stream *client_stream(const struct client *c, const char *last);
/* The next message of this kind; its data, to be freed with json_decref(). Aborts at the stream's end. */
json_t *next_event(struct http_stream *stream, const char *event, struct http_message *message);
/* Wait until the write is in this state; its last message. */
json_t *await_write(struct http_stream *stream, const char *key, const char *state);

#define text_of(json, name)   json_string_value(json_object_get(json, name))
#define number_of(json, name) json_number_value(json_object_get(json, name))

#endif
