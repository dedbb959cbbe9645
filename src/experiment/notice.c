/* SPDX-License-Identifier: BSD-3-Clause */
#include "experiment.h"

#include <stdio.h>

void notice_range(const struct apc_tag *y, bool outside, double value, struct apc_event *event)
{
    event->severity = outside ? APC_EVENT_WARNING : APC_EVENT_INFO;
    snprintf(event->kind, sizeof event->kind, "measurement");
    if (outside)
        snprintf(event->text, sizeof event->text, "%.60s is %.6g, which is beyond its range, %g to %g: Bad",
                 y->name, value, y->low, y->high);
    else
        snprintf(event->text, sizeof event->text, "%.60s is within its range again", y->name);
}

void notice_event(const struct apc_notice *notice, struct apc_event *event)
{
    static const struct {
        enum apc_event_severity severity;
        const char *kind;
    } of[] = {
        [APC_NOTICE_MODE] = {APC_EVENT_INFO, "mode"},
        [APC_NOTICE_HOLD] = {APC_EVENT_WARNING, "measurement"},
        [APC_NOTICE_FAULT] = {APC_EVENT_ALARM, "measurement"},
        [APC_NOTICE_FAILED] = {APC_EVENT_ALARM, "measurement"},
        [APC_NOTICE_RECOVERED] = {APC_EVENT_INFO, "measurement"},
        [APC_NOTICE_TRIP] = {APC_EVENT_ALARM, "watchdog"},
        [APC_NOTICE_RESUMED] = {APC_EVENT_INFO, "watchdog"},
        [APC_NOTICE_REJECTED] = {APC_EVENT_WARNING, "rejected"},
        [APC_NOTICE_RIVALS] = {APC_EVENT_ALARM, "rejected"},
        [APC_NOTICE_POOR] = {APC_EVENT_INFO, "law"},
        [APC_NOTICE_SAID] = {APC_EVENT_INFO, "law"},
        [APC_NOTICE_FENCED] = {APC_EVENT_ALARM, "rejected"},
        [APC_NOTICE_CLOCK] = {APC_EVENT_WARNING, "clock"},
    };
    event->severity = of[notice->kind].severity;
    snprintf(event->kind, sizeof event->kind, "%s", of[notice->kind].kind);
    snprintf(event->text, sizeof event->text, "%s", notice->text);
}
