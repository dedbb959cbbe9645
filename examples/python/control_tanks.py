# SPDX-License-Identifier: BSD-3-Clause
"""LQG control without offset, designed by python-control from the plant's equations, for experiments/quadruple-tank.conf.
It takes python-control (pip install control)."""

import control
import numpy as np

import libapc as apc

AREA, OUTLET = np.array([28.0, 32.0, 28.0, 32.0]), np.array([0.071, 0.057, 0.071, 0.057])  # cm2
SHARE, PUMP, SENSOR, G = (0.7, 0.6), (3.33, 3.35), 0.5, 981.0  # -, cm3/s/V, V/cm, cm/s2


def tanks(t, h, v, params):
    out = OUTLET * np.sqrt(2 * G * np.maximum(h, 0.0))
    pumped = np.array([SHARE[0] * PUMP[0] * v[0], SHARE[1] * PUMP[1] * v[1],
                       (1 - SHARE[1]) * PUMP[1] * v[1], (1 - SHARE[0]) * PUMP[0] * v[0]])
    return (pumped - out + [out[2], out[3], 0.0, 0.0]) / AREA


class Lqg(apc.Law):
    """LQG control by python-control"""

    name = "control-lqg"
    whole = True
    states = 6  # deviations expected at this tick: four levels, and on each pump what nobody measures
    settings = ["v"]

    def __init__(self, setup):
        super().__init__(setup)
        self.v = np.array(setup.settings.get("v", [3.0, 3.0]))
        plant = control.nlsys(tanks, lambda t, h, v, params: SENSOR * h[:2], inputs=2, outputs=2, states=4)
        steady = control.find_operating_point(plant, [12.0, 12.0, 2.0, 1.0], self.v, input_indices=[0, 1])
        self.y = SENSOR * steady.states[:2]
        linear = control.sample_system(plant.linearize(steady.states, self.v), setup.Ts)
        A, B, C = linear.A, linear.B, linear.C
        self.K = control.dlqr(A, B, C.T @ C, 0.05 * np.eye(2))[0]
        self.A = np.block([[A, B], [np.zeros((2, 4)), np.eye(2)]])
        self.B, self.C = np.vstack([B, np.zeros((2, 2))]), np.hstack([C, np.zeros((2, 2))])
        gain = control.dlqe(self.A, np.eye(6), self.C, np.diag([1e-4] * 4 + [1e-4] * 2), 1e-3 * np.eye(2))[0]
        self.L = np.linalg.solve(self.A, gain)  # of the measurement of this tick, not of the next
        self.rest = np.linalg.inv(np.block([[A - np.eye(4), B], [C, np.zeros((2, 2))]]))
        self.drift = B

    def estimate(self, c):
        x = np.array(c.x)
        return x + self.L @ (np.array(c.y) - self.y - self.C @ x)

    def compute(self, c):
        x = self.estimate(c)
        rest = self.rest @ np.concatenate([-self.drift @ x[4:], np.array(c.z) - self.y])
        return self.v + rest[4:] - self.K @ (x[:4] - rest[:4])

    def reset(self, c):
        c.x = [0.0] * 6

    def update(self, c):
        c.x = self.A @ self.estimate(c) + self.B @ (np.array(c.u) - self.v)
