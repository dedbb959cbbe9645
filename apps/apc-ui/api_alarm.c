/* SPDX-License-Identifier: BSD-3-Clause */
/* The alarms as they stand, and what they did. */
#include <inttypes.h>
#include <string.h>

#include "http.h"
#include "run/alarm_board.h"
#include "run/alarms.h"

#define JOURNAL_MAX  1000
#define JOURNAL_LAST 200

/* The alarms that the store describes, none where it describes none; alarm_board_close(). False: fault set.
 */
static bool open_board(struct request *r, struct apc_store *store, struct alarm_board *board)
{
    struct apc_error why;
    int rc = alarm_board_open(board, store, &why);
    if (rc == APC_ENOTFOUND)
        return true;
    if (rc < 0)
        return fault_set(&r->fault, 503, "store", NULL, "%.150s", why.text);
    if ((rc = alarm_board_read(board, store)) < 0)
        fault_store(r, rc, store);
    return rc == 0;
}

static void author_json(struct apc_store *store, uint32_t author, struct text *t)
{
    char name[APC_AUTHOR_LEN] = "";
    if (author > 0 && apc_store_author_name(store, author, name) < 0)
        name[0] = '\0';
    text_add(t, ",\"author\":");
    json_string_add(t, name[0] ? name : NULL);
}

static void time_json(const char *name, apc_ns time, struct text *t)
{
    text_add(t, ",\"%s\":", name);
    if (time > 0)
        json_time_add(t, time);
    else
        text_add(t, "null");
}

static void texts_json(const struct alarm *alarm, struct text *t)
{
    const char *const texts[][2] = {{"area", alarm->area},
                                    {"message", alarm->message},
                                    {"consequence", alarm->consequence},
                                    {"response", alarm->response}};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        text_add(t, ",\"%s\":", texts[i][0]);
        json_string_add(t, texts[i][1]);
    }
}

static const char *truth(bool is)
{
    return is ? "true" : "false";
}

static void alarm_json(const struct alarm_board *board, const struct alarm_now *now, struct apc_store *store,
                       struct text *t)
{
    const struct alarm *alarm = alarm_board_alarm(board, now);
    const enum apc_alarm_state state = alarm_board_state(now);
    text_add(t, "{\"alarm\":");
    json_string_add(t, alarm->name);
    text_add(t,
             ",\"id\":%d,\"kind\":\"%s\",\"priority\":%d,\"seq\":%" PRId64 ",\"journal\":%" PRId64
             ",\"state\":\"%s\",\"active\":%s,\"unacknowledged\":%s,\"standing\":%s",
             now->row->id, apc_alarm_kind_name(alarm->is.kind), alarm->is.priority, now->row->seq,
             now->row->origin, apc_alarm_state_name(state), truth(apc_alarm_is_active(state)),
             truth(apc_alarm_is_unacked(state)), truth(apc_alarm_is_standing(state)));
    time_json("time", now->row->seq > 0 ? now->row->time : 0, t);
    author_json(store, now->row->author, t);
    time_json("shelved_until", alarm_board_shelved(now), t);
    texts_json(alarm, t);
    text_add(t, "}");
}

void get_alarms(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct alarm_board board;
    struct text *t = &r->reply;
    (void)ui;
    if (open_board(r, store, &board)) {
        const apc_ns utc = apc_clock_utc(NULL);
        text_add(t, "{\"t\":");
        json_time_add(t, utc);
        text_add(t, ",\"evaluated\":%s", truth(alarm_board_lives(&board, utc)));
        time_json("time", board.tick.seq > 0 ? board.tick.time : 0, t);
        text_add(t, ",\"alarms\":[");
        for (size_t i = 0; i < board.e.n_alarms; i++) {
            alarm_json(&board, &board.at[i], store, t);
            text_add(t, ",");
        }
        text_chop(t, ',');
        text_add(t, "]}");
    }
    alarm_board_close(&board);
}

/* ---- Journal ------------------------------------------------------------------------------ */

static void transition_json(const struct experiment *e, const struct alarm_transition *tr,
                            struct apc_store *store, struct text *t)
{
    const struct alarm *alarm = &e->alarm[tr->alarm - 1];
    text_add(t, "{\"number\":%" PRId64, tr->number);
    time_json("time", tr->time, t);
    text_add(t, ",\"alarm\":");
    json_string_add(t, alarm->name);
    text_add(t, ",\"priority\":%d,\"raised\":%s,\"state\":", alarm->is.priority, truth(alarm_is_raised(tr)));
    json_string_add(t, apc_alarm_state_name(tr->state));
    text_add(t, ",\"before\":");
    json_string_add(t, apc_alarm_state_name(tr->before));
    author_json(store, tr->author, t);
    text_add(t, "}");
}

static bool journal_range(struct request *r, struct apc_range *range)
{
    const apc_ns now = apc_clock_utc(NULL);
    int64_t last = JOURNAL_LAST;
    if (!query_time(r, "since", now, &range->since) || !query_time(r, "until", now, &range->until) ||
        !query_whole(r, "last", 1, JOURNAL_MAX, &last))
        return false;
    range->last = (size_t)last;
    return range->until == 0 || range->since < range->until ||
           fault_set(&r->fault, 400, "parameter", "since", "\"since\" must be before \"until\"");
}

void get_alarm_journal(struct ui *ui, struct request *r, struct apc_store *store)
{
    struct alarm_board board;
    struct alarm_journal journal = {0};
    struct apc_range range = {0};
    struct text *t = &r->reply;
    (void)ui;
    if (!journal_range(r, &range))
        return;
    bool ok = open_board(r, store, &board);
    const int rc = ok ? alarm_journal_load(&journal, store, board.e.n_alarms, &range) : 0;
    if (rc < 0)
        fault_store(r, rc, store);
    if (ok && rc == 0) {
        text_add(t, "{\"t\":");
        json_time_add(t, apc_clock_utc(NULL));
        text_add(t, ",\"transitions\":[");
        for (size_t i = 0; i < journal.n; i++) {
            transition_json(&board.e, &journal.at[i], store, t);
            text_add(t, ",");
        }
        text_chop(t, ',');
        text_add(t, "]}");
    }
    alarm_journal_free(&journal);
    alarm_board_close(&board);
}
