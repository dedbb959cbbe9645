/* SPDX-License-Identifier: BSD-3-Clause */
/* What the page asks for, a function for each route. */
#ifndef APC_UI_API_H
#define APC_UI_API_H

#include "apc-ui/server/http.h"

/* route.c: all that there is */
extern const struct route routes[];
extern const size_t n_routes;
extern const struct site ui_site;

void get_plant(struct ui *ui, struct request *r, struct apc_store *store);
/* The store as of the parameter "at", to be closed; NULL: the fault is set. */
struct apc_store *request_past(struct request *r, struct apc_store *store);
/* Members: now, then, and what the record cannot tell of then. */
void past_members(struct apc_store *past, struct text *t);
void state_then(struct ui *ui, struct request *r, struct apc_store *store);
void get_graphic(struct ui *ui, struct request *r, struct apc_store *store);
void get_displays(struct ui *ui, struct request *r, struct apc_store *store);
void get_display(struct ui *ui, struct request *r, struct apc_store *store);
void post_display(struct ui *ui, struct request *r, struct apc_store *store);
void get_trends(struct ui *ui, struct request *r, struct apc_store *store);
void post_trend(struct ui *ui, struct request *r, struct apc_store *store);
void get_state(struct ui *ui, struct request *r, struct apc_store *store);
void get_diagnostics(struct ui *ui, struct request *r, struct apc_store *store);
void get_history(struct ui *ui, struct request *r, struct apc_store *store);
void get_events(struct ui *ui, struct request *r, struct apc_store *store);
void get_timing(struct ui *ui, struct request *r, struct apc_store *store);
void get_timing_series(struct ui *ui, struct request *r, struct apc_store *store);
void get_prediction(struct ui *ui, struct request *r, struct apc_store *store);
void get_alarms(struct ui *ui, struct request *r, struct apc_store *store);
void get_alarm_journal(struct ui *ui, struct request *r, struct apc_store *store);
void get_alarm_figures(struct ui *ui, struct request *r, struct apc_store *store);
void get_alarm_trial(struct ui *ui, struct request *r, struct apc_store *store);
/* The file of the addresses of plants. Returns 0, where there is none too, or an error in why. */
int plants_check(const char *path, struct apc_error *why);
void get_plants(struct ui *ui, struct request *r, struct apc_store *store);
void get_why(struct ui *ui, struct request *r, struct apc_store *store);
void get_health(struct ui *ui, struct request *r, struct apc_store *store);
void get_model(struct ui *ui, struct request *r, struct apc_store *store);
void get_signals(struct ui *ui, struct request *r, struct apc_store *store);
/* "u1,u2" into its parts, 5 at most, cut in place: @p name[@p n] within *@p copy, to be freed. False: the fault is set. */
bool split_signals(struct request *r, const char *field, char **copy, char *name[], size_t *n);
void get_preview(struct ui *ui, struct request *r, struct apc_store *store);
/* The experiment that the store describes, without laws of the user's own. False: the fault is set. */
bool request_experiment(struct request *r, struct experiment *e, struct apc_store *store);
/* Two members: of each part of a curve the least and the most value, as they came. @p at: their times, s; NULL: one each
 * @p Ts. */
void curve_json(const char *name, const double *at, double Ts, const double *v, size_t n, struct text *t);
void get_shadow(struct ui *ui, struct request *r, struct apc_store *store);
void post_promote(struct ui *ui, struct request *r, struct apc_store *store);
/* The plant as it is described now; known_free(). Returns 0 or APC_ENOMEM. */
int copy_model_plant(struct ui *ui, struct known_plant *to);
void get_kpis(struct ui *ui, struct request *r, struct apc_store *store);
void post_alarm_ack(struct ui *ui, struct request *r, struct apc_store *store);
void post_alarm_shelve(struct ui *ui, struct request *r, struct apc_store *store);
void post_alarm_service(struct ui *ui, struct request *r, struct apc_store *store);
void get_writes(struct ui *ui, struct request *r, struct apc_store *store);
void post_setpoint(struct ui *ui, struct request *r, struct apc_store *store);
void post_output(struct ui *ui, struct request *r, struct apc_store *store);
void post_mode(struct ui *ui, struct request *r, struct apc_store *store);
void post_owner(struct ui *ui, struct request *r, struct apc_store *store);
void post_tuning(struct ui *ui, struct request *r, struct apc_store *store);
void post_speed(struct ui *ui, struct request *r, struct apc_store *store);
void get_faults(struct ui *ui, struct request *r, struct apc_store *store);
void post_fork(struct ui *ui, struct request *r, struct apc_store *store);
/* To the same process, which begins anew: the second runs that go on. Between the two none is started. Returns 0 or -1. */
int forks_keep(void);
void forks_resume(void);
void post_fault(struct ui *ui, struct request *r, struct apc_store *store);
void post_log(struct ui *ui, struct request *r, struct apc_store *store);
/* What differs of variables, loops, controllers called @names, with commas between them, NULL or "": of all; the
 * changes to be freed. False: the fault is set. */
bool request_retake(struct request *r, struct apc_store *store, struct apc_store *past, const char *names,
                    struct operation *o);
void get_retake(struct ui *ui, struct request *r, struct apc_store *store);
void post_retake(struct ui *ui, struct request *r, struct apc_store *store);
void post_undo(struct ui *ui, struct request *r, struct apc_store *store);
/* The time of a write, UTC. False: the fault is set. */
bool request_time(struct request *r, const json_t *body, const char *member, apc_ns *time);
void get_waiting(struct ui *ui, struct request *r, struct apc_store *store);
void post_approve(struct ui *ui, struct request *r, struct apc_store *store);
void post_refuse(struct ui *ui, struct request *r, struct apc_store *store);
void get_metrics(struct ui *ui, struct request *r, struct apc_store *store);
void get_livez(struct ui *ui, struct request *r, struct apc_store *store);
void get_readyz(struct ui *ui, struct request *r, struct apc_store *store);
/* Which thread has not begun a round for far too long, or NULL. */
const char *stuck_thread(const struct ui *ui);

#endif
