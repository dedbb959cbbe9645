/* SPDX-License-Identifier: BSD-3-Clause */
/* Listing 5 of the paper: a callback function for a control module.
 * Repaired: stdlib.h and unistd.h were missing; args was freed twice. Where the listing only comments, the control
 * law is the paper's PI, and the timer runs for as many seconds as the argument says (default 60). */
#include <stdio.h>
#include <stdlib.h>
#include <libpq-fe.h>
#include <unistd.h>
#include "apctimer.h"
#include "apcshareddata.h"

typedef struct Args_control{
    void (*cfunc)();        // controller function
    void (*cfunc_update)(); // controller update function
    double Ts;              // Sampling time
    PGconn* db_conn;        // Connection to PostgreSQL database
}Args_control;

static const double Kp = 0.2, tau_i = 10.0, u_bar = 0.0, Ts_c = 2.0;
static double I = 0.0;

void cfunc(double *u, double *y, double* z_bar, PGconn* db_conn){
    /* Unpack varargin for setpoints
    Compute control signal */
    u[0] = u_bar + Kp*(z_bar[0] - y[0]) + I;
}
void cfunc_update(double *u, double *y, double* z_bar, PGconn* db_conn){
    /* Update controller */
    I += Kp*Ts_c/tau_i*(z_bar[0] - y[0]);
}
void control(union sigval sv){
    int op_mode = 0;
    char ts[27]; // timestamp
    // Dereference sigval pointer
    Args_control* args = (Args_control*)sv.sival_ptr;
    // Get operation mode
    readRecentValInt(args->db_conn, "opmode", 0, NULL, NULL, &op_mode);
    // Update control algorithm operation mode = 1 (automatic)
    if(op_mode){
        // Read setpoint and measurements from Shared Data
        // Dimensions: 1) measurements, 2) setpoints, 3) manipulated variables
        int n[3] = {1,1,1};
        readMultiRecentValsInt(args->db_conn, "dim", 3, NULL, NULL, n);
        // Measurements, setpoints, and manipulated variables
        double y[n[0]], z_bar[n[1]], u[n[2]];
        // Read only numerical values of sensor and setpoint
        readMultiRecentValsFloat(args->db_conn, "sensor", n[0], NULL, NULL, y);
        readMultiRecentValsFloat(args->db_conn, "setpoint", n[1], NULL, NULL, z_bar);
        // Control algorithm
        args->cfunc(u, y, z_bar, args->db_conn);
        genTimeStampUTC(ts); // Get current Unix time
        // Write manipulated variables to Shared Data
        for(int i = 0; i < n[2]; i++)
            insertIntoTableFloat(args->db_conn, "actuator",i+1, ts, "'ok'", u[i]);
        // Update controller
        args->cfunc_update(u, y, z_bar, args->db_conn);
    }
}
int main(int argc, char const* argv[]){
    // Interval of timer for Control module
    double Ts = 2.0; // seconds
    // Create connection to PostgreSQL database
    char conn_str[]  = "user=apc_user dbname=apc_db password=apc_password";
    PGconn *db_conn = PQconnectdb(conn_str);
    // Init tables in database using db_conn
    // (done by `apc init`; sensor and setpoint rows must be there before the first callback)
    // Create struct for controller callback function
    Args_control *args = malloc(sizeof(Args_control));
    // Fill in members of Args_control-struct
    *args = (Args_control){.cfunc = cfunc, .cfunc_update = cfunc_update, .Ts = Ts, .db_conn = db_conn};
    // Create a timer for the Controller
    timer_t* cntrTimer = create_apctimer(control, args);
    // Start the timer. Stop and delete the timer when finish (NOT SHOWN);
    start_apctimer(cntrTimer, Ts);
    sleep(argc > 1 ? atoi(argv[1]) : 60);
    stop_apctimer(cntrTimer);
    sleep(3);
    timer_delete(cntrTimer);
    // Close connection to db
    PQfinish(db_conn);
    // Free Args_control argument
    free(args);
    return 0;
}
