# SPDX-License-Identifier: BSD-3-Clause
"""qp_jury.py MOST LOG...: quadratic programs of closed loops, as qp_log.c wrote them, before a jury.

Each answer that is called optimal has to be: its residuals are looked at, and solvers that others wrote solve the
same problem again. At least three have to find the same objective, and the same limits active where these are not
degenerate. MOST of each log, evenly spread over each of its sizes, are taken. Fails with the first that is not what it says.
"""
import collections
import os
import sys

import casadi
import numpy as np

RELATIVE, KKT, KKT_ILL, ILL = 1e-8, 1e-9, 1e-7, 1e8 # of H's condition
ROUNDING = 1e-14 # of the objective without limits, from where dual methods come: beside it what is almost nothing is not known better
AGREE = 3
STRONG, AT = 1e-5, 1e-6 # a multiplier and a distance, over their scales, that leave no doubt; what counts as at a limit
OPTIMAL, INFEASIBLE = 1, 3
# The ones that reach such accuracy, by what they are made with; the quick ones first: who comes after three that agree is not asked.
JURY = {
    "daqp": {"print_time": False, "error_on_fail": False, "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-13, "eps_prox": 0.0}},
    "qpoases": {"print_time": False, "error_on_fail": False, "printLevel": "none", "nWSR": 10000},
    "piqp": {"print_time": False, "error_on_fail": False, "piqp": {"eps_abs": 1e-12, "eps_rel": 1e-12, "eps_duality_gap_abs": 1e-12}},
    "highs": {"print_time": False, "error_on_fail": False,
              "highs": {"output_flag": False, "primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}},
    "osqp": {"print_time": False, "error_on_fail": False,
             "osqp": {"verbose": False, "eps_abs": 1e-11, "eps_rel": 1e-11, "max_iter": 200000, "polish": True}},
}
Problem = collections.namedtuple("Problem", "n m H A linear square f low high status objective soft x multiplier")


def read(path):
    """The solved problems of a log."""
    at, v, sizes, weights, matrices = 0, np.fromfile(path), {}, {}, {}

    def take(n):
        nonlocal at
        at += n
        assert at <= len(v), "the log ends within a record"
        return v[at - n : at]

    while at < len(v):
        kind, qp = (int(a) for a in take(2))
        if kind == 1:
            sizes[qp] = tuple(int(a) for a in take(2))
            continue
        n, m = sizes[qp]
        if kind == 2:
            H = take(n * n).reshape(n, n)
            lower = np.tril(H)
            matrices[qp] = (lower + np.tril(H, -1).T, take(m * n).reshape(m, n))
        elif kind == 3:
            weights[qp] = (take(n + m), take(n + m))
        else:
            f, low, high = take(n), take(n + m), take(n + m)
            status, objective, soft = take(3)
            yield Problem(n, m, *matrices[qp], *weights[qp], f, low, high, int(status), objective, soft, take(n), take(n + m))


def spread(problems, most):
    """Evenly over all of each size: those of steady states take turns with those of moves."""
    sizes = collections.defaultdict(list)
    for p in problems:
        sizes[p.n, p.m].append(p)
    each = -(-most // len(sizes))
    return [p for of in sizes.values() for p in of[:: max(1, len(of) // each)][:each]]


def residual(p):
    """Of the answer by itself: stationarity, feasibility, complementarity, each over its own scale."""
    rows = np.vstack([np.eye(p.n), p.A])
    value, away = rows @ p.x, rows.T @ p.multiplier
    terms = np.abs(p.H) @ np.abs(p.x) + np.abs(p.f) + np.abs(rows.T) @ np.abs(p.multiplier)
    worst = np.max(np.abs(p.H @ p.x + p.f + away) / (terms + 1e-300))
    soft = (p.linear > 0) | (p.square > 0)
    size = np.linalg.norm(rows, axis=1) * max(1.0, np.linalg.norm(p.x)) + 1e-300
    beyond = np.maximum(np.maximum(p.low - value, value - p.high), 0.0)
    worst = max(worst, np.max(np.where(soft, 0.0, beyond) / size))
    for i in np.flatnonzero(p.multiplier):
        limit = p.high[i] if p.multiplier[i] > 0 else p.low[i]
        excess = (value[i] - limit) * np.sign(p.multiplier[i])
        want = p.linear[i] + p.square[i] * max(excess, 0.0) if soft[i] and excess > 1e-12 * size[i] else None
        if want is None:  # one of the two is nothing
            push = abs(p.multiplier[i]) * np.linalg.norm(rows[i]) / (np.linalg.norm(p.f) + 1e-300)
            worst = max(worst, min(push, abs(excess) / size[i]))
        else:
            worst = max(worst, abs(abs(p.multiplier[i]) - want) / (want + p.square[i] * size[i]))
    return worst


def same_limits(p, x):
    """Is what is active here active there, and what is free here free there? What is neither for sure does not count."""
    rows, unit = np.vstack([np.eye(p.n), p.A]), 1 / np.sqrt(np.maximum(np.diag(p.H), 1e-300))
    size = np.linalg.norm(rows * unit, axis=1) + 1e-300
    far = size * max(1.0, np.linalg.norm(p.x / unit))
    push = np.abs(p.multiplier) * size / (np.linalg.norm(p.f * unit) + 1e-300)

    def distance(value):
        return np.minimum(np.abs(value - p.low), np.abs(value - p.high)) / far

    hard = (p.linear == 0) & (p.square == 0)
    here, there = distance(rows @ p.x), distance(rows @ x)
    return not np.any(hard & (push > STRONG) & (there > AT)) and not np.any(hard & (here > STRONG) & (there < AT))


class Judge:
    """A solver of the same problem, with a variable more for each soft row that has limits."""

    made = {}

    def __init__(self, name):
        self.name = name

    def answer(self, p):
        """Its objective and its x; None: it could not say."""
        slack = np.flatnonzero(((p.linear > 0) | (p.square > 0)) & (np.isfinite(p.low) | np.isfinite(p.high)))
        k, rows = len(slack), np.vstack([np.eye(p.n), p.A])
        H = np.zeros((p.n + k, p.n + k))
        H[: p.n, : p.n] = p.H
        g = np.concatenate([p.f, p.linear[slack]])
        H[range(p.n, p.n + k), range(p.n, p.n + k)] = p.square[slack] + 1e-12 * (p.square[slack] == 0)
        used = [i for i in range(len(rows)) if np.isfinite(p.low[i]) or np.isfinite(p.high[i])]
        A, low, high = [], [], []
        for i in used:
            row = np.concatenate([rows[i], np.zeros(k)])
            if i not in slack:
                A.append(row), low.append(p.low[i]), high.append(p.high[i])
                continue
            e = p.n + int(np.searchsorted(slack, i))
            for limit, sign in ((p.low[i], 1.0), (p.high[i], -1.0)):
                if np.isfinite(limit):
                    part = sign * row
                    part[e] = 1.0
                    A.append(part), low.append(sign * limit), high.append(np.inf)
        A = np.array(A).reshape(-1, p.n + k)
        lbx = np.concatenate([np.full(p.n, -np.inf), np.zeros(k)])
        # each row over its size: what a solver's tolerance means must not hang on units
        size = np.linalg.norm(A, axis=1)
        scale = np.where(size > 0, 1 / np.maximum(size, 1e-300), 1.0)
        A, low, high = A * scale[:, None], np.array(low) * scale, np.array(high) * scale
        unit = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
        H, g, A, lbx = H * np.outer(unit, unit), g * unit, A * unit, lbx / unit
        key = (self.name, p.n + k, len(A))
        if key not in self.made:
            shape = {"h": casadi.Sparsity.dense(p.n + k, p.n + k), "a": casadi.Sparsity.dense(len(A), p.n + k)}
            self.made[key] = casadi.conic("judge", self.name, shape, JURY[self.name])
        got = self.made[key](h=H, g=g, a=A, lba=low, uba=high, lbx=lbx, ubx=np.full(p.n + k, np.inf))
        z = np.array(got["x"]).ravel()
        if not self.made[key].stats()["success"] or not np.all(np.isfinite(z)):
            return None
        return 0.5 * z @ H @ z + g @ z, (z * unit)[: p.n]


def consider(number, p, judges, count):
    """One answer: what its own residual is, and what the judges say of it."""
    off, ill = residual(p), np.linalg.cond(p.H) > ILL
    count["worst ill" if ill else "worst"] = max(count["worst ill" if ill else "worst"], off)
    count["ill"] += ill
    if off > (KKT_ILL if ill else KKT):
        sys.exit(f"problem {number}: residual {off:.3g}")
    rounding = ROUNDING * np.abs(p.f) @ np.abs(np.linalg.solve(p.H, p.f))
    same, against = 0, []
    for judge in judges:
        got = judge.answer(p) if same < AGREE else None
        if got is None:
            continue
        value, x = got
        count["heard " + judge.name] += 1
        scale = 0.5 * np.abs(p.x) @ np.abs(p.H) @ np.abs(p.x) + np.abs(p.f) @ np.abs(p.x) + p.soft + 1e-6  # an error that counts as 1 costs 0.5
        apart = abs(value - p.objective - p.soft)
        if RELATIVE * scale < apart <= RELATIVE * scale + rounding:
            count["but for rounding " + judge.name] += 1
        if apart > RELATIVE * scale + rounding:
            count["dissent " + judge.name] += 1
            against.append(f"{judge.name} {value!r}")
            continue
        if same_limits(p, x):
            same += 1
        else:
            count["other limits " + judge.name] += 1
            against.append(f"{judge.name} with other limits active")
    if same < AGREE:
        sys.exit(f"problem {number} of n = {p.n}, m = {p.m}: {p.objective + p.soft!r}, but {', '.join(against) or 'nobody could say'}")


def main():
    problems = [p for path in sys.argv[2:] for p in spread(list(read(path)), int(sys.argv[1]))]
    judges = [Judge(name) for name in JURY if casadi.has_conic(name)]
    optimal = [p for p in problems if p.status == OPTIMAL]
    if len(judges) < AGREE or len(optimal) < 100:
        sys.exit(f"{len(judges)} judges and {len(optimal)} problems are too few")
    told = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # banners of solvers
    count = collections.Counter()
    for number, p in enumerate(optimal):
        consider(number, p, judges, count)
    print(f"{len(optimal)} optimal of {len(problems)};", ", ".join(f"{what} {n:.2g}" if isinstance(n, float) else f"{what} {n}"
          for what, n in sorted(count.items())), file=told)


main()
