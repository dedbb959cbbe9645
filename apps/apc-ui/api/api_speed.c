/* SPDX-License-Identifier: BSD-3-Clause */
/* How fast a simulated plant goes: asked for, and told. */
#include <math.h>
#include <time.h>

#include "apc-ui/api/api.h"
#include "common/storeuri.h"
#include "simulation/simulation.h"

#define STEPS_MOST 1000
#define PATIENCE   (2 * APC_NS_PER_S) /* for the ticks that are asked for */

struct speed_order {
    double speed;
    int64_t steps;
    apc_ns rewind; /* UTC of the plant; 0: it goes on */
};

/* Back to a time of the plant, or to its begin. */
static bool read_rewind_order(struct request *r, const json_t *body, struct speed_order *o)
{
    double t;
    if (!member_number(body, "rewind", &t, &r->fault))
        return false;
    if (json_object_size(body) > 1 || !(t > 0) || apc_ns_from_s(t, &o->rewind) < 0)
        return fault_set(&r->fault, 422, "value", "rewind",
                         "\"rewind\" must be a time of the plant, without \"speed\" and \"steps\"");
    o->rewind = o->rewind < SIMULATION_BEGIN ? SIMULATION_BEGIN : o->rewind;
    return true;
}

/* A speed, null: as fast as it goes; of a paused plant so many ticks. */
static bool read_speed_order(struct request *r, const json_t *body, struct speed_order *o)
{
    *o = (struct speed_order){.speed = HUGE_VAL};
    if (json_object_get(body, "rewind"))
        return read_rewind_order(r, body, o);
    if (!json_is_null(json_object_get(body, "speed")) && !member_number(body, "speed", &o->speed, &r->fault))
        return false;
    if (json_object_get(body, "steps") && !member_whole(body, "steps", 1, STEPS_MOST, &o->steps, &r->fault))
        return false;
    if (!(o->speed >= 0 && (o->speed <= SPEED_MOST || isinf(o->speed))))
        return fault_set(&r->fault, 422, "value", "speed",
                         "\"speed\" must be from 0 (paused) to %d, or null: as fast as possible", SPEED_MOST);
    return o->steps == 0 || o->speed == 0 ||
           fault_set(&r->fault, 422, "value", "steps",
                     "\"steps\" are of a paused plant: \"speed\" must be 0");
}

/* Whoever asks for ticks is told of what they made; where they take longer, of how many are left. */
static void await_steps(struct apc_store *store)
{
    const apc_ns until = apc_clock_mono(NULL) + PATIENCE;
    struct apc_store_clock clock = {.size = sizeof clock};
    while (apc_store_clock(store, &clock) > 0 && clock.asked == 0 && clock.steps > 0 &&
           apc_clock_mono(NULL) < until)
        nanosleep(&(struct timespec){.tv_nsec = 2 * APC_NS_PER_MS}, NULL);
}

static int give_speed_order(struct apc_store *store, const struct speed_order *o)
{
    return o->rewind > 0 ? apc_store_rewind(store, o->rewind)
                         : apc_store_set_speed(store, o->speed, (uint64_t)o->steps);
}

static void set_asked_speed(struct ui *ui, struct request *r, const struct speed_order *o,
                            struct apc_store *store)
{
    struct apc_store_clock clock;
    struct apc_error why;
    int rc = model_simulated(&ui->model, store, &clock, &why);
    if (rc == APC_ESTATE)
        fault_set(&r->fault, 409, "simulation", NULL, "%.200s", why.text);
    else if (rc == 0)
        fault_set(&r->fault, 409, "simulation", NULL, "the plant is not simulated: its time is real");
    else if (rc > 0 && o->rewind > clock.now)
        fault_set(&r->fault, 409, "simulation", "rewind", "the plant has not come to that time yet");
    else if (rc < 0 || (rc = give_speed_order(store, o)) < 0)
        fault_store(r, rc, store);
    else if (o->steps > 0)
        await_steps(store);
}

void post_speed(struct ui *ui, struct request *r, struct apc_store *store)
{
    static const char *const members[] = {"speed", "steps", "rewind", NULL};
    struct speed_order o;
    json_t *body = body_parse(r->body, r->n, members, &r->fault);
    const bool ok = body && read_speed_order(r, body, &o);
    json_decref(body);
    if (!ok || !request_may_write(ui, r))
        return;
    const int rc = apc_store_connect(store);
    if (rc < 0)
        fault_store(r, rc, store);
    else
        set_asked_speed(ui, r, &o, store);
    if (r->fault.http)
        return;
    (void)model_look_simulated(&ui->model, store);
    pthread_mutex_lock(&ui->model.mutex);
    simulated_json(&ui->model, &r->reply);
    pthread_mutex_unlock(&ui->model.mutex);
}
