/* SPDX-License-Identifier: BSD-3-Clause */
/* What a core noticed, as an event for the records. */
#ifndef APC_NOTICE_H
#define APC_NOTICE_H

#include <apcmodules.h>
#include <apcshareddata.h>

/* Severity, kind and text; the kind of notice must not be APC_NOTICE_NONE. */
void notice_event(const struct apc_notice *notice, struct apc_event *event);

#endif
