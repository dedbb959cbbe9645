# SPDX-License-Identifier: BSD-3-Clause
"""ocp_jury.py MOST LOG ONCE...: the programs of nonlinear predictive control, as ocp_log wrote them, before IPOPT.

LOG is of a controller that goes on until its moves stand still. Its answers are given to IPOPT, through casadi, with the
plant's equations written anew, which may not find a better one, nor one within limits that ours breaks. MOST of each log
are taken, evenly over all of it. ONCE is of the same loop with a single step of Gauss and Newton in each tick: what that
loop costs may differ by little; of one with prices it is not looked at. Where what is paid has kinks, the steps go on
for longer than a tick has: all programs are taken, and their answers together may cost little more than IPOPT's. Fails
with the first that is not what it says.
"""
import collections
import json
import sys

import casadi
import numpy as np

RELATIVE, FLOOR, WITHIN = 1e-6, 1e-6, 1e-7  # of the objective; an error that counts as 1 costs 0.5; beyond a limit, over its size
OF_LOOP = 0.01  # of a closed loop's cost
TOGETHER = {"pancreas": 1e-3}  # of the sum of all objectives, where what is paid has kinks
KELVIN = 273.15


def van_de_vusse(x, u, p):
    k0, E1, k03, E3, dH1, dH2, dH3, rho, Cp, Kw, AR, VR, mK, CpK = p
    k, k3 = k0 * casadi.exp(-E1 / (x[2] + KELVIN)), k03 * casadi.exp(-E3 / (x[2] + KELVIN))
    heat = k * x[0] * dH1 + k * x[1] * dH2 + k3 * x[0] ** 2 * dH3
    return casadi.vertcat(
        u[0] * (u[2] - x[0]) - k * x[0] - k3 * x[0] ** 2,
        -u[0] * x[1] + k * x[0] - k * x[1],
        -heat / (rho * Cp) + u[0] * (u[3] - x[2]) + Kw * AR * (x[3] - x[2]) / (rho * Cp * VR),
        (u[1] + Kw * AR * (x[2] - x[3])) / (mK * CpK)) / 3600, casadi.vertcat(x[1], x[2])


def adiabatic_cstr(x, u, p):
    ln_k0, E, beta, V = p
    r = casadi.exp(ln_k0 - E / (x[2] + KELVIN)) * x[0] * x[1]
    D = u[0] / 60e3 / V
    return casadi.vertcat(D * (u[1] - x[0]) - r, D * (u[2] - x[1]) - 2 * r, D * (u[3] - x[2]) + beta * r), x[2]


def pancreas(x, u, p):
    weight, transport, disposal, liver, target, safe, below, unsafe = p
    D1, D2, S1, S2, insulin, x1, x2, x3, Q1, Q2 = casadi.vertsplit(x)
    over = lambda value: casadi.fmax(value, 0)  # noqa: E731
    glucose = Q1 / (0.16 * weight)
    taken = 0.0097 * weight * casadi.fmin(over(glucose) / 4.5, 1) + 0.003 * over(glucose - 9) * 0.16 * weight
    return casadi.vertcat(
        0.8 * u[1] / 0.18016 - D1 / 40, (D1 - D2) / 40, u[0] - S1 / 55, (S1 - S2) / 55, S2 / 55 / (0.12 * weight) - 0.138 * insulin,
        0.006 * (transport * insulin - x1), 0.06 * (disposal * insulin - x2), 0.03 * (liver * insulin - x3),
        D2 / 40 + 0.0161 * weight * over(1 - x3) - taken - x1 * Q1 + 0.066 * Q2, x1 * Q1 - (0.066 + x2) * Q2) / 60, casadi.vertcat(
        glucose, over(glucose - target) ** 2 + below * over(target - glucose) ** 2 + unsafe * over(safe - glucose) ** 2)


PLANTS = {"van-de-vusse": (van_de_vusse, 4), "adiabatic-cstr": (adiabatic_cstr, 3), "pancreas": (pancreas, 10)}


class Program:
    """What does not change from one to the next: y of all samples as a function of the moves."""

    def __init__(self, made, weights):
        equations, nx = PLANTS[made["model"]]
        N, h, p = made["horizon"], made["Ts"] / made["steps"], made["p"]
        self.q, self.s, self.r, self.price = (np.array(weights[name]) for name in ("q", "s", "r", "price"))
        assert not any(weights["zone"]), "ranges are not known here"
        nu, nd, ny = len(self.s), len(made["nominal"]), len(self.q)
        block_of = [b for b, length in enumerate(made["block"]) for _ in range(length)]
        block_of = (block_of + [len(made["block"]) - 1] * N)[:N]
        blocks = len(made["block"])

        x, u, d = casadi.SX.sym("x", nx), casadi.SX.sym("u", nu), casadi.SX.sym("d", len(made["unknown"]))
        inputs, offset = casadi.vertcat(u, casadi.DM(made["nominal"])), casadi.SX.zeros(ny)
        for k, (at_input, number) in enumerate(made["unknown"]):
            if at_input:
                inputs[number] += d[k]
            else:
                offset[number] += d[k]
        at = x
        for _ in range(made["steps"]):
            k1 = equations(at, inputs, p)[0]
            k2 = equations(at + h / 2 * k1, inputs, p)[0]
            k3 = equations(at + h / 2 * k2, inputs, p)[0]
            k4 = equations(at + h * k3, inputs, p)[0]
            at = at + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        sample = casadi.Function("sample", [x, u, d], [at, equations(at, inputs, p)[1] + offset])

        # moves over their size, so that no tolerance hangs on units
        self.unit = 1 / np.sqrt(self.s + self.r)
        v, x0, d, last = casadi.MX.sym("v", nu, blocks), casadi.MX.sym("x0", nx), casadi.MX.sym("d", len(made["unknown"])), casadi.MX.sym("last", nu)
        target, reference = casadi.MX.sym("target", ny, N), casadi.MX.sym("reference", nu)
        moves = v * casadi.DM(np.tile(self.unit[:, None], (1, blocks)))
        _, y = sample.mapaccum("course", N)(x0, moves[:, block_of], casadi.repmat(d, 1, N))
        change = moves - casadi.horzcat(last, moves[:, :-1])
        cost = (casadi.sum1(casadi.sum2((y - target) ** 2 * casadi.repmat(self.q, 1, N))) +
                casadi.sum1(casadi.sum2(change**2 * casadi.repmat(self.s, 1, blocks))) +
                casadi.sum1(casadi.sum2((moves - casadi.repmat(reference, 1, blocks)) ** 2 * casadi.repmat(self.r, 1, blocks)))) / 2
        cost += casadi.sum1(casadi.sum2(y * target * casadi.repmat(self.price, 1, N)))  # a setpoint is a price there
        rows = casadi.vertcat(casadi.vec(change[:, 1:]) / np.tile(self.unit, blocks - 1), casadi.vec(y))
        given = casadi.vertcat(x0, d, last, casadi.vec(target), reference)
        self.N, self.nu, self.ny, self.blocks = N, nu, ny, blocks
        self.look = casadi.Function("look", [v, x0, d, last, target, reference], [cost, rows])
        self.solver = casadi.nlpsol("again", "ipopt", {"x": casadi.vec(v), "f": cost, "g": rows, "p": given}, {
            "print_time": False, "error_on_fail": False, "ipopt": {
                "print_level": 0, "sb": "yes", "tol": 1e-9, "constr_viol_tol": 1e-10, "bound_relax_factor": 0.0, "mu_init": 1e-6,
                "bound_push": 1e-8, "bound_frac": 1e-8, "warm_start_init_point": "yes", "max_iter": 500}})

    def consider(self, o):
        """Our objective, IPOPT's, by how much of their size limits are broken by ours; None: it could not say."""
        low, high, step, last = (np.array(o[name]) for name in ("low", "high", "step", "u_last"))
        y_low, y_high, w = np.array(o["y_low"]), np.array(o["y_high"]), np.array(o["w"]).reshape(-1, self.ny)[1:]
        target = np.where(self.price == 0, np.clip(w, y_low, y_high), w)
        reach = step[:, None] * np.arange(1, self.blocks + 1)
        least, most = np.minimum(low[:, None], last[:, None] + reach), np.maximum(high[:, None], last[:, None] - reach)
        least[:, 0], most[:, 0] = np.maximum(least[:, 0], last - step), np.minimum(most[:, 0], last + step)
        plan = np.array(o["plan"]).reshape(self.blocks, self.nu).T / self.unit[:, None]
        least, most = least / self.unit[:, None], most / self.unit[:, None]
        pace = np.tile(step / self.unit, self.blocks - 1)
        lbg, ubg = np.concatenate([-pace, np.tile(y_low, self.N)]), np.concatenate([pace, np.tile(y_high, self.N)])
        ours, rows = (np.array(a).ravel() for a in self.look(plan, o["x"], o["d"], last, target.T, o["reference"]))
        beyond = max(np.max((lbg - rows) / (1 + np.abs(rows))), np.max((rows - ubg) / (1 + np.abs(rows))),
                     np.max(least - plan), np.max(plan - most))
        got = self.solver(x0=plan.ravel("F"), lbx=least.ravel("F"), ubx=most.ravel("F"), lbg=lbg, ubg=ubg,
                          p=np.concatenate([o["x"], o["d"], last, target.ravel(), o["reference"]]))
        return ours[0], float(got["f"]) if self.solver.stats()["success"] else None, beyond


def read(path):
    """What it was made with, the last program of each tick, ISE of each loop."""
    made = weights = about = ise = None
    ticks = {}
    for line in open(path, encoding="ascii"):
        o = json.loads(line)
        if "model" in o:
            made = o
        elif "weights" in o:
            weights = o
        elif "about" in o:
            about = o
        elif "ise" in o:
            ise = o["ise"]
        elif about:
            ticks[tuple(about["x"])] = {**about, **o}
    return made, weights, list(ticks.values()), ise


def cost(made, weights, ticks, ise):
    """What the closed loop came to: of the plant's outputs, and of what really went out."""
    moves = np.diff([o["u_last"] for o in ticks], axis=0)
    return np.dot(weights["q"], ise) / made["Ts"] + np.sum(moves**2 @ weights["s"])


def main():
    most, count = int(sys.argv[1]), collections.Counter()
    for path, once in zip(sys.argv[2::2], sys.argv[3::2]):
        made, weights, ticks, ise = read(path)
        program = Program(made, weights)
        share = 0.0 if any(weights["price"]) else cost(*read(once)) / cost(made, weights, ticks, ise) - 1
        if abs(share) > OF_LOOP:
            sys.exit(f"{once}: the loop costs {100 * share:.2f} % more than {path}")
        kinks, worst, far, total = TOGETHER.get(made["model"]), 0.0, 0.0, np.zeros(2)
        for o in ticks[:: 1 if kinks else max(1, len(ticks) // most)]:
            if o["rc"] or o["given_up"] or o["given"]:
                count["given up or late"] += 1  # another problem then
                continue
            ours, theirs, beyond = program.consider(o)
            if theirs is None:
                count["IPOPT could not say"] += 1
                continue
            count["solved again"] += 1
            off = abs(ours - theirs) / (abs(theirs) + FLOOR)
            worst, far, total = max(worst, off), max(far, beyond), total + (ours, theirs)
            if (off > RELATIVE and not kinks) or beyond > WITHIN:
                sys.exit(f"{path}: {ours!r}, but IPOPT {theirs!r}; beyond limits by {beyond:.2g}: {json.dumps(o)[:300]}")
        if kinks and total[0] > (1 + kinks) * total[1]:
            sys.exit(f"{path}: objectives of {total[0]!r}, but IPOPT {total[1]!r}")
        print(f"{path}: objective within {worst:.2g}, limits within {max(far, 0):.2g}"
              + (f", all together {100 * (total[0] / total[1] - 1):+.3f} %" if kinks else "")
              + ("" if any(weights["price"]) else f"; with one step in each tick the loop costs {100 * share:+.3f} %"))
    print(", ".join(f"{what} {n}" for what, n in sorted(count.items())))
    if count["solved again"] < 4 * len(sys.argv[2:]) or count["IPOPT could not say"] > count["solved again"] / 20:
        sys.exit("too few answers")


main()
