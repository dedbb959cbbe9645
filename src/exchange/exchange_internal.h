/* SPDX-License-Identifier: BSD-3-Clause */
/* What the files of src/exchange share. Never installed. */
#ifndef APC_EXCHANGE_INTERNAL_H
#define APC_EXCHANGE_INTERNAL_H

#include "apcexchange.h"

/**
 * A scheme. A new one is a file with such a table, named in exchange.c's list. Its struct begins with struct
 * apc_exchange, which exchange.c fills after open. begin is only called when none is under way, finish only
 * after a begin that returned 0; text of what fails goes into `error`.
 */
struct apc_exchange_ops {
    const char *scheme; /* with its colon */
    int (*open)(struct apc_exchange **x, const char *uri, const struct apc_exchange_options *options,
                struct apc_error *why);
    void (*close)(struct apc_exchange *x); /* also of one that open could not finish */
    int (*begin)(struct apc_exchange *x, const struct apc_value *u, apc_ns deadline);
    int (*finish)(struct apc_exchange *x, struct apc_value *y);
    /* Of the outputs that are @which [nu]; NULL: the plant watches its client. One that has it marks in
     * `commanded` what may have reached the plant. */
    int (*safe)(struct apc_exchange *x, const bool *which, apc_ns deadline);
    void (*claim)(struct apc_exchange *x, uint64_t number); /* NULL: a command has no place for it */
    apc_status (*read_back)(const struct apc_exchange *x, size_t i, double *value); /* NULL: it is not */
};

struct apc_exchange {
    const struct apc_exchange_ops *ops;
    size_t nu, ny;
    bool begun;
    bool refused;    /* the command of the last one */
    bool partly;     /* the last one went well but for a part of the plant, of which `error` tells */
    bool *commanded; /* [nu], and room for as many; exchange.c's, after open */
    struct apc_error error;
};

extern const struct apc_exchange_ops apc_exchange_tcp, apc_exchange_tls, apc_exchange_inproc,
    apc_exchange_modbus, apc_exchange_serial;

/** May it be given to a plant? [tick] */
bool apc_exchange_writes(const struct apc_value *u);

/* ---- frames.c: vectors as frames ------------------------------------------------------------ */

struct apc_frames {
    size_t nu, ny;
    uint64_t id;                /* of the last request */
    uint64_t claim;             /* its number; 0: none */
    bool commands;              /* it is a command */
    bool numbers;               /* the peer has numbered a reply */
    bool refused;               /* the last command */
    size_t room;                /* of text, and of any frame between the two */
    char *text;                 /* of the last request */
    struct apc_sample *samples; /* [max(nu, ny)] of the frame at hand */
};

/** [setup] 0 or APC_ENOMEM; apc_frames_free() in either case. */
int apc_frames_init(struct apc_frames *frames, size_t nu, size_t ny);
void apc_frames_free(struct apc_frames *frames);
/** Number the requests by a claim. A lower one than it has is left alone: a database's clock may go back. */
void apc_frames_claim(struct apc_frames *frames, uint64_t number);
/** Write a command, or a query when anything of @p u (NULL) is not to be written, into `text`. Returns its
 * length, or APC_EINVAL with its text in @p why. [tick] */
int apc_frames_ask(struct apc_frames *frames, const struct apc_value *u, struct apc_error *why);
/** Read the reply to the last request. Returns 0, or APC_EPROTO with its text in @p why. [tick] */
int apc_frames_answer(struct apc_frames *frames, const char *text, size_t length, struct apc_value *y,
                      struct apc_error *why);

#endif
