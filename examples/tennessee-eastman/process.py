# SPDX-License-Identifier: BSD-3-Clause
"""The Tennessee Eastman process of tep-studio as an FMU, which also keeps tep-studio's own account of how well it is controlled:

    pip install tep-studio pythonfmu3
    pythonfmu3 build -f process.py
"""

import numpy
from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability
from tep_studio import TennesseeEastmanProcess
from tep_studio.control import RickerMultiLoopController
from tep_studio.control.metrics import MetricsAccumulator
from tep_studio.simulation.schema import TEP_SCHEMA

STEP = 0.0005  # h, of tep-studio's integrator and of its own closed loop


class Process(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.seed = 0.0, 1.0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous))
        self.register_variable(Float64("seed", causality=Fmi3Causality.parameter, variability=Fmi3Variability.fixed))
        self.exit_initialization_mode()
        self.valve, self.idv = self.process.state[38:].copy(), numpy.zeros(28)
        for role, vector, causality in (("manipulated_variables", "valve", Fmi3Causality.input), ("disturbances", "idv", Fmi3Causality.input),
                                        ("measurements", "y", Fmi3Causality.output)):
            for i, name in enumerate(TEP_SCHEMA.names(role)):
                self.register_variable(Float64(name, causality=causality, getter=lambda v=vector, i=i: float(getattr(self, v)[i]),
                                               setter=lambda value, v=vector, i=i: getattr(self, v).__setitem__(i, value)))
        for name in self.account.iae:
            self.output(f"iae_{name}", lambda name=name: self.account.iae[name])
        self.output("operating_cost_total", lambda: self.account.finalize()["operating_cost_total"])
        self.output("constraint_violation_steps", lambda: self.account.constraint_violation_steps)
        self.output("shutdown", lambda: self.process.kernel.shutdown_status()[0])

    def output(self, name, getter):
        self.register_variable(Float64(name, causality=Fmi3Causality.output, getter=lambda: float(getter())))

    def exit_initialization_mode(self):
        """At the base case, and the account begins: errors are from where tep-studio's own controllers would hold it."""
        self.process = TennesseeEastmanProcess()
        self.y, _ = self.process.reset(mode="mode1", seed=self.seed)
        own = RickerMultiLoopController()
        own.reset(self.y)
        self.account = MetricsAccumulator(setpoints=own.setpoints)

    def do_step(self, t, h):
        for _ in range(max(1, round(h / 3600.0 / STEP))):
            if self.process.kernel.shutdown_status()[0]:
                return True  # a plant that is shut down stays as it is
            result = self.process.advance(self.valve, control_interval=STEP, disturbances=self.idv)
            self.y = result.measurements
            self.account.update(result)
        return True
