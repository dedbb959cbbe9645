/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * One PID loop, for the laws made of such loops. With r the setpoint, y the measurement and h the period:
 *
 *     P_k = Kp (b r_k - y_k)
 *     D_k = Kp tau_d (c r'_k - y'_k)
 *     y'_k = a y'_{k-1} + (1 - a) (y_k - y_{k-1}) / h, r' likewise,     a = tau_d / (tau_d + N h)
 *     v_k = u_bar + P_k + I_k + D_k + feed-forward
 *     u_k = v_k within u_min..u_max, then within u_{k-1} -+ du_max h
 *     I_{k+1} = I_k + Kp h / tau_i (r_k - y_k)                       + h / tau_t (u_k - v_k)
 *
 * The derivative's filter is a backward difference, the integral a forward one, as in TrueTime's and most
 * textbooks' PID. What is kept of it are slopes of y and r, not D, so that a change of Kp, tau_d or N finds
 * them as they are: no part of the former D remains to die out. Without tau_t the integral is conditional
 * instead: it leaves out an increment that would drive an output further out that is already cut. Without
 * tau_i there is no integral, and I is what a bumpless change has left: it dies out with tau_t, or, where
 * that is 0, in PID_FADE periods.
 */
#ifndef APC_PID_LOOP_H
#define APC_PID_LOOP_H

#include "apccontrol.h"

enum {
    PID_KP,
    PID_TAU_I,
    PID_TAU_D,
    PID_N,
    PID_B,
    PID_C,
    PID_TAU_T,
    PID_U_BAR,
    PID_U_MIN,
    PID_U_MAX,
    PID_DU_MAX
};

#define PID_TUNING 11
#define PID_PARAMS(of)                                                                                       \
    {of "Kp", "", "proportional gain", 1.0, -1e6, 1e6},                                                      \
        {of "tau_i", "s", "integral time; 0: no integral", 10.0, 0.0, 1e9},                                  \
        {of "tau_d", "s", "derivative time", 0.0, 0.0, 1e9},                                                 \
        {of "N", "", "derivative filter: its time constant is tau_d / N", 10.0, 1.0, 1e6},                   \
        {of "b", "", "setpoint weight of the proportional part", 1.0, 0.0, 10.0},                            \
        {of "c", "", "setpoint weight of the derivative part", 0.0, 0.0, 10.0},                              \
        {of "tau_t", "s", "anti-windup: tracking time; 0: conditional integration", 0.0, 0.0, 1e9},          \
        {of "u_bar", "", "output at the operating point", 0.0, -1e9, 1e9},                                   \
        {of "u_min", "", "output low limit", -1e9, -1e9, 1e9},                                               \
        {of "u_max", "", "output high limit", 1e9, -1e9, 1e9},                                               \
    {                                                                                                        \
        of "du_max", "1/s", "fastest change of the output; 0: any", 0.0, 0.0, 1e9                            \
    }

#define PID_STATES 6
#define PID_FADE   20.0

struct pid_loop {
    const double *p; /* [PID_TUNING] */
    double *x;       /* [PID_STATES] */
    double h;        /* period in s */
    double r, y, feed_forward;
};

void apc_pid_reset(const struct pid_loop *l);
/* v: the output that the loop wants. */
double apc_pid_wanted(const struct pid_loop *l);
/* What it is the sum of. Returns how many. */
size_t apc_pid_loop_terms(const struct pid_loop *l, struct apc_law_term *term, size_t most);
/* What the limits leave of it; notes in *limited what they cut. */
double apc_pid_limit(const struct pid_loop *l, double wanted, unsigned *limited);
/* The state for the next tick, u being what went out. An increment of the integral that way in which its
 * consumer cannot follow (enum apc_limited) is left out. */
void apc_pid_update(const struct pid_loop *l, double u, unsigned held);
/* A state from which the loop wants u. */
void apc_pid_track(const struct pid_loop *l, double u, bool gap);

#endif
