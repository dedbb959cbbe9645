/* SPDX-License-Identifier: BSD-3-Clause */
/**
 * @file apcsockets.h
 * The third principle of the paper: network communication. Frames, links that exchange them, and the
 * paper's own socket functions (section "Network Communication").
 *
 * A frame is one line of text, at most 1 MiB. Header and samples each end with a semicolon, the frame
 * with a newline, and there is nothing else in it: apc1 query 7 0;\n or
 *
 *     apc1 command 17 2;2026-01-31T12:00:00.123456Z,Good,1.5;2026-01-31T12:00:00.123456Z,Bad,0;\n
 *
 *     frame  = "apc1 " kind " " id " " n ";" n*sample newline
 *     kind   = "command" | "query" | "values"      a query has n = 0
 *     id, n  = decimal without sign or leading zeros; id below 2^64, n at most APC_FRAME_COUNT
 *     sample = time "," status "," value ";"
 *     time   = RFC 3339, UTC, microseconds: always the 27 characters of apc_time_format()
 *     status = as apc_status_parse() reads it
 *     value  = as apc_number_parse() reads it, at most 32 characters: finite, decimal, C locale
 *
 * The client sends `command` (the newest u) or `query` (no values: do not change u); the plant answers
 * `values` (the newest y) under the same request id. `nc` can speak it.
 */
#ifndef APCSOCKETS_H
#define APCSOCKETS_H

#include "apcbase.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- The paper's functions (Listings 3 and 4) --------------------------------------------- */

#define APC_PACK_MAX 1024 /**< room that packMultiMsg() takes to be in its buffer, as in the listings */

/**
 * Write n samples into @p buff as a `values` frame with request id 0, newline and terminator included.
 * @p buff must have APC_PACK_MAX bytes; @p ts and @p status may be NULL (now; Good). A status may be
 * written with the paper's quotes. Returns the length, or APC_EINVAL, APC_ERANGE (does not fit:
 * about 18 values; buff is then the empty string). The daemons use apc_frame_encode(). [tick]
 */
APC_API int packMultiMsg(char *buff, int n, char (*ts)[1024], char (*status)[1024], const double *values);
/**
 * Read the frame of any kind that @p buff begins with; what follows its newline is ignored, because it
 * is left over from a longer message when a buffer is not cleared (as in Listing 4). At most APC_PACK_MAX
 * bytes of @p buff are looked at. @p ts (written as RFC 3339) and @p status (the name) may be NULL.
 * The arrays must have room for as many samples as the frame holds, at most 30. The signature cannot say how
 * many: use it for a peer you trust, otherwise apc_frame_decode(). Returns the number of samples, or
 * APC_EINVAL, APC_EPROTO; on failure nothing is written. [tick]
 */
APC_API int unpackMultiMsg(char (*ts)[1024], char (*status)[1024], double *values, const char *buff);

#define APC_PORT 43051 /**< the paper's port */

APC_API int client_init(void); /**< a TCP socket, or APC_ESYS. [setup] */
/** Connect within 5 s. @p ip is dotted IPv4. Returns 0, APC_EINVAL, APC_ECONN, APC_ETIMEDOUT. [setup] */
APC_API int client_connect(int fd, const char *ip, int port);
/** A TCP socket bound to 127.0.0.1:43051, or APC_ESYS (errno says why; EADDRINUSE: port taken). [setup] */
APC_API int server_init(void);
APC_API int server_listen(int fd, int queue); /**< 0, APC_EINVAL or APC_ESYS. [setup] */
APC_API int server_accept(int fd);            /**< waits; a connection, or APC_ESYS. [setup] */

/* ---- Frames ------------------------------------------------------------------------------- */

#define APC_FRAME_MAX   (1u << 20) /**< bytes of a frame, newline included */
#define APC_FRAME_COUNT 8192       /**< values a frame may hold */
/**
 * A client that has claims in a store numbers its requests by them: the claim's number (apc_store_claimed())
 * times 1024, and a count below 1024. A plant refuses a command of a lower claim than that of the client who
 * commands, until that one has been silent for some seconds. Ids below 2^50 tell of no claim, and are not
 * compared; nor is a claim, which is a time in us, that is minutes ahead of the plant's clock.
 */
#define APC_FRAME_CLAIMED   (UINT64_C(1) << 50)
#define APC_FRAME_PER_CLAIM 1024
/** Bytes that suffice for a frame of @p n values. */
#define APC_FRAME_ROOM(n) (256 + 96 * (size_t)(n))

enum apc_frame_kind { APC_FRAME_COMMAND = 1, APC_FRAME_QUERY, APC_FRAME_VALUES };

struct apc_frame {
    enum apc_frame_kind kind;
    uint64_t id; /**< request id, and that of its reply; 0 from a peer that does not number (the paper's
                    listings), and in reply to a command that was not taken from one that does */
    size_t n;    /**< number of samples */
};

/**
 * Write a frame: of each sample its time, status and value. Returns the length (no terminator), or
 * APC_EINVAL (a value is not finite, a time not within the years 1678..2261, a query with values), or
 * APC_ERANGE (more than @p size, APC_FRAME_COUNT or APC_FRAME_MAX). [tick]
 */
APC_API int apc_frame_encode(char *text, size_t size, const struct apc_frame *frame,
                             const struct apc_sample *samples);
/**
 * Read one frame of exactly @p length bytes, newline included. Writes time, status and value of at
 * most @p capacity samples (other members stay). Returns 0; APC_EPROTO when anything at all is not as
 * written above; APC_ERANGE when it holds more than @p capacity. On failure *frame is zeroed. [tick]
 */
APC_API int apc_frame_decode(const char *text, size_t length, struct apc_frame *frame,
                             struct apc_sample *samples, size_t capacity);

/* ---- Who is who: tls: ----------------------------------------------------------------------- */

/**
 * The identity of a program: its private key, its certificate, and the certificates of the authorities whose
 * peers it accepts. `apc cert` makes such a file. A link or server that has one borrows it.
 */
struct apc_identity;

/**
 * Read them from @p file: PEM, the key without a password, its own certificate first. [setup] Returns 0,
 * APC_EINVAL (what stands in it does not fit together, says why), APC_ENOTFOUND (it cannot be read),
 * APC_ESTATE (this libapc was built without OpenSSL), APC_ENOMEM.
 */
APC_API int apc_identity_load(struct apc_identity **identity, const char *file, struct apc_error *why);
APC_API void apc_identity_free(struct apc_identity *identity); /**< NULL is legal. [setup] */
/**
 * Read the file again if it is another than at the last time; connections that are made from now on take what
 * it says, the others stay. It is left alone where what stands in it does not fit together, or cannot take
 * the place of what was read before: the same use, name, hosts and authority, and good today. Returns 1: it
 * was read; 0; or an error of apc_identity_load(). [any], but not in a tick: it reads a file.
 */
APC_API int apc_identity_refresh(struct apc_identity *identity, struct apc_error *why);
/** UTC when the first of its certificates expires. From then on nothing connects by it; connections that
 * stand are not closed. [any] */
APC_API apc_ns apc_identity_expiry(struct apc_identity *identity);

/* ---- Links -------------------------------------------------------------------------------- */

/** Zero means default. */
struct apc_link_options {
    size_t size;
    size_t frame_max; /**< largest reply; default 64 KiB */
    /** How long the reply is that begins with these @p n bytes, 1 or more: its length; 0: they do not tell
     * yet; negative: they are no reply. NULL: it ends with its first newline. */
    int (*whole)(const char *bytes, size_t n);
    apc_ns backoff_min;            /**< first pause after a failed connect, or two refusals; default 100 ms */
    apc_ns backoff_max;            /**< longest pause; default 5 s. Pauses double and are jittered */
    uint64_t seed;                 /**< of the jitter; default: from the clock */
    struct apc_identity *identity; /**< of tls:, which requires it */
    /** Where replies say which request they answer: is this one of a request that is waited for no more? Then
     * it is dropped, and a request without a reply in time costs no connection. NULL: one does. */
    bool (*late)(void *ctx, const char *reply, size_t length);
    void *late_ctx;
};

struct apc_link;

/**
 * The asking side of a link. @p uri: `tcp:HOST:PORT`, or `tls:HOST:PORT`, the same encrypted, both sides
 * proving who they are: TLS 1.3, nothing older. HOST is an IPv4 address, an IPv6 address in
 * brackets, or a name, and of tls: what the server's certificate must be of. A name is resolved by a thread
 * that the link owns, once at the start and again whenever connecting failed; an address needs none. A tls:
 * link connects in a thread of its own, within 1 s; who exchanges waits for that as long as it likes. Does
 * not connect yet: the first exchange does. One thread at a time. [setup] Returns 0, APC_EINVAL (malformed
 * address, unknown scheme, no identity), APC_ENOMEM, APC_ESYS (no thread), APC_ESTATE (tls: in a libapc
 * without OpenSSL).
 */
APC_API int apc_link_create(struct apc_link **link, const char *uri, const struct apc_link_options *options,
                            struct apc_error *why);
APC_API void apc_link_destroy(struct apc_link *link); /**< NULL is legal. [setup] */

/**
 * Send one frame and wait for its reply until @p deadline (monotonic). Connects when not connected.
 * Anything but one whole reply in time closes the connection, so that a late reply is never taken for
 * the next one's; the next exchange connects again, after a pause when connecting failed. *@p reply points
 * into the link until its next call. Returns the length of the reply, or APC_ECONN (no connection, or pausing
 * before the next try), APC_ETIMEDOUT, APC_EPROTO (longer than frame_max). [tick]
 */
APC_API int apc_link_exchange(struct apc_link *link, const char *request, size_t length, const char **reply,
                              apc_ns deadline);
/**
 * The two halves of apc_link_exchange(), each with its errors: the request goes out; the reply comes in. A
 * request that follows one without a reply closes the connection and makes another. APC_EINVAL: nothing was
 * asked. [tick]
 */
APC_API int apc_link_send(struct apc_link *link, const char *request, size_t length, apc_ns deadline);
/** The other half. [tick] */
APC_API int apc_link_receive(struct apc_link *link, const char **reply, apc_ns deadline);
/** Close the connection, e.g. because the reply made no sense. The next exchange connects again. [tick] */
APC_API void apc_link_reset(struct apc_link *link);
APC_API bool apc_link_connected(const struct apc_link *link);    /**< As far as it is known. [tick] */
APC_API uint64_t apc_link_connects(const struct apc_link *link); /**< Connections made so far. [tick] */
APC_API const char *
apc_link_error(const struct apc_link *link); /**< text of the last failure, "" if none. [tick] */

/**
 * Answer one request. Runs on the server's thread, one call at a time. Write the reply into @p reply
 * and return its length, or a negative error to close that connection. @p connection differs for
 * every connection ever accepted.
 */
typedef int (*apc_server_fn)(void *ctx, uint64_t connection, const char *request, size_t length, char *reply,
                             size_t size);

struct apc_server_options {
    size_t size;
    size_t frame_max;     /**< largest request and reply; default 64 KiB */
    unsigned connections; /**< at once; default 16. One more takes the place of the one that was silent
                             longest; but it is closed itself when each other has a request under way or was
                             the last to be answered */
    apc_ns frame_timeout; /**< a begun frame must be complete, a reply taken, within it; default 1 s */
    bool allow_plaintext; /**< listen beyond loopback by tcp:; otherwise refused */
    struct apc_log *log;  /**< NULL: silent */
    /** How long the request is that begins with these @p n bytes, 1 or more: its length; 0: they do not tell
     * yet; negative: they are no request, and the connection is closed. NULL: it ends with its first newline.
     */
    int (*whole)(const char *bytes, size_t n);
    struct apc_identity *identity; /**< of tls:, which requires it */
    /** Of tls:, which requires one: the names (CN) of the certificates whose holders may connect; others are
     * rejected. Borrowed. */
    const char *const *clients;
    size_t n_clients;
};

/** Counters since the start. */
struct apc_server_stats {
    size_t size; /**< sizeof the struct, set by the caller: no more than that is filled */
    uint64_t accepted, requests;
    uint64_t refused;  /**< connections closed at once: there was no room */
    uint64_t evicted;  /**< silent connections closed to make room for a new one */
    uint64_t rejected; /**< connections closed for what they sent, or did not take */
    unsigned open;
};

struct apc_server;

/**
 * The answering side of a link: bind, listen and serve in a thread of its own. @p uri as above;
 * port 0 takes a free one. [setup] Returns 0, APC_EINVAL, APC_EPERM (beyond loopback, plain text),
 * APC_ESYS (port taken, ...), APC_ENOMEM, APC_ESTATE (tls: in a libapc without OpenSSL).
 */
APC_API int apc_server_create(struct apc_server **server, const char *uri,
                              const struct apc_server_options *options, apc_server_fn fn, void *ctx,
                              struct apc_error *why);
/** Close every connection and end the thread; fn is not called after this returns. NULL is legal. [setup] */
APC_API void apc_server_destroy(struct apc_server *server);
#define APC_PEER_LEN 80
/** The address of a connection's other end, "127.0.0.1:40000", of tls: with the name of its certificate,
 * "127.0.0.1:40000 (apc-client)"; of one that is closed until its place is taken, then that it is forgotten.
 * Only from within fn, for whatever connection. Returns
 * @p text. [tick] */
APC_API char *apc_server_peer(const struct apc_server *server, uint64_t connection, char text[APC_PEER_LEN]);
/** Where it listens; APC_EINVAL for NULL. [any] */
APC_API int apc_server_port(const struct apc_server *server);
APC_API void apc_server_stats(const struct apc_server *server, struct apc_server_stats *stats); /**< [any] */

/* ---- A network that is only modelled ------------------------------------------------------ */

/** Time on the monotonic clock, from <= t < until, in which every frame that is sent is lost. */
struct apc_outage {
    apc_ns from, until;
};

/** Zero means none. Distributions of seconds; one of kind 0 is none, what they borrow outlives the network. */
struct apc_network_options {
    size_t size;
    struct apc_distribution delay;  /**< of each frame; a draw below 0 counts as 0 */
    struct apc_distribution jitter; /**< added to it, may be negative; the sum counts as 0 below 0 */
    double loss;                    /**< probability that a frame is lost */
    double duplication; /**< that it arrives twice, the second with a delay and jitter of its own */
    /** That it takes no delay and overtakes those before it. Other frames keep their order: one that would
     * arrive before its predecessor arrives with it. */
    double reordering;
    double bandwidth; /**< bit/s: frames wait for each other; 0: no limit */
    const struct apc_outage *outages;
    size_t n_outages;
    uint64_t seed;
    const char
        *name; /**< of its random streams: two networks of one seed need two names; default "network" */
};

/** Counts of frames. */
struct apc_network_stats {
    size_t size; /**< sizeof the struct, set by the caller: no more than that is filled */
    uint64_t sent, lost, duplicated, reordered;
};

/**
 * One direction of a network: pure, it keeps no frames and knows no clock. Every model draws from its own
 * stream, for lost frames too, so a change of one model changes the draws of no other. One thread at a time.
 */
struct apc_network;

/** [setup] Returns 0, APC_EINVAL (a delay that could only be negative, a probability not within 0 to 1, an
 * outage that ends before it begins), APC_ENOMEM. */
APC_API int apc_network_create(struct apc_network **network, const struct apc_network_options *options,
                               struct apc_error *why);
APC_API void apc_network_destroy(struct apc_network *network); /**< NULL is legal. [setup] */
/** Whether a frame of @p length bytes sent at @p now arrives, and when: into @p at. Returns how often: 0, 1
 * or 2 times. @p now never goes back. [tick] */
APC_API int apc_network_send(struct apc_network *network, apc_ns now, size_t length, apc_ns at[2]);

/** What becomes of one frame, drawn before it is sent. */
struct apc_network_fate {
    apc_ns delay, copy_delay; /**< of the frame; of its copy */
    bool lost, twice, overtakes;
};
/** The two halves of apc_network_send(), for a frame that may never be sent, such as the reply to a request
 * that may be lost. The fate of the n-th frame is the n-th drawn, independently of the others. [tick] */
APC_API struct apc_network_fate apc_network_draw(struct apc_network *network);
/** The other half: as apc_network_send(), with the fate that was drawn. [tick] */
APC_API int apc_network_carry(struct apc_network *network, const struct apc_network_fate *fate, apc_ns now,
                              size_t length, apc_ns at[2]);
/** Since it was made. [tick] */
APC_API void apc_network_stats(const struct apc_network *network, struct apc_network_stats *stats);

#ifdef __cplusplus
}
#endif
#endif
