/* SPDX-License-Identifier: BSD-3-Clause */
/* A small HTTP client for tests: loopback, one request a connection, and streams. It gives up after 20 s of
 * silence. */
#ifndef APC_TEST_HTTP_H
#define APC_TEST_HTTP_H

#include <stdbool.h>
#include <stddef.h>

struct http_reply {
    int status;   /* 0: the server closed the connection without an answer */
    char *header; /* all of them, terminated */
    char *body;   /* terminated, without its chunks */
    size_t n;
};

/*
 * `header` holds further lines, each ended by \r\n, or NULL; Host is added unless there is one in it, and
 * Content-Length if there is a body.
 */
void http_request(struct http_reply *reply, int port, const char *method, const char *path,
                  const char *header, const char *body);
/* From here on connect from this address of the loopback network; NULL: from whichever. */
void http_from(const char *address);
/* Send these bytes, read until the server closes. */
void http_raw(struct http_reply *reply, int port, const char *bytes, size_t n);
void http_free(struct http_reply *reply);
/* The value of a header into to, "" if there is none. Returns to. */
char *http_header(const struct http_reply *reply, const char *name, char *to, size_t size);

/* A connection of one's own. */
int http_connect(int port);
/* Send; false: the server has closed. */
bool http_send(int fd, const char *bytes, size_t n);

/* Server-Sent Events. */
struct http_stream;
struct http_message {
    char id[64], event[32];
    char *data; /* lives until the next call */
};
/* Aborts the test when the answer is not 200. */
struct http_stream *http_stream_open(int port, const char *path, const char *header);
/* The next message; false: the stream has ended. */
bool http_stream_next(struct http_stream *stream, struct http_message *message);
void http_stream_close(struct http_stream *stream);

#endif
