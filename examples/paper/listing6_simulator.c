/* SPDX-License-Identifier: BSD-3-Clause */
/* Listing 6 of the paper: a callback function for a real-time simulator, with the plant of the paper's experiment
 * and explicit Euler steps where the listing only comments. Its structs stand in sim_plant.h, because Listing 4
 * needs them too; its main is that of Listing 4, with which it shares them. Nothing else had to be repaired. */
#include <stdio.h>
#include <stdlib.h>
#include <signal.h>
#include <libpq-fe.h>
#include "apctimer.h"
#include "apcshareddata.h"
#include "sim_plant.h"

void ffunc(double t, double* x, double* dx, double* varargin){
    /* Unpack parameters and manipulated variables from varargin */
    double K = varargin[0], tau = varargin[1], u = varargin[2];
    /* Compute dx/dt */
    dx[0] = (-x[0] + K*u)/tau;
}
void gfunc(double* x, double* y, double* varargin){
    /* Unpack parameters and manipulated variables from varargin */
    /* Compute y */
    y[0] = x[0];
}
void odesolver( void (*ffunc)(), double t0,  double tN, int N,
                double* x0,int nx,double* varargin,
                double (*X)[N+1],  double T[N]){
    // Compute the solution T, X
    double h = (tN - t0)/N, x[nx], dx[nx];
    for(int i = 0; i < nx; i++)
        X[i][0] = x[i] = x0[i];
    for(int k = 0; k < N; k++){
        T[k] = t0 + k*h;
        ffunc(T[k], x, dx, varargin);
        for(int i = 0; i < nx; i++)
            X[i][k+1] = x[i] += h*dx[i];
    }
}
void simulator(union sigval sv){
    // Dereference sigval pointer
    Args_sim_plant* args = (Args_sim_plant*)sv.sival_ptr;
    // Number of states and manipulated variables
    int nx = args->n[0], nu = args->n[2];
    // ODE solver configurations
    int N = args->N; // Steps for ODE solver
    double X[nx][N+1], T[N+1];      // Arrays for ode solution
    double t0 = 0.0, tf = args->Ts; // Integration time
    double *arg = args->arg_vec.args;
    int nargs   = args->arg_vec.nargs;
    // Init vector for parameters and manipulated variables
    double varargin[nargs+nu];
    // Parameters
    for(int i = 0; i < nargs; i++)
        varargin[i] = arg[i];
    // Manipulated variables
    for(int k = 0; k < nu; k++)
        varargin[nargs+k] = args->u[k];
    // Solve ODE from timspan [t0 tf] with N steps
    args->odesolver(args->ffunc, t0, tf, N, args->x, nx, varargin, X, T);
    // Update the states
    for(int j = 0; j < nx; j++)
        args->x[j] = X[j][N];
    // Compute measurements
    args->gfunc(args->x, args->y, varargin);
}
