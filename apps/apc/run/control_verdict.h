/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Was the plant controlled? The state of its loop, by its transitions in the order of time, and the verdict
 * on a run by the time spent in each. The transitions are of the plant's side and of the record: each trip
 * and end of a trip of the watchdog, which apc-plant tells, and of an external plant apc-client, each of them
 * and none held back; the status of the outputs' rows; and who was out of service.
 */
#ifndef APC_CONTROL_VERDICT_H
#define APC_CONTROL_VERDICT_H

#include <stdio.h>

#include <apcstore.h>

/* A condition that comes and goes. */
struct spells {
    bool on;
    apc_ns since;                 /* of the one that lasts */
    apc_ns total, longest, start; /* of all; of the longest, and when that began */
    unsigned times;
};

struct control {
    bool external;
    bool commanded;         /* it takes commands */
    bool excused;           /* it is out of service: that nobody commands it is meant so */
    const char *fault;      /* an output that is at its fault value; NULL: none is */
    apc_ns cleared, link;   /* since when none is, while nothing else was; the watchdog's patience */
    apc_ns begin, at, end;  /* from when on it counts; up to when the state is known; where it ended */
    bool ever, controlled;  /* it was commanded; and by something better than fault values */
    struct spells bare;     /* no command, and not excused */
    struct spells faulty;   /* an output at its fault value */
    struct spells open;     /* either */
    const char *was_faulty; /* the output, of the last such spell */
};

/* @p link: the watchdog's patience with the link. */
void control_begin(struct control *c, bool external, apc_ns link, apc_ns begin);
/* Does an event say whether the plant is commanded from then on? It is a start's, too: the plant waits. */
bool control_hears(const struct control *c, const struct apc_event *event, bool *commanded);
/* The transitions, in rising order of time; one that comes late counts from the last one on. */
void control_command(struct control *c, apc_ns time, bool commanded);
/* From that time on a loop is out of service, or none is. */
void control_excuse(struct control *c, apc_ns time, bool excused);
/* From that time on this output is at its fault value; NULL: none is. The name is borrowed. */
void control_fault(struct control *c, apc_ns time, const char *output);
void control_end(struct control *c, apc_ns end);

/*
 * The verdict on what ended, and in @p why what was wrong. OPEN: it never was commanded, or by fault values
 * only; or it was open for longer than @p hold at a stretch. AGAIN: it was so in sum, and for more than a
 * hundredth of the time. Times are told from @p zero on.
 */
enum control_verdict { CONTROL_CLOSED = 1, CONTROL_AGAIN, CONTROL_OPEN };
#define CONTROL_SHARE 100
enum control_verdict control_judge(const struct control *c, apc_ns zero, apc_ns hold, char *why, size_t size);

#endif
