/* SPDX-License-Identifier: BSD-3-Clause */
/* What Listings 4 and 6 share: the struct of Listing 6, which Listing 4 uses too. */
#ifndef SIM_PLANT_H
#define SIM_PLANT_H

#include <signal.h>

struct varargin{
    void *args; // Vector of arguments
    int nargs;  // Number of arguments
};
typedef struct Args_sim_plant{
    void (*ffunc)();            // x' = f(t, x, args)
    void (*gfunc)();            // 0  = g(t, x, args)
    struct varargin arg_vec;    // argument vector for f and g
    double Ts;                  // sampling time
    double *x;                  // states
    double *y;                  // measurements
    double *u;                  // manipulated variables
    int *n;                     // dimensions: (states, outputs, inputs)
    void (*odesolver)();        // ODE solver function
    int N;                      // Number of steps in ODE solver
}Args_sim_plant;

/* Listing 6 */
void ffunc(double t, double* x, double* dx, double* varargin);
void gfunc(double* x, double* y, double* varargin);
void odesolver( void (*ffunc)(), double t0,  double tN, int N,
                double* x0,int nx,double* varargin,
                double (*X)[N+1],  double T[N]);
void simulator(union sigval sv);

#endif
