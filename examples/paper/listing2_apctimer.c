/* SPDX-License-Identifier: BSD-3-Clause */
/* Listing 2 of the paper: the source of apctimer. Repaired: the includes, which the listing does not show. */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

timer_t create_apctimer(void (*fnc)(), void* args){
    timer_t timerid;     // Timer identifier for POSIX.1b interval timer
    struct sigevent sev; // Structure for notification from async. routines
    memset(&sev, 0, sizeof(struct sigevent)); // Set struct members to 0
    sev.sigev_notify = SIGEV_THREAD;          // Config: Invoke callback function in new thread
    sev.sigev_notify_function = fnc;          // Callback function
    sev.sigev_value.sival_ptr = args;         // Arguments
    // Create a real-time timer  using System-wide realtime clock
    if(timer_create(CLOCK_REALTIME, &sev, &timerid) == -1){
        perror("timer_create");
    };
    return timerid;
}
int start_apctimer(timer_t timerid, double Ts){
    int sec2nsec = 1000000000; // Convert seconds to nanoseconds
    struct itimerspec ts;
    int intpart = (int)Ts;         // Integer part of interval
    double decpart = Ts - intpart; // Decimal part of interval
    memset(&ts, 0, sizeof(struct itimerspec)); // Set struct members to 0
    // Seconds and nanoseconds for timer interval
    ts.it_interval.tv_sec  = intpart;
    ts.it_interval.tv_nsec = (int)(decpart*sec2nsec);
    // Start time for timer
    ts.it_value.tv_nsec = 1;    // Start time in nanoseconds. If = 0 then timer is disabled
    if(timer_settime(timerid, 0, &ts, NULL) == -1){
        perror("timer_settime");
        return 1;
    };
    return 0;
}
int stop_apctimer(timer_t timerid){
    struct itimerspec ts;
    // Set interval and start time to 0
    memset(&ts, 0, sizeof(struct itimerspec));  // Set struct members to 0
    if(timer_settime(timerid, 0, &ts, NULL) == -1){
        perror("timer_settime");
        return 1;
    };
    return 0;
}
