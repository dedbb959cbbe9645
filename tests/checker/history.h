/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What happened to a store, and whether that may happen. A history is a folder of text files; each line is
 * one row of one variable, and nothing else:
 *
 *   writer-*.log   a TABLE ID SEQ VALUE    attempt: about to be appended
 *                  k TABLE ID SEQ VALUE    acknowledged
 *                  x TEXT                  something that must not happen, in words
 *   reader-*.log   r TABLE ID SEQ VALUE    read as the newest
 *   stored-*.log   s TABLE ID SEQ VALUE    in the store at the end, in the order of its history
 *   ring           if there: the store keeps the newest rows of each variable only, and what is older than
 *                  the oldest stored one is not looked for
 *
 * What must hold: acknowledged is stored, with the same value; stored was attempted; no row stands twice and
 * seq rises strictly; nobody acknowledges a seq twice with different values; no reader sees a variable's seq
 * fall, nor a value change under its seq, nor what is not stored at the end.
 */
#ifndef APC_TEST_HISTORY_H
#define APC_TEST_HISTORY_H

#include <stddef.h>

struct history_counts {
    size_t attempted, acknowledged, stored, read, violations;
};

/* Check the history of a folder. Each violation is said on stderr (the first twenty). Returns 0, or -1 when
 * the files cannot be read. */
int history_check(const char *dir, struct history_counts *counts);

#endif
