/* SPDX-License-Identifier: BSD-3-Clause */
#include "health_json.h"

#include <math.h>

void health_evidence(const struct health *h, struct text *t)
{
#define AND (t->n > 0 ? "; " : "")
    if (h->verdict == HEALTH_SENSOR && h->still > 0)
        text_add(t, "%sit did not change for %.4g s", AND, h->still);
    if (h->verdict == HEALTH_SENSOR && h->jumps > 0)
        text_add(t, "%s%.2g %% of its rows jump off and back", AND, 100 * h->jumps);
    if (h->verdict == HEALTH_SENSOR && h->step > 0)
        text_add(t, "%sits steps are %.3g", AND, h->step);
    if (h->verdict == HEALTH_VALVE)
        text_add(t, "%sfriction of %.2g leaves %.2g %% less unexplained, in each half of the record", AND,
                 h->friction, 100 * h->explained);
    if (h->verdict == HEALTH_UNKNOWN && h->n < HEALTH_TICKS)
        text_add(t, "%s%zu ticks can be judged, %d take %.4g s", AND, h->n, HEALTH_TICKS, h->least);
    if (!isnan(h->swing))
        text_add(t, "%sit oscillates with a period of %.3g s", AND, h->swing);
    if (!isnan(h->lasting))
        text_add(t, "%sits correlation falls to %.0f %% over many periods", AND, 100 * fmin(1, h->lasting));
    text_put(t, "", 1);
}

void health_members(const struct kpis_loop *l, struct text *t)
{
    const struct health *h = &l->health;
    struct text evidence = {0};
    health_evidence(h, &evidence);
    json_add(t, "loop:%s, health:%s, words:%s, evidence:%-s, ticks:%zu, service:%g, at_low:%g, at_high:%g",
             l->name, health_name(h->verdict), health_words(h->verdict), evidence.at ? evidence.at : "", h->n,
             l->service, l->low, l->high);
    json_add(t, "index:%g, oscillation_s:%g, regularity:%g, lasting:%g, friction:%g, explained:%g", h->index,
             h->swing, h->regularity, h->lasting, h->friction, h->explained);
    json_add(t, "still_s:%g, jumps:%g, step:%g, travel_per_h:%g, reversals_per_h:%g", h->still, h->jumps,
             h->step, h->travel, h->reversals);
    text_free(&evidence);
}
