/* SPDX-License-Identifier: BSD-3-Clause */
/* Listing 4 of the paper: a server connected to a real-time simulator.
 * Repaired: unistd.h was missing. Where the listing says NOT SHOWN, this makes the plant of the paper's experiment
 * and runs Listing 6 on a timer beside the server. The listing takes a client that has gone for one that says
 * nothing (read() < 0 is never true at end of file): an alarm ends the program after as many seconds as its
 * argument says (default 60). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <libpq-fe.h>
#include <sys/time.h>
#include <pthread.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>
#include "apcshareddata.h"
#include "apcsockets.h"
#include "apctimer.h"
#include "sim_plant.h"

// Mutex for writing/reading of measurements
pthread_mutex_t mutex;

void server(Args_sim_plant* args, int sock_conn){
    // Init buffers for sending and receiving messages
    char buff_recv[1024] = {0}, buff_send[1024] = {0};
    char ts[27]; // timestamp
    // Arrays for storing numerical values, timestamps, and status codes
    double y[args->n[1]], u[args->n[2]];
    char ts_send[args->n[1]][1024], stat_send[args->n[1]][1024];
    char ts_recv[args->n[2]][1024], stat_recv[args->n[2]][1024];
    while(1){
        // Read string message from the Client
        if (read(sock_conn, buff_recv, 1024) < 0){
            printf("Client disconnected...\n");
            break;
        };
        // Insert numerical values for actuator from the Client into arrays
        unpackMultiMsg(ts_recv, stat_recv, u, buff_recv);
        for(int i = 0; i < args->n[2]; i++)
            args->u[i] = u[i];
        // Lock shared memory
        pthread_mutex_lock(&mutex);
        // Get measurements with timestamps and status
        for(int j = 0; j < args->n[1]; j++){
            genTimeStampUTC(ts);
            y[j] = args->y[j];
            strcpy(ts_send[j], ts);
            strcpy(stat_send[j], "'ok'"); // Write status code
        }
        // Unlock shared memory
        pthread_mutex_unlock(&mutex);
        // Pack sensor data as string.
        memset(buff_send, 0, sizeof(buff_send));
        packMultiMsg(buff_send, args->n[1], ts_send, stat_send, y);
        // Send string message to the Client
        if (send(sock_conn, buff_send, strlen(buff_send), MSG_NOSIGNAL) < 0){
            printf("Client disconnected...\n");
            break;
        }
    }
}
int main(int argc, char const* argv[]){
    // Create a custom struct for the Server and the Simulator callback
    Args_sim_plant *argsSimulator = malloc(sizeof(Args_sim_plant));
    // Fill in members of Args_sim_plant-struct (NOT SHOWN)
    double param[2] = {10.0, 10.0}; // K, tau
    double x[1] = {0}, y[1] = {0}, u[1] = {0};
    int n[3] = {1, 1, 1};
    *argsSimulator = (Args_sim_plant){.ffunc = ffunc, .gfunc = gfunc, .arg_vec = {param, 2}, .Ts = 0.2,
                                      .x = x, .y = y, .u = u, .n = n, .odesolver = odesolver, .N = 10};
    alarm(argc > 1 ? atoi(argv[1]) : 60);
    pthread_mutex_init(&mutex, NULL);
    timer_t *simTimer = create_apctimer(simulator, argsSimulator);
    start_apctimer(simTimer, argsSimulator->Ts);
    // Init server
    int server_fd, new_fd;
    // Length of queue for clients (Number chosen arbitrarily)
    int client_queue = 3;
    server_fd = server_init();
    // Listening for clients
    server_listen(server_fd, client_queue);
    // Accept client communication with the Server
    new_fd = server_accept(server_fd);
    // Start the Server
    server(argsSimulator, new_fd);
    // Close socket
    close(new_fd);
    // Free argsSimulator (NOT SHOWN)
    stop_apctimer(simTimer);
    sleep(3);
    timer_delete(simTimer);
    free(argsSimulator);
    return 0;
}
