/* SPDX-License-Identifier: BSD-3-Clause */
/* An experiment in virtual time, with an operator: run FILE. Prints how well each loop was controlled. */
#include <apcrun.h>
#include <stdio.h>

int main(int argc, char **argv)
{
    struct apc_experiment *e = NULL;
    struct apc_simulation *s = NULL;
    struct apc_figure figure[64] = {{.size = sizeof *figure}};
    struct apc_error why;
    int n = 0, rc = apc_experiment_load(&e, argc > 1 ? argv[1] : "experiments/first-order.conf", NULL, &why);

    if (rc == 0)
        rc = apc_simulation_create(&s, e, NULL, &why);
    if (rc < 0)
        fprintf(stderr, "%s\n", why.text);
    if (rc == 0 && (rc = apc_simulation_run(s, 100.5)) == 0 && /* between two ticks, as operators are */
        (rc = apc_simulation_mode(s, "controller", APC_MODE_MAN)) ==
            0 && /* the output stays where it is ... */
        (rc = apc_simulation_run(s, 120.5)) == 0 &&
        (rc = apc_simulation_mode(s, "controller", APC_MODE_AUTO)) == 0 && /* ... and no bump back */
        (rc = apc_simulation_write(s, "r", 12.0)) == 0 && (rc = apc_simulation_run(s, 0)) == 0)
        n = apc_simulation_figures(s, figure, 64);
    else if (s)
        fprintf(stderr, "%s\n", apc_simulation_error(s));
    for (int i = 0; i < n && i < 64; i++)
        printf("%s  %-12s from %g s: IAE %.6g\n", figure[i].loop, figure[i].event, figure[i].from,
               figure[i].iae);
    apc_simulation_destroy(s);
    apc_experiment_destroy(e);
    return rc < 0;
}
