/* SPDX-License-Identifier: BSD-3-Clause */
/* The three standard streams of a program. */
#ifndef APC_STREAMS_H
#define APC_STREAMS_H

/*
 * Keep 0, 1 and 2 for the standard streams, before anything else is opened: where a program is started
 * without one, its number would be that of the next file or connection, and what is said would be written
 * into that. Results that are written to no stdout fail, as before; what is said to no stderr is lost.
 * Programs call it first.
 */
void streams_keep(void);

#endif
