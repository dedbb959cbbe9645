/* SPDX-License-Identifier: BSD-3-Clause */
/* Listing 1 of the paper: creating, starting, stopping, and deleting a timer. Nothing had to be repaired. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
#include <signal.h>
#include "apctimer.h"

typedef struct Args_custom{
    void (*func)();     // Function to be called inside Callback function
    double interval;    // Interval of timer
}Args_custom;
void callback(union sigval sv){
    // Dereference sigval pointer
    Args_custom* args = (Args_custom*)sv.sival_ptr;
    // Call the function
    args->func(args->interval);
}
void printInterval(double interval){
    // Print interval of timer
    printf("Interval time for this timer is %0.2f s\n", interval);
}
int main(int argc, char const* argv[]){
    // Real-time timer interval
    double interval = 2.5; // seconds
    Args_custom *timer_args = malloc(sizeof(Args_custom));
    timer_args->func        = printInterval;
    timer_args->interval    = interval;
    // Create a timer that applies "callback" as the callback function
    timer_t* timer = create_apctimer(callback, timer_args);
    // Start timer (args: timerid, period)
    start_apctimer(timer, interval);
    // Sleep for 1 min
    sleep(60);
    // Stop the timer
    stop_apctimer(timer);
    // Delete the timer
    sleep(3);
    timer_delete(timer); // From POSIX.1b timer API
    // Free Args_custom argument
    free(timer_args);
    return 0;
}
