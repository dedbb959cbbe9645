# SPDX-License-Identifier: BSD-3-Clause
"""A law of one's own, in Python: the same as examples/law/mylaw.c."""

import libapc as apc


class MyLaw(apc.Law):
    """PI control"""

    name = "mylaw"
    tuning = [apc.Parameter("Kp", 0.25, -100.0, 100.0, "", "proportional gain"),
              apc.Parameter("tau_i", 10.0, 0.1, 1e6, "s", "integral time")]
    states = 1  # the integral

    def compute(self, c):
        """At each tick: measurement y, setpoint z and state x in, output u out."""
        return c.Kp * (c.z[0] - c.y[0]) + c.x[0]

    def track(self, c):
        """The state from which compute gives u: no bump when an operator hands the output over."""
        c.x[0] = c.u[0] - c.Kp * (c.z[0] - c.y[0])

    def update(self, c):
        """The state of the next tick. u is what went out: where a limit cut it the integral does not wind up."""
        self.track(c)
        c.x[0] += c.Kp * c.Ts / c.tau_i * (c.z[0] - c.y[0])
