/* SPDX-License-Identifier: BSD-3-Clause */
/* All that the server answers to; docs/openapi.json says the same, and a test compares. */
#include "apc-ui/api/api.h"

const struct route routes[] = {
    {"GET", "/api/session", ROLE_OBSERVER, DIRECT, get_session, "", "who is logged in"},
    {"POST", "/api/login", ROLE_NONE, WRITER, post_login, "", "log in"},
    {"POST", "/api/logout", ROLE_OBSERVER, DIRECT, post_logout, "", "end the session"},
    {"GET", "/api/plant", ROLE_OBSERVER, DIRECT, get_plant, "", "variables, loops, limits"},
    {"GET", "/api/plants", ROLE_OBSERVER, PAST, get_plants, "", "the plants of the database"},
    {"GET", "/api/graphic", ROLE_OBSERVER, DIRECT, get_graphic, "", "the drawing of the plant"},
    {"GET", "/api/state", ROLE_OBSERVER, NOW, get_state, "at", "all newest values, or those of then"},
    {"GET", "/api/history", ROLE_OBSERVER, PAST, get_history, "var names since until bins last format",
     "past values"},
    {"GET", "/api/events", ROLE_OBSERVER, PAST, get_events, "since until severity kind source text last",
     "what happened"},
    {"GET", "/api/timing", ROLE_OBSERVER, PAST, get_timing, "since until task quantity", "histograms"},
    {"GET", "/api/timing/series", ROLE_OBSERVER, PAST, get_timing_series, "task quantity since until points",
     "timing against time"},
    {"GET", "/api/predictions", ROLE_OBSERVER, PAST, get_prediction, "at",
     "what predictive laws expected, and what came"},
    {"GET", "/api/alarms", ROLE_OBSERVER, PAST, get_alarms, "at", "the alarms as they stand, or stood"},
    {"GET", "/api/alarms/journal", ROLE_OBSERVER, PAST, get_alarm_journal, "since until last",
     "what the alarms did"},
    {"GET", "/api/alarms/figures", ROLE_OBSERVER, PAST, get_alarm_figures, "since until",
     "how many alarms there were"},
    {"GET", "/api/kpis", ROLE_OBSERVER, PAST, get_kpis, "since until", "what the controllers were worth"},
    {"GET", "/api/why", ROLE_OBSERVER, COMPUTED, get_why, "output at over", "why an output moved"},
    {"GET", "/api/diagnostics", ROLE_OBSERVER, DIRECT, get_diagnostics, "", "how all parts are"},
    {"GET", "/api/writes", ROLE_OBSERVER, DIRECT, get_writes, "key", "what became of writes"},
    {"POST", "/api/setpoint", ROLE_OPERATOR, WRITER, post_setpoint, "", "write a setpoint"},
    {"POST", "/api/output", ROLE_OPERATOR, WRITER, post_output, "", "write an output in mode Man"},
    {"POST", "/api/mode", ROLE_OPERATOR, WRITER, post_mode, "", "change the target mode"},
    {"POST", "/api/owner", ROLE_OPERATOR, WRITER, post_owner, "", "take a setpoint, or give it back"},
    {"POST", "/api/tuning", ROLE_ENGINEER, WRITER, post_tuning, "", "change tunings"},
    {"POST", "/api/undo", ROLE_OPERATOR, WRITER, post_undo, "", "take back one's last write"},
    {"POST", "/api/log", ROLE_OPERATOR, WRITER, post_log, "", "enter something in the log book, or sign it"},
    {"POST", "/api/alarms/{name}/ack", ROLE_OPERATOR, WRITER, post_alarm_ack, "", "acknowledge an alarm"},
    {"POST", "/api/alarms/{name}/shelve", ROLE_OPERATOR, WRITER, post_alarm_shelve, "",
     "shelve an alarm, or end that"},
    {"POST", "/api/alarms/{name}/service", ROLE_ENGINEER, WRITER, post_alarm_service, "",
     "take an alarm out of service, or put it in"},
    {"GET", "/events", ROLE_OBSERVER, STREAM, NULL, "last", "Server-Sent Events"},
    {"GET", "/metrics", ROLE_OBSERVER, DIRECT, get_metrics, "", "figures for Prometheus"},
    {"GET", "/livez", ROLE_NONE, DIRECT, get_livez, "", "the process works"},
    {"GET", "/readyz", ROLE_NONE, DIRECT, get_readyz, "", "the database answers, and all ticks"},
    {"GET", "/{file}", ROLE_OBSERVER, PAGE, NULL, NULL, "the page"}, /* any path that is none of these */
};
#define SUCCESSOR(path) path, "<" path ">; rel=\"successor-version\""
static const struct former_path former[] = {{"/api/merits", SUCCESSOR("/api/kpis")},
                                            {"/api/outlook", SUCCESSOR("/api/predictions")}};
const size_t n_routes = sizeof routes / sizeof *routes;
const struct site ui_site = {.route = routes,
                             .n = sizeof routes / sizeof *routes,
                             .former = former,
                             .n_former = sizeof former / sizeof *former,
                             .greet = model_state_json,
                             .connected = model_connected};
