/* SPDX-License-Identifier: BSD-3-Clause */
/* apc_qp on its way: which row is violated most, measured in w. */
#include "predict/qp_internal.h"

double qp_violation_of(const struct apc_qp *qp, size_t i, double *sign)
{
    double above = qp->value[i] - qp->high[i], below = qp->low[i] - qp->value[i];
    double much = above >= below ? above : below;

    *sign = above >= below ? 1.0 : -1.0;
    return much > 0.0 && much > qp_allowance(qp, above >= below ? qp->high[i] : qp->low[i]) ? much : 0.0;
}

/** How far a row of F is within the limit that it is fixed beyond; 0 within its allowance. */
static double fixed_row_slack(const struct apc_qp *qp, size_t i, double *sign)
{
    double limit = qp->state[i] > 0 ? qp->high[i] : qp->low[i], much;

    *sign = qp->state[i] > 0 ? 1.0 : -1.0;
    much = *sign * (limit - qp->value[i]);
    return much > qp_allowance(qp, limit) ? much : 0.0;
}

/** How far a row of F is from where it may stay: within its limit or, where its multiplier could grow, beyond
 * it. *@p sign says on which side the limit is, or, where it is beyond, twice that. */
static double strays(const struct apc_qp *qp, size_t i, double *sign)
{
    const double much = fixed_row_slack(qp, i, sign);
    double side;

    if (much > 0.0 || qp->square[i] == 0.0)
        return much;
    *sign *= 2.0;
    return qp_violation_of(qp, i, &side) * (side == *sign / 2.0);
}

/** How far row i is from where it may stay, over its size; 0 where it may stay as it is. */
static double scaled_violation(const struct apc_qp *qp, size_t i)
{
    double sign, much;

    if ((qp->state[i] && qp->fixed[i] == 0.0) || (qp->size[i] == 0.0 && qp_soft(qp, i)))
        return 0.0; /* of W, or of zeros and free to be violated */
    much = qp->fixed[i] == 0.0 ? qp_violation_of(qp, i, &sign) : strays(qp, i, &sign);
    if (much == 0.0)
        return 0.0;
    return qp->size[i] > 0.0 ? much / qp->size[i] : HUGE_VAL; /* a row of zeros can only contradict */
}

/** scaled_violation() of four rows. Nothing here is a branch that depends on the way: on a long one rows are violated at
 * random. */
static inline void scaled_violations(const struct apc_qp *qp, size_t i, apc_lanes *to)
{
    const apc_lanes value = QP_FOUR(qp->value + i), low = QP_FOUR(qp->low + i), high = QP_FOUR(qp->high + i),
                    size = QP_FOUR(qp->size + i), above = value - high, below = low - value;
    const apc_masks odd = (size == 0.0) | (QP_FOUR(qp->fixed + i) != 0.0), top = above >= below;
    const apc_masks of_work = {-(qp->state[i] != 0), -(qp->state[i + 1] != 0), -(qp->state[i + 2] != 0),
                               -(qp->state[i + 3] != 0)};
    apc_lanes much, limit, allowed;
    apc_masks out;

    if (qp_any(&odd)) {
        *to = (apc_lanes){scaled_violation(qp, i), scaled_violation(qp, i + 1), scaled_violation(qp, i + 2),
                          scaled_violation(qp, i + 3)};
        return;
    }
    qp_pick(&top, &above, &below, &much);
    qp_pick(&top, &high, &low, &limit);
    limit = (apc_lanes)((apc_masks)limit & INT64_MAX); /* its magnitude */
    allowed = qp->tolerance + 8.0 * DBL_EPSILON * limit;
    out = (much > 0.0) & (much > allowed) & ~of_work;
    *to = (apc_lanes)(out & (apc_masks)(much / size));
}

/** Are four rows, from @p i on, within their limits, and none of them of F? */
static inline bool are_satisfied(const struct apc_qp *qp, size_t i)
{
    const apc_lanes value = QP_FOUR(qp->value + i);
    const apc_masks off = (value - QP_FOUR(qp->high + i) > qp->tolerance) |
                          (QP_FOUR(qp->low + i) - value > qp->tolerance) | (QP_FOUR(qp->fixed + i) != 0.0);

    return !qp_any(&off);
}

/** The row whose urge is greatest, of those the first: rows when there is none. */
QP_LANES static size_t most_violated(const struct apc_qp *qp)
{
    apc_lanes most = {0.0, 0.0, 0.0, 0.0}, four;
    apc_masks where = {0, 0, 0, 0};
    size_t found = qp->rows, i = 0;
    double best = 0.0;

    for (; i + 4 <= qp->rows; i += 4) {
        if (are_satisfied(qp, i)) /* nearly all, so it comes first */
            continue;
        scaled_violations(qp, i, &four);
        const apc_masks more = four > most,
                        here = {(int64_t)i, (int64_t)i + 1, (int64_t)i + 2, (int64_t)i + 3};

        qp_pick(&more, &four, &most, &most);
        where = (more & here) | (~more & where);
    }
    for (size_t q = 0; q < 4; q++)
        if (most[q] > best || (most[q] == best && best > 0.0 && (size_t)where[q] < found)) {
            best = most[q];
            found = (size_t)where[q];
        }
    for (; i < qp->rows; i++) {
        const double much = scaled_violation(qp, i);

        if (much > best) {
            best = much;
            found = i;
        }
    }
    return found;
}

size_t qp_entering(const struct apc_qp *qp, bool careful, double *sign)
{
    size_t found = careful ? 0 : most_violated(qp);

    while (careful && found < qp->rows && !(scaled_violation(qp, found) > 0.0))
        found++;
    if (found < qp->rows)
        (void)(qp->fixed[found] == 0.0 ? qp_violation_of(qp, found, sign) : strays(qp, found, sign));
    return found;
}
