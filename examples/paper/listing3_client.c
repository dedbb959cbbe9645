/* SPDX-License-Identifier: BSD-3-Clause */
/* Listing 3 of the paper: a client that connects to a server at local-host with port number 43051.
 * Repaired: conn_str and timer were not declared; unistd.h was missing. Where the listing says NOT SHOWN, this
 * runs for as many seconds as its argument says (default 60). */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <libpq-fe.h>
#include <signal.h>
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>
#include "apctimer.h"
#include "apcshareddata.h"
#include "apcsockets.h"

typedef struct Args_client{
    int sock_conn;      // Connection to socket Server
    PGconn* db_conn;    // Connection to PostgreSQL database (Shared Data)
}Args_client;
void client(union sigval sv){
    // Init buffers for sending and receiving messages
    char buff_send[1024] = {0}, buff_recv[1024] = {0};
    // Dereference pointer to timer data struct
    Args_client* args = (Args_client*)sv.sival_ptr;
    // Dimensions {1) measurements, 2) setpoints, 3) manipulated variables}
    int n[3] = {1,1,1};
    // Read number of inputs and outputs from database
    readMultiRecentValsInt(args->db_conn, "dim", 3, NULL, NULL, n);
    // Arrays for storing numerical values, timestamps, status codes
    double y[n[0]], u[n[2]];
    char ts_send[n[2]][1024], stat_send[n[2]][1024]; // timestamp and status
    char ts_recv[n[0]][1024], stat_recv[n[0]][1024]; // timestamp and status
    // Read actuator values from the Shared Data
    readMultiRecentValsFloat(args->db_conn, "actuator", n[2], ts_send, stat_send, u);
    // Pack actuator data as a string.
    memset(buff_send, 0, sizeof(buff_send));
    packMultiMsg(buff_send, n[2], ts_send, stat_send, u);
    // Send string message to the Server
    send(args->sock_conn, buff_send, strlen(buff_send), MSG_NOSIGNAL);
    // Init and read string message from the Server
    memset(buff_recv, 0, sizeof(buff_recv));
    read(args->sock_conn, buff_recv, 1024);
    // Unpack sensor data from the Server into arrays
    unpackMultiMsg(ts_recv, stat_recv, y, buff_recv);
    // Write sensor data from the Server to the Shared Data
    for(int i = 0; i < n[0]; i++)
        insertIntoTableFloat(args->db_conn, "sensor", i+1, ts_recv[i], stat_recv[i], y[i]);
}
int main(int argc, char const* argv[]){
    // Get the ip-address and port number of the Server
    char serv_ip[128] = "127.0.0.1"; // Local-host
    int portnumber = 43051; // Example of Port number
    // Real-time timer interval
    double interval = 1.0; // seconds
    // Create connection to PostgreSQL database using conn_str.
    char conn_str[] = "user=apc_user dbname=apc_db password=apc_password";
    PGconn *db_conn = PQconnectdb(conn_str);
    // Init tables in database using db_conn
    // (done by `apc init`; an actuator row must be there before the first command)
    // Create file descriptor for client
    int client_fd = client_init();
    // Connect to the Server (args: IP address, portnumber)
    client_connect(client_fd, serv_ip, portnumber);
    // Create Args_client-struct for the Client callback
    Args_client *args = malloc(sizeof(Args_client));
    args->sock_conn = client_fd;
    args->db_conn   = db_conn;
    // Create a timer for the Client module
    timer_t* timer = create_apctimer(client, args);
    // Start timer (args: timerid, period)
    start_apctimer(timer, interval);
    // Stop and delete timer and free "args" (NOT SHOWN)
    sleep(argc > 1 ? atoi(argv[1]) : 60);
    stop_apctimer(timer);
    sleep(3);
    timer_delete(timer);
    free(args);
    // Close socket
    close(client_fd);
    PQfinish(db_conn);
    return 0;
}
