# SPDX-License-Identifier: BSD-3-Clause
"""do-mpc's controller and its extended Kalman filter as a law, for experiments/van-de-vusse.conf: Klatt and Engell's
reactor, which do-mpc's own examples control as well. It takes do-mpc (pip install do-mpc)."""

import numpy as np
from casadi import exp
from do_mpc.controller import MPC
from do_mpc.estimator import EKF
from do_mpc.model import Model

import libapc as apc

START = [1.61687, 1.02236, 113.137, 111.853, 104.9]  # cA, cB, T, TK, and the temperature of the feed
SCALE = {"cA": 1.0, "cB": 1.0, "T": 100.0, "TK": 100.0, "Tin": 100.0, "F": 10.0, "Q": 1000.0}
DRIFT = np.diag([1e-9, 1e-9, 1e-6, 1e-6, 1e-3])  # 1/s, of each square: the feed's temperature may be anything
NOISE = np.diag([0.001**2, 0.05**2])


def reactor():
    """A -> B -> C, 2 A -> D with a jacket; nobody measures the feed, so its temperature is a state that stays."""
    model = Model("continuous")
    a, b, t, jacket, feed = (model.set_variable("_x", name) for name in ("cA", "cB", "T", "TK", "Tin"))
    flow, heat = (model.set_variable("_u", name) for name in ("F", "Q"))
    for name in ("cB_r", "T_r"):
        model.set_variable("_tvp", name)
    k1, k3 = 1.287e12 * exp(-9758.3 / (t + 273.15)), 9.043e9 * exp(-8560 / (t + 273.15))
    wall = 4032 * 0.215 * (jacket - t)
    mixture = 0.9342 * 3.01  # kJ/L/K
    warmth = k1 * a * 4.2 - k1 * b * 11.0 - k3 * a**2 * 41.85
    for name, per_hour in (("cA", flow * (5.1 - a) - k1 * a - k3 * a**2),
                           ("cB", -flow * b + k1 * a - k1 * b),
                           ("T", -warmth / mixture + flow * (feed - t) + wall / (mixture * 10.01)),
                           ("TK", (heat - wall) / (5.0 * 2.0)),
                           ("Tin", 0 * feed)):
        model.set_rhs(name, per_hour / 3600)
    model.set_meas("cB", b, meas_noise=True)
    model.set_meas("T", t, meas_noise=True)
    model.setup()
    return model


class DoMpc(apc.Law):
    """do-mpc's nonlinear MPC"""

    name = "do-mpc"
    whole = True
    estimates = True
    states = 5 + 25  # the estimate and its covariance
    publishes = [apc.Published("Tin.estimate", "degC", "temperature of the feed, estimated")]

    def __init__(self, setup):
        super().__init__(setup)
        model = reactor()
        self.wanted = [START[1], START[2]]
        self.ekf = EKF(model=model)
        self.ekf.settings.t_step = setup.Ts
        ekf_tvp = self.ekf.get_tvp_template()
        self.ekf.set_tvp_fun(lambda t: ekf_tvp)
        self.ekf.setup()

        self.mpc = MPC(model)
        self.mpc.settings.n_horizon = 20
        self.mpc.settings.t_step = 3 * setup.Ts
        self.mpc.settings.store_full_solution = False
        self.mpc.settings.supress_ipopt_output()
        b, t = model.x["cB"], model.x["T"]
        away = ((b - model.tvp["cB_r"]) / 0.02) ** 2 + ((t - model.tvp["T_r"]) / 1.0) ** 2
        self.mpc.set_objective(mterm=away, lterm=away)
        self.mpc.set_rterm(F=0.1, Q=1e-6)
        for name, scale in SCALE.items():
            self.mpc.scaling["_u" if name in "FQ" else "_x", name] = scale
        for u in setup.u:
            self.mpc.bounds["lower", "_u", u.name] = u.low
            self.mpc.bounds["upper", "_u", u.name] = u.high
        ahead = self.mpc.get_tvp_template()

        def setpoints(_):
            ahead["_tvp", :, "cB_r"], ahead["_tvp", :, "T_r"] = self.wanted
            return ahead

        self.mpc.set_tvp_fun(setpoints)
        self.mpc.setup()
        self.tick, self.begun = None, False

    def estimate(self, c):
        """The filter's step of this tick, from c.x alone, whoever asks first."""
        if self.tick == c.tick:
            return
        self.tick = c.tick
        self.ekf.x0, self.ekf.P0 = np.array(c.x[:5]).reshape(5, 1), np.array(c.x[5:]).reshape(5, 5)
        if not self.begun:
            self.ekf.set_initial_guess()
        self.went = np.array([last if np.isfinite(last) else u for last, u in zip(c.u_last, (8.0, -1113.5))])
        self.x = self.ekf.make_step(np.array(c.y).reshape(2, 1), self.went.reshape(2, 1), DRIFT, NOISE)

    def compute(self, c):
        self.estimate(c)
        self.wanted = list(c.z)
        self.mpc.x0, self.mpc.u0 = self.x, self.went
        if not self.begun:
            self.mpc.set_initial_guess()
        self.begun = True
        self.mpc.reset_history()
        u = self.mpc.make_step(self.x)
        c.published["Tin.estimate"] = self.x[4, 0]
        if not self.mpc.solver_stats["success"]:
            c.suboptimal("IPOPT: " + self.mpc.solver_stats["return_status"])
        return u

    def reset(self, c):
        c.x = START + np.diag([0.01, 0.01, 1.0, 1.0, 1.0]).ravel().tolist()

    def update(self, c):
        self.estimate(c)
        c.x = self.x.ravel().tolist() + self.ekf.P0.ravel().tolist()
