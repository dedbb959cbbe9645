# SPDX-License-Identifier: BSD-3-Clause
"""Nonlinear MPC of two tanks, written down in CasADi, for experiments/double-tank.conf. It takes CasADi (pip install
casadi)."""

import casadi as ca

import libapc as apc

AREA, OUTLET, PUMP, G = (0.5, 0.25), (0.019, 0.016), 0.003, 9.81  # m2, m2, m3/s/V, m/s2
HORIZON = 30


def flow(h, outlet):
    return outlet * ca.sqrt(2 * G * ca.fmax(h, 1e-6))


def tanks(Ts):
    """The levels after Ts, from levels, voltage and what leaks from the lower tank."""
    h, u, leak = ca.SX.sym("h", 2), ca.SX.sym("u"), ca.SX.sym("leak")
    between = flow(h[0], OUTLET[0])
    rhs = ca.vertcat((PUMP * u - between) / AREA[0], (between - flow(h[1], OUTLET[1]) - leak) / AREA[1])
    f = ca.Function("f", [h, u, leak], [rhs])
    k1 = f(h, u, leak)
    k2 = f(h + Ts / 2 * k1, u, leak)
    k3 = f(h + Ts / 2 * k2, u, leak)
    k4 = f(h + Ts * k3, u, leak)
    return ca.Function("tanks", [h, u, leak], [h + Ts / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])


class Tanks(apc.Law):
    """nonlinear MPC in CasADi"""

    name = "casadi-mpc"
    whole = True
    states = 3  # levels expected at this tick, and the leak
    tuning = [apc.Parameter("move", 0.02, 0.0, 10.0, "", "weight of a move against a setpoint's error", "law")]
    publishes = [apc.Published("leak.estimate", "m3/s", "drawn from the lower tank, estimated"),
                 apc.Published("h2.prediction", "m", "level expected of the lower tank", HORIZON, 1.0)]

    def __init__(self, setup):
        super().__init__(setup)
        self.publishes = [p if not p.length else p._replace(step=setup.Ts) for p in self.publishes]
        self.tanks = tanks(setup.Ts)
        u, h = ca.SX.sym("u", HORIZON), ca.SX.sym("h", 2, HORIZON)
        h0, u0, leak, move, r = (ca.SX.sym(*what) for what in (("h0", 2), ("u0",), ("leak",), ("move",), ("r",)))
        cost, gaps, before, last = 0, [], h0, u0
        for k in range(HORIZON):
            gaps.append(h[:, k] - self.tanks(before, u[k], leak))
            cost += (100 * (h[1, k] - r)) ** 2 + move * (u[k] - last) ** 2
            before, last = h[:, k], u[k]
        self.solve = ca.nlpsol("solve", "ipopt", {"x": ca.vertcat(u, ca.vec(h)), "f": cost, "g": ca.vertcat(*gaps),
                                                  "p": ca.vertcat(h0, u0, leak, move, r)},
                               {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
        self.plan = None

    def estimate(self, c):
        """Levels are measured; that the lower one is not where it was expected to be is the leak."""
        expected, leak = c.x[1], c.x[2]
        return [c.y[1], c.y[0]], leak - 0.05 * AREA[1] / c.Ts * (c.y[0] - expected)

    def compute(self, c):
        h, leak = self.estimate(c)
        now = c.u_last[0] if c.u_last[0] == c.u_last[0] else 10.0
        guess = self.plan if self.plan is not None else [now] * HORIZON + h * HORIZON
        low = [c.low[0]] * HORIZON + [0.0] * 2 * HORIZON
        high = [c.high[0]] * HORIZON + [ca.inf] * 2 * HORIZON
        found = self.solve(x0=guess, lbx=low, ubx=high, lbg=0, ubg=0, p=h + [now, leak, c.move, c.z[0]])
        if not self.solve.stats()["success"]:
            c.suboptimal("IPOPT: " + self.solve.stats()["return_status"])
        self.plan = found["x"]
        plan = self.plan.full().ravel()
        c.published["leak.estimate"] = leak
        c.published["h2.prediction"] = plan[HORIZON + 1::2]
        return plan[0]

    def reset(self, c):
        c.x = [c.y[1], c.y[0], 0.0]

    def update(self, c):
        h, leak = self.estimate(c)
        c.x = [*self.tanks(h, c.u[0], leak).full().ravel(), leak]
