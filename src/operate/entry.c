/* SPDX-License-Identifier: BSD-3-Clause */
#include "operate.h"

static bool is_in_mode(const struct apc_sample *row, enum apc_mode mode)
{
    return row->seq > 0 && row->value == (double)mode;
}

/* What holds in the mode that was asked for. */
static const struct entry_note *note_of_output(apc_status status)
{
    static const struct entry_note held = {"held", "the output is held until its inputs return"};
    static const struct entry_note limits[] = {{NULL, NULL},
                                               {"low", "the output is at its low limit"},
                                               {"high", "the output is at its high limit"},
                                               {"both", "limits hold the output both ways"}};
    const unsigned limited = status >> 8 & 3;
    return status == APC_UNCERTAIN_LAST_USABLE ? &held : limited ? &limits[limited] : NULL;
}

const struct entry_note *entry_note(const struct entry_seen *s)
{
    static const struct entry_note stopped = {"stopped", "its controller does not tick"};
    static const struct entry_note safe = {"safe", "the plant is at its safe value and takes no output"};
    static const struct entry_note oos = {"oos", "the loop is out of service: nothing goes out"};
    static const struct entry_note shadow = {"shadow", "another controller acts: this loop moves nothing"};
    static const struct entry_note tracking = {"tracking",
                                               "the output tracks what takes it, until that does"};
    static const struct entry_note fault = {"fault", "the output is at its fault value"};
    static const struct entry_note backup = {"backup", "the backup law acts"};
    static const struct entry_note man = {"man", "the loop is in Man: no setpoint moves it"};
    static const struct entry_note shed = {"shed", "no setpoint from above: the loop keeps its own"};

    return s->stopped                                                   ? &stopped
           : s->safe && s->output.table == APC_ACTUATOR                 ? &safe
           : s->target.seq == 0 || is_in_mode(&s->target, APC_MODE_OOS) ? &oos
           : is_in_mode(&s->actual, APC_MODE_OOS)                       ? &shadow
           : is_in_mode(&s->actual, APC_MODE_IMAN)                      ? &tracking
           : is_in_mode(&s->actual, APC_MODE_LO)                        ? &fault
           : s->actual.status == APC_GOOD_LOCAL_OVERRIDE                ? &backup
           : is_in_mode(&s->actual, APC_MODE_MAN)                       ? &man
           : is_in_mode(&s->target, APC_MODE_CAS) && is_in_mode(&s->actual, APC_MODE_AUTO)
               ? &shed
               : note_of_output(s->output.status);
}

void entry_note_json(const struct entry_note *note, struct text *t)
{
    if (note)
        json_add(t, "{code:%s, text:%s}", note->code, note->text);
    else
        json_add(t, "null");
}
