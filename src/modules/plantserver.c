/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The plant's side of the link, with its own watchdog.
 *
 * The input changes at ticks only (zero-order hold), with one exception: when the watchdog trips
 * between two ticks the safe value holds from that very instant. The instant is known exactly, it is
 * the earlier of two deadlines, so the tick that follows integrates up to it with the old input and
 * from it with the safe one, however late that tick comes.
 *
 * A command is known by its stamp, the latest source time of its samples. Frames that repeat a stamp keep the
 * link alive but are no sign of life of the controller, and they never end a trip: that takes a new stamp.
 *
 * Of two connections the newer one commands, unless its client's claim is the older one: he has slept while
 * another one took his place.
 */
#include "apcsockets.h"
#include "base/base_internal.h"
#include "base/parts.h"
#include "modules/modules_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define RIVALS_AGAIN (60 * APC_NS_PER_S) /* between two notices of two clients */
/* beyond the link's limit: who lost the connection asks again within 5 s, and then needs an answer */
#define CLAIM_KEPT  (10 * APC_NS_PER_S)
#define CLOCK_APART (300 * APC_NS_PER_S) /* of a store's host and this one, as Kerberos has it */

struct apc_plantserver {
    struct apc_plant *plant;
    size_t nx, nu, ny;
    struct apc_watchdog watchdog;

    void *memory;               /* of the arrays below */
    double *safe, *low, *high;  /* [nu] */
    double *command;            /* [nu] newest accepted */
    double *input;              /* [nu] what its actuators are told */
    double *position;           /* [nu] where they stand: what the plant is being given */
    double *y, *output;         /* [ny] published; what the plant itself puts out */
    double *noise;              /* [nx] of the process */
    struct apc_random *chance;  /* [nx] where that comes from */
    struct apc_reading *sensor; /* [ny] */
    apc_status *status;         /* [ny] of y */
    apc_ns *time;               /* [ny] of y */
    struct apc_sample *samples; /* [max(nu, ny)] of the frame at hand */

    bool input_safe; /* input is the safe value */
    bool split;      /* the watchdog tripped since the last tick ... */
    apc_ns split_at; /* ... at this instant, the first of them */

    bool warm;           /* command begins as the input of a plant that is running */
    bool announced;      /* that there was a command ever was told */
    uint64_t connection; /* the newest that sent one */
    uint64_t command_id; /* of the frame of its last one */
    uint64_t claim;      /* of who commands, or did last; 0: none that counts */
    apc_ns claim_at;     /* mono of its last one */

    bool refusing;  /* told of a refused command, and none was accepted since */
    bool failing;   /* told that the plant cannot be solved */
    bool rivals;    /* told that two clients send commands ... */
    apc_ns told_at; /* ... mono, the last time */
    bool fenced;    /* told of an older claim, since the newest connection that commands */
    bool too_early; /* and of one that is refused for being ahead of the clock */
    bool ahead;     /* told that the one who commands has a claim ahead of the clock */

    const struct apc_actuator *actuator; /* [nu]; NULL: ideal ones */
    apc_ns moved_at;                     /* since the first tick: the last time that they did */

    const struct apc_disturbance *disturbance; /* those still to come */
    size_t n_disturbances;

    bool ticked;
    bool solved;                /* at the last tick */
    apc_ns began_at, ticked_at; /* mono, scheduled: the first tick; the last one */
};

static int check_world(const struct apc_plantserver_options *o, struct apc_error *why)
{
    for (size_t i = 0; o->noise && i < o->model->nx; i++) {
        if (!(o->noise[i] >= 0.0 && apc_value_ok(o->noise[i])))
            return apc_fail(why, APC_EINVAL, "plant server: noise of state %zu is %g; it must be 0 or above",
                            i + 1, o->noise[i]);
    }
    for (size_t i = 0; i < o->n_disturbances; i++) {
        const struct apc_disturbance *d = &o->disturbance[i];

        if (d->k >= o->model->nd || !apc_value_ok(d->value) || d->at < (i ? d[-1].at : 0))
            return apc_fail(
                why, APC_EINVAL,
                "plant server: change %zu of a disturbance: its number must be below %zu, its value "
                "finite, its time not before the one ahead of it",
                i + 1, o->model->nd);
    }
    const int rc = o->sensor ? apc_sensors_check(o->sensor, o->model->ny, why) : 0;
    return rc == 0 && o->actuator ? apc_actuators_check(o->actuator, o->model->nu, why) : rc;
}

static int take_plantserver_options(struct apc_plantserver_options *o,
                                    const struct apc_plantserver_options *options, struct apc_error *why)
{
    int rc = apc_options_copy(o, sizeof(*o), options, "apc_plantserver_options", why);

    if (rc < 0)
        return rc;
    if (!o->plant || !o->model)
        return apc_fail(why, APC_EINVAL, "plant server: plant and model are required");
    if (!o->model->nu || o->model->nu > APC_VECTOR_MAX || !o->model->ny || o->model->ny > APC_VECTOR_MAX)
        return apc_fail(why, APC_EINVAL,
                        "plant server: the model has %zu inputs and %zu outputs; each must be 1 to %d",
                        o->model->nu, o->model->ny, APC_VECTOR_MAX);
    if (!apc_period_ok(o->link_period) || !apc_period_ok(o->command_period))
        return apc_fail(why, APC_EINVAL,
                        "plant server: link_period and command_period must be above 0 and at most 366 days");
    return check_world(o, why);
}

static int allocate_plantserver(struct apc_plantserver *s)
{
    const size_t nu = s->nu, ny = s->ny;
    const struct apc_part parts[] = {APC_PART(s->safe, nu),      APC_PART(s->low, nu),
                                     APC_PART(s->high, nu),      APC_PART(s->command, nu),
                                     APC_PART(s->input, nu),     APC_PART(s->position, nu),
                                     APC_PART(s->y, ny),         APC_PART(s->output, ny),
                                     APC_PART(s->noise, s->nx),  APC_PART(s->samples, nu > ny ? nu : ny),
                                     APC_PART(s->chance, s->nx), APC_PART(s->sensor, ny),
                                     APC_PART(s->status, ny),    APC_PART(s->time, ny)};

    s->memory = apc_parts_allocate(parts, sizeof(parts) / sizeof(*parts));
    return s->memory ? 0 : APC_ENOMEM;
}

static const struct apc_sensor ideal = {0};

static void set_up_noise(struct apc_plantserver *s, const struct apc_plantserver_options *o)
{
    for (size_t i = 0; i < s->nx; i++) {
        char name[40];

        (void)snprintf(name, sizeof(name), "plant.noise.%zu", i + 1);
        apc_random_init(&s->chance[i], o->seed, name);
        s->noise[i] = o->noise ? o->noise[i] : 0.0;
    }
    for (size_t i = 0; i < s->ny; i++) {
        apc_reading_init(&s->sensor[i], o->sensor ? &o->sensor[i] : &ideal, o->seed, i);
        s->status[i] = APC_BAD_WAITING_FOR_INITIAL_DATA;
    }
}

static void give_command(struct apc_plantserver *s, bool safe)
{
    memcpy(s->input, safe ? s->safe : s->command, s->nu * sizeof(*s->input));
    s->input_safe = safe;
}

/* From @t on, mono, they stand where the command at hand brings them. */
static void move_actuators(struct apc_plantserver *s, apc_ns t)
{
    for (size_t i = 0; i < s->nu; i++)
        s->position[i] = s->actuator ? apc_actuator_move(&s->actuator[i], s->moved_at, t - s->began_at,
                                                         s->input[i], s->position[i])
                                     : s->input[i];
    s->moved_at = t - s->began_at;
}

int apc_plantserver_create(struct apc_plantserver **server, const struct apc_plantserver_options *options,
                           struct apc_error *why)
{
    struct apc_plantserver_options o = {0};
    struct apc_plantserver *new = NULL;
    int rc;

    if (!server)
        return apc_fail(why, APC_EINVAL, "apc_plantserver_create: server must not be NULL");
    *server = NULL;
    rc = take_plantserver_options(&o, options, why);
    if (rc < 0)
        return rc;
    new = calloc(1, sizeof(*new));
    if (!new)
        return apc_fail(why, APC_ENOMEM, "plant server: no memory");
    new->plant = o.plant;
    new->nx = o.model->nx;
    new->nu = o.model->nu;
    new->ny = o.model->ny;
    new->watchdog = apc_watchdog_make(o.link_period, o.command_period); /* tripped, until it ticks */
    rc = allocate_plantserver(new);
    if (rc < 0)
        (void)apc_fail(why, rc, "plant server: no memory");
    else
        rc = apc_limits_copy(new->low, new->high, o.low, o.high, new->nu, why);
    if (rc == 0)
        rc = apc_fallback_copy(new->safe, o.safe, new->low, new->high, new->nu, "safe", why);
    if (rc == 0 && o.initial)
        rc = apc_fallback_copy(new->command, o.initial, new->low, new->high, new->nu, "initial", why);
    if (rc < 0) {
        apc_plantserver_destroy(new);
        return rc;
    }
    set_up_noise(new, &o);
    new->disturbance = o.disturbance;
    new->n_disturbances = o.n_disturbances;
    new->warm = o.initial != NULL;
    new->actuator = o.actuator;
    give_command(new, !new->warm);
    memcpy(new->position, new->input, new->nu * sizeof(*new->position));
    *server = new;
    return 0;
}

int apc_plantserver_change(struct apc_plantserver *server, const struct apc_plantserver_options *options,
                           struct apc_error *why)
{
    struct apc_plantserver_options o = {0};
    int rc = apc_options_copy(&o, sizeof(o), options, "apc_plantserver_options", why);

    if (rc == 0 && !o.model)
        rc = apc_fail(why, APC_EINVAL, "plant server: plant and model are required");
    if (rc == 0)
        rc = check_world(&o, why);
    if (rc < 0)
        return rc;
    for (size_t i = 0; i < server->nx; i++)
        server->noise[i] = o.noise ? o.noise[i] : 0.0;
    for (size_t i = 0; i < server->ny; i++)
        server->sensor[i].sensor = o.sensor ? &o.sensor[i] : &ideal;
    server->actuator = o.actuator;
    server->disturbance = o.disturbance;
    server->n_disturbances = o.n_disturbances;
    for (; server->ticked && server->n_disturbances &&
           server->began_at + server->disturbance->at < server->ticked_at;
         server->n_disturbances--)
        server->disturbance++;
    return 0;
}

void apc_plantserver_destroy(struct apc_plantserver *server)
{
    if (!server)
        return;
    free(server->memory);
    free(server);
}

/* ---- Watchdog ------------------------------------------------------------------------------ */

/* To be asked before anything else at every tick and every request: it may have tripped in between. */
static void watch_commands(struct apc_plantserver *s, apc_ns mono, struct apc_notice *notice)
{
    const struct apc_watchdog *w = &s->watchdog;

    if (!apc_watchdog_trips(&s->watchdog, mono))
        return;
    if (!s->split) {
        s->split = true;
        s->split_at = w->deadline;
    }
    const bool link = w->deadline < w->changed + w->command;
    apc_note(notice, APC_NOTICE_TRIP, "no %s for %.3f s: plant at its safe value",
             link ? "command frame" : "new command", apc_ns_to_s(link ? w->link : w->command));
}

static bool is_usable_input(const struct apc_plantserver *s, size_t i)
{
    const struct apc_sample *u = &s->samples[i];

    return apc_status_severity(u->status) != APC_SEVERITY_BAD && apc_value_ok(u->value) &&
           u->value >= s->low[i] && u->value <= s->high[i];
}

/*
 * Nothing but a whole, usable vector counts, for the watchdog too. A refusal is told of once: a peer may send
 * as many commands as it likes, and each would be a line in the log and a row in the store.
 */
static bool acceptable(struct apc_plantserver *s, struct apc_notice *notice)
{
    char status[APC_STATUS_NAME_LEN];
    size_t i = 0;

    while (i < s->nu && is_usable_input(s, i))
        i++;
    if (i == s->nu)
        s->refusing = false;
    else if (!s->refusing)
        s->refusing = apc_note(
            notice, APC_NOTICE_REJECTED,
            "command refused: value %zu is %.15g and %s; it must be within %.15g to %.15g and not Bad", i + 1,
            s->samples[i].value, apc_status_format(s->samples[i].status, status), s->low[i], s->high[i]);
    return i == s->nu;
}

static apc_ns newest_stamp(const struct apc_plantserver *s)
{
    apc_ns stamp = s->samples[0].time;

    for (size_t i = 1; i < s->nu; i++)
        stamp = s->samples[i].time > stamp ? s->samples[i].time : stamp;
    return stamp;
}

static void take_command(struct apc_plantserver *s, apc_ns mono)
{
    for (size_t i = 0; i < s->nu; i++)
        s->command[i] = s->samples[i].value;
    apc_watchdog_take(&s->watchdog, mono, newest_stamp(s));
}

/* Two clients who both want to command take the plant from each other again and again, each by a new
 * connection. */
static void tell_of_rival_clients(struct apc_plantserver *s, apc_ns mono, struct apc_notice *notice)
{
    if (s->rivals && mono - s->told_at < RIVALS_AGAIN)
        return;
    s->told_at = mono;
    s->rivals =
        apc_note(notice, APC_NOTICE_RIVALS,
                 "command refused: another client has begun to command since; two at once take the plant "
                 "from each other: stop one");
}

static uint64_t claim_of(uint64_t id)
{
    return id < APC_FRAME_CLAIMED ? 0 : id / APC_FRAME_PER_CLAIM;
}

/* By how much a claim, a time in us, is ahead of the clock; 0: by no more than clocks may be apart. */
static apc_ns ahead_by(uint64_t claim, apc_ns utc)
{
    const uint64_t latest = utc > -CLOCK_APART ? (uint64_t)((utc + CLOCK_APART) / 1000) : 0;

    if (claim <= latest)
        return 0;
    return claim > INT64_MAX / 2000 ? INT64_MAX : (apc_ns)claim * 1000 - utc;
}

/* Is one refused for the sake of the claim that counts? @ahead: of the clock, by how much; 0: it is not. */
static bool fence_former_claim(struct apc_plantserver *s, uint64_t claim, apc_ns ahead,
                               struct apc_notice *notice)
{
    if (!s->claim || !claim || (claim >= s->claim && !ahead))
        return false;
    if (ahead && !s->too_early)
        s->too_early =
            apc_note(notice, APC_NOTICE_FENCED,
                     "command refused: its claim is %.0f s ahead of this clock; stop that client, or "
                     "set the clocks",
                     apc_ns_to_s(ahead));
    if (!ahead && !s->fenced)
        s->fenced = apc_note(notice, APC_NOTICE_FENCED,
                             "command refused: a newer claim has commanded since; stop the older client, or "
                             "set its store's clock");
    return true;
}

/* Did that client send it before it reconnected? */
static bool is_late_frame(const struct apc_plantserver *s, uint64_t id)
{
    return id <= s->command_id || (claim_of(id) && claim_of(id) == claim_of(s->command_id));
}

/* Has that client commanded since, on a connection that came earlier? A relay may hold one back with what is
 * on it. Ids of a claim begin anew, and a clock may step back, but not both at once. */
static bool is_overtaken(const struct apc_plantserver *s, uint64_t connection, uint64_t id)
{
    return connection > s->connection && claim_of(id) && claim_of(id) == claim_of(s->command_id) &&
           (s->command_id - id) % APC_FRAME_PER_CLAIM < APC_FRAME_PER_CLAIM / 2 &&
           newest_stamp(s) < s->watchdog.stamp;
}

static void keep_claim(struct apc_plantserver *s, apc_ns mono, uint64_t claim, apc_ns ahead,
                       struct apc_notice *notice)
{
    if (claim && !ahead) {
        s->claim = claim;
        s->claim_at = mono;
    }
    if (ahead && !s->ahead)
        apc_note(
            notice, APC_NOTICE_CLOCK,
            "the claim of the client that commands is %.0f s ahead of this clock: it is not compared with "
            "others; set the clocks",
            apc_ns_to_s(ahead));
    s->ahead = ahead > 0;
}

/* One that cannot be taken does not take the plant from anybody either. Returns false: refused for who sent
 * it. */
static bool take_client_command(struct apc_plantserver *s, struct apc_now now, uint64_t connection,
                                uint64_t id, struct apc_notice *notice)
{
    const uint64_t claim = claim_of(id);

    if (s->claim && now.mono - s->claim_at > s->watchdog.link + CLAIM_KEPT)
        s->claim = 0;
    /* the clock may have been put back since that claim was new */
    const apc_ns ahead = claim && claim != s->claim ? ahead_by(claim, now.utc) : 0;
    if (connection < s->connection) {
        if (!is_late_frame(s, id))
            tell_of_rival_clients(s, now.mono, notice);
        return false;
    }
    if (fence_former_claim(s, claim, ahead, notice) || is_overtaken(s, connection, id))
        return false;
    if (!acceptable(s, notice))
        return true;
    s->fenced = s->fenced && connection == s->connection;
    s->too_early = s->too_early && connection == s->connection;
    s->connection = connection;
    s->command_id = id;
    keep_claim(s, now.mono, claim, ahead, notice);
    take_command(s, now.mono);
    return true;
}

/* ---- Tick ---------------------------------------------------------------------------------- */

/* The watchdog waits for the first command as for any other. */
static void begin_serving(struct apc_plantserver *s, apc_ns mono, struct apc_notice *notice)
{
    s->began_at = mono;
    if (!s->warm || s->watchdog.ever)
        return;
    apc_watchdog_take(&s->watchdog, mono, 0);
    s->watchdog.ever = false; /* the first command is a new one, whatever its stamp */
    apc_note(notice, APC_NOTICE_RESUMED, "plant begins with its initial input");
}

/* With one input from one instant to another, piece by piece between the changes of the disturbances. */
static int hold_inputs(struct apc_plantserver *s, apc_ns from, apc_ns to)
{
    int rc = 0;

    while (from < to && rc == 0) {
        apc_ns until = to;

        for (; s->n_disturbances && s->began_at + s->disturbance->at <= from; s->n_disturbances--) {
            (void)apc_plant_disturb(s->plant, s->disturbance->k, s->disturbance->value);
            s->disturbance++;
        }
        if (s->n_disturbances && s->began_at + s->disturbance->at < to)
            until = s->began_at + s->disturbance->at;
        rc = apc_plant_advance(s->plant, apc_ns_to_s(until - from), s->position);
        from = until;
    }
    return rc;
}

static int advance_served_plant(struct apc_plantserver *s, apc_ns to)
{
    apc_ns from = s->ticked_at;
    int rc = 0;

    if (s->split && s->split_at < to) {
        rc = hold_inputs(s, from, s->split_at);
        give_command(s, true);
        from = s->split_at > from ? s->split_at : from;
        move_actuators(s, from);
    }
    if (rc == 0)
        rc = hold_inputs(s, from, to);
    for (size_t i = 0; i < s->nx && to > s->ticked_at && rc == 0; i++) {
        if (s->noise[i] > 0.0)
            rc = apc_plant_kick(s->plant, i,
                                s->noise[i] * sqrt(apc_ns_to_s(to - s->ticked_at)) *
                                    apc_random_normal(&s->chance[i]));
    }
    return rc;
}

/* A sensor that looks seldom does not wait for its next time where the plant fails, or is solved again. */
static void publish_measurements(struct apc_plantserver *s, struct apc_now now, bool solved)
{
    const apc_ns t = now.mono - s->began_at;
    const bool again = solved && !s->solved;

    if (solved)
        apc_plant_output(s->plant, s->position, s->output);
    for (size_t i = 0; i < s->ny; i++) {
        if (solved && !again && !apc_reading_due(&s->sensor[i], t))
            continue;
        if (solved)
            s->y[i] = apc_reading_take(&s->sensor[i], t, s->output[i], &s->status[i]);
        else
            s->status[i] = APC_BAD_DEVICE_FAILURE; /* y keeps the last value that there was */
        if (!solved || !s->sensor[i].frozen)
            s->time[i] = now.utc;
    }
    s->solved = solved;
}

static void report_solver(struct apc_plantserver *s, bool solved, struct apc_notice *notice)
{
    if (!solved && !s->failing)
        s->failing =
            apc_note(notice, APC_NOTICE_FAILED, "plant cannot be solved: %s", apc_plant_error(s->plant));
    else if (solved && s->failing)
        s->failing = !apc_note(notice, APC_NOTICE_RECOVERED, "plant is solved again");
}

int apc_plantserver_tick(struct apc_plantserver *server, struct apc_now now, struct apc_notice *notice)
{
    int rc = 0;

    if (notice)
        notice->kind = APC_NOTICE_NONE;
    watch_commands(server, now.mono, notice);
    if (server->ticked)
        rc = advance_served_plant(server, now.mono);
    else
        begin_serving(server, now.mono, notice);
    if (!server->ticked || now.mono > server->ticked_at)
        server->ticked_at = now.mono;
    server->ticked = true;
    publish_measurements(server, now, rc == 0);
    report_solver(server, rc == 0, notice);
    if (server->watchdog.ever && server->watchdog.commanded &&
        (server->input_safe || server->split || !server->announced))
        /* Of a tick that has something else to say it is said by the next. */
        server->announced = apc_note(notice, APC_NOTICE_RESUMED, "plant takes commands");
    give_command(server, !server->watchdog.commanded);
    move_actuators(server, server->ticked_at);
    server->split = false;
    return rc;
}

/* ---- Requests ------------------------------------------------------------------------------ */

static int reply_values(struct apc_plantserver *s, struct apc_now now, uint64_t id, char *reply, size_t size)
{
    struct apc_frame frame = {.kind = APC_FRAME_VALUES, .id = id, .n = s->ny};

    for (size_t i = 0; i < s->ny; i++) {
        s->samples[i].time = s->ticked ? s->time[i] : now.utc;
        s->samples[i].status = s->status[i];
        s->samples[i].value = s->y[i];
    }
    return apc_frame_encode(reply, size, &frame, s->samples);
}

int apc_plantserver_request(struct apc_plantserver *server, struct apc_now now, uint64_t connection,
                            const char *request, size_t length, char *reply, size_t size,
                            struct apc_notice *notice)
{
    size_t capacity = server->nu > server->ny ? server->nu : server->ny;
    struct apc_frame frame;

    if (notice)
        notice->kind = APC_NOTICE_NONE;
    watch_commands(server, now.mono, notice);
    if (apc_frame_decode(request, length, &frame, server->samples, capacity) < 0)
        return APC_EPROTO;
    /* packMultiMsg() cannot know which way it goes: the paper's client sends its command as values. */
    if ((frame.kind == APC_FRAME_COMMAND || frame.kind == APC_FRAME_VALUES) && frame.n == server->nu) {
        if (!take_client_command(server, now, connection, frame.id, notice))
            return APC_EPERM;
    } else if (frame.kind != APC_FRAME_QUERY || frame.n != 0) {
        return APC_EPROTO;
    }
    return reply_values(server, now, frame.id, reply, size);
}

const double *apc_plantserver_output(const struct apc_plantserver *server)
{
    return server->output;
}

apc_ns apc_plantserver_oldest(const struct apc_plantserver *server)
{
    apc_ns oldest = server->time[0];

    for (size_t i = 1; i < server->ny; i++)
        oldest = server->time[i] < oldest ? server->time[i] : oldest;
    return oldest;
}

const struct apc_watchdog *apc_plantserver_watchdog(const struct apc_plantserver *server)
{
    return &server->watchdog;
}

uint64_t apc_plantserver_commander(const struct apc_plantserver *server)
{
    return server->connection;
}

bool apc_plantserver_input(const struct apc_plantserver *server, double *u)
{
    memcpy(u, server->input, server->nu * sizeof(*u));
    return server->input_safe;
}
