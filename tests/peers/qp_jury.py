# SPDX-License-Identifier: BSD-3-Clause
"""qp_jury.py LOG MOST: quadratic programs of closed loops, as qp_log.c wrote them, before a jury.

Each answer that is called optimal has to be: its residuals are looked at, and solvers that others wrote solve the
same problem again. MOST of them, evenly spread, are taken. Fails with the first that is not what it says.
"""
import collections
import sys

import casadi
import numpy as np

RELATIVE, KKT = 1e-8, 1e-9
OPTIMAL, INFEASIBLE = 1, 3
# The ones that reach such accuracy, by what they are made with.
JURY = {
    "daqp": {"print_time": False, "error_on_fail": False, "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-13, "eps_prox": 0.0}},
    "qpoases": {"print_time": False, "error_on_fail": False, "printLevel": "none", "nWSR": 10000},
    "osqp": {"print_time": False, "error_on_fail": False,
             "osqp": {"verbose": False, "eps_abs": 1e-11, "eps_rel": 1e-11, "max_iter": 200000, "polish": True}},
    "piqp": {"print_time": False, "error_on_fail": False, "piqp": {"eps_abs": 1e-12, "eps_rel": 1e-12, "eps_duality_gap_abs": 1e-12}},
    "qrqp": {"print_time": False, "error_on_fail": False, "print_iter": False, "print_header": False, "print_info": False},
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
    """Evenly over all, whatever there are."""
    step = max(1, len(problems) // most)
    return problems[::step][:most]


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
        if want is None:
            worst = max(worst, abs(excess) / size[i])
        else:
            worst = max(worst, abs(abs(p.multiplier[i]) - want) / (want + p.square[i] * size[i]))
    return worst


class Judge:
    """A solver of the same problem, with a variable more for each soft row that has limits."""

    made = {}

    def __init__(self, name):
        self.name = name

    def objective(self, p):
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
        return 0.5 * z @ H @ z + g @ z


def main():
    problems = [p for path in sys.argv[2:] for p in spread(list(read(path)), int(sys.argv[1]))]
    judges = [Judge(name) for name in JURY if casadi.has_conic(name)]
    optimal = [p for p in problems if p.status == OPTIMAL]
    heard, worst, dissent = collections.Counter(), 0.0, collections.Counter()
    if len(judges) < 3 or len(optimal) < 100:
        sys.exit(f"{len(judges)} judges and {len(optimal)} problems are too few")
    for number, p in enumerate(optimal):
        off = residual(p)
        worst = max(worst, off)
        if off > KKT:
            sys.exit(f"problem {number}: residual {off:.3g}")
        agree, against = 0, []
        for judge in judges:
            value = judge.objective(p)
            if value is None:
                continue
            heard[judge.name] += 1
            scale = 0.5 * np.abs(p.x) @ np.abs(p.H) @ np.abs(p.x) + np.abs(p.f) @ np.abs(p.x) + p.soft + 1e-12
            if abs(value - p.objective - p.soft) <= RELATIVE * scale:
                agree += 1
            else:
                dissent[judge.name] += 1
                against.append(f"{judge.name} {value!r}")
        if agree < 2:
            sys.exit(f"problem {number}: {p.objective + p.soft!r}, but {', '.join(against) or 'nobody could say'}")
    print(f"{len(optimal)} optimal of {len(problems)}; largest residual {worst:.2g}; heard {dict(heard)}; dissent {dict(dissent)}")


main()
