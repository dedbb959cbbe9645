# SPDX-License-Identifier: BSD-3-Clause
"""Plant models, their linear ones, and what their state is (apcplant.h, apclinear.h, apcestimate.h)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Mapping, NamedTuple, Optional, Sequence, Union

from .columns import doubles, pointer
from .errors import error
from .native import Owned, check, ffi, is_a, lib, text, utf8, why

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


class Variable(NamedTuple):
    """A parameter, state, input, disturbance or output of a model."""

    name: str
    unit: str
    description: str
    initial: float
    low: float
    high: float


class Linear(NamedTuple):
    """dx/dt, or of a sampled one x[k+1] - x0, = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0). The inputs are
    the manipulated ones, and after them the disturbances."""

    A: "NDArray[np.float64]"  #: [nx, nx]
    B: "NDArray[np.float64]"  #: [nx, nu + nd]
    C: "NDArray[np.float64]"  #: [ny, nx]
    D: "NDArray[np.float64]"  #: [ny, nu + nd]
    x0: "NDArray[np.float64]"
    u0: "NDArray[np.float64]"
    y0: "NDArray[np.float64]"
    nd: int = 0  #: how many of the inputs are disturbances
    Ts: float = 0.0  #: s between two samples; 0: continuous

    def sample(self, Ts: float, dead_time: Optional["ArrayLike"] = None) -> "Linear":
        """Sampled every `Ts` s, inputs held; `dead_time` [nu + nd] s by which they act later, which become states."""
        with self._made(Ts, dead_time) as made:
            return _linear(made)

    def simulate(self, u: "ArrayLike", x: Optional["ArrayLike"] = None) -> "NDArray[np.float64]":
        """y [n, ny] of a sampled model, where u [n, nu + nd] acts, from state x [nx] on; None: x0."""
        import numpy as np

        if not self.Ts:
            raise error(lib.APC_EINVAL, "a continuous model is sampled first: linear.sample(Ts).simulate(u)")
        inputs = doubles("u", u, np.shape(u)[0] if np.ndim(u) else 1, self.B.shape[1]) - self.u0
        state = (self.x0 if x is None else doubles("x", x, len(self.x0))) - self.x0
        y = np.empty((len(inputs), len(self.y0)))
        for row, v in zip(y, inputs):
            row[:] = self.y0 + self.C @ state + self.D @ v
            state = self.A @ state + self.B @ v
        return y

    def _made(self, Ts: float, dead_time: Optional["ArrayLike"] = None) -> Owned:
        """As the library has it: sampled by it, if this is not."""
        nx, n, ny = len(self.x0), len(self.u0), len(self.y0)
        given = [doubles(name, value, *shape) if nx or name not in "ABC" else None for name, value, shape in (
            ("A", self.A, (nx, nx)), ("B", self.B, (nx, n)), ("C", self.C, (ny, nx)), ("D", self.D, (ny, n)),
            ("x0", self.x0, (nx,)), ("u0", self.u0, (n,)), ("y0", self.y0, (ny,)))]
        given.append(None if dead_time is None else doubles("dead_time", dead_time, n))
        of, out, reason = ffi.new("struct apc_linear_continuous *"), ffi.new("struct apc_linear **"), why()
        of.size, of.nx, of.nu, of.nd, of.ny = ffi.sizeof(of[0]), nx, n - self.nd, self.nd, ny
        of.A, of.B, of.C, of.D, of.x0, of.u0, of.y0, of.dead_time = map(pointer, given)
        make = lib.apc_linear_from_sampled if self.Ts else lib.apc_linear_from_continuous
        check(make(out, of, self.Ts or Ts, reason), reason)
        return Owned("linear model", out[0], lib.apc_linear_destroy)


def _linear(m: Any) -> Linear:
    import numpy as np

    def taken(at: Any, *shape: int) -> Any:
        n = int(np.prod(shape))
        return np.frombuffer(ffi.buffer(at, 8 * n), "f8").reshape(shape).copy() if n else np.zeros(shape)

    n = m.nu + m.nd
    return Linear(taken(m.A, m.nx, m.nx), taken(m.B, m.nx, n), taken(m.C, m.ny, m.nx), taken(m.D, m.ny, n),
                  taken(m.x0, m.nx), taken(m.u0, n), taken(m.y0, m.ny), m.nd, m.Ts)


#: Numbers of a model's parameters: all of them, or some by their names.
Parameters = Union["ArrayLike", Mapping[str, float]]


class Model:
    """A built-in model ("first-order": `apc plants` lists them), or that of a shared object ("./myplant.so")."""

    def __init__(self, name: str) -> None:
        out, handle, reason = ffi.new("struct apc_model **"), ffi.new("void **"), why()
        check(lib.apc_model_find(utf8("name", name), out, handle, reason), reason)
        m = self._model = out[0]
        self.name, self.description = text(m.name), text(m.description) if m.description else ""
        self.nx, self.nu, self.nd, self.ny = int(m.nx), int(m.nu), int(m.nd), int(m.ny)
        self.parameters = _variables(m.param, m.np, "p")
        self.states = _variables(m.state, m.nx, "x")
        self.inputs = _variables(m.input, m.nu, "u")
        self.disturbances = _variables(m.disturbance, m.nd, "d")
        self.outputs = _variables(m.output, m.ny, "y")

    def linearize(self, x: Optional["ArrayLike"] = None, u: Optional["ArrayLike"] = None,
                  p: Optional[Parameters] = None) -> Linear:
        """At x [nx], u [nu + nd]; None: the model's own."""
        import numpy as np

        n, reason = self.nu + self.nd, why()
        u_ = self._inputs(u)
        x_ = doubles("x", [v.initial for v in self.states] if x is None else x, self.nx)
        p_ = self._parameters(p)
        a, b, c, d = (np.zeros(shape) for shape in ((self.nx, self.nx), (self.nx, n), (self.ny, self.nx), (self.ny, n)))
        check(lib.apc_model_linearize(self._model, pointer(p_), pointer(x_), pointer(u_), pointer(a), pointer(b),
                                      pointer(c), pointer(d), reason), reason)
        y = np.zeros(self.ny)
        check(lib.apc_model_evaluate(self._model, pointer(p_), pointer(x_), pointer(u_), ffi.NULL, pointer(y),
                                     reason), reason)
        return Linear(a, b, c, d, x_, u_, y, self.nd)

    def equilibrium(self, u: Optional["ArrayLike"] = None, x: Optional["ArrayLike"] = None,
                    p: Optional[Parameters] = None) -> "NDArray[np.float64]":
        """The steady state x [nx] at u [nu + nd] that is found from x; `SolverError`: none is."""
        reason = why()
        found = doubles("x", [v.initial for v in self.states] if x is None else x, self.nx)
        p_, u_ = self._parameters(p), self._inputs(u)
        check(lib.apc_model_equilibrium(self._model, pointer(p_), pointer(u_), pointer(found), reason), reason)
        return found  # type: ignore[no-any-return]

    def plant(self, x0: Optional["ArrayLike"] = None, p: Optional[Parameters] = None, integrator: Optional[str] = None,
              dead_time: float = 0.0) -> "Integrated":
        """One of these, to be advanced: at state x0 [nx]. None: "cvode", or "ida" for algebraic equations."""
        return Integrated(self, x0, p, integrator, dead_time)

    def _parameters(self, p: Optional[Parameters]) -> Any:
        values = [v.initial for v in self.parameters]
        if isinstance(p, Mapping):
            names = [v.name for v in self.parameters]
            for name, value in p.items():
                if name not in names:
                    raise error(lib.APC_ENOTFOUND, f"{self.name} has no parameter \"{name}\": {', '.join(names)}")
                values[names.index(name)] = value
        elif p is not None:
            return doubles("p", p, len(values))
        return doubles("p", values, len(values))

    def _inputs(self, u: Optional["ArrayLike"]) -> Any:
        own = [v.initial for v in (*self.inputs, *self.disturbances)]
        return doubles("u", own if u is None else u, len(own))


def _variables(of: Any, n: int, letter: str) -> list[Variable]:
    def word(chars: Any) -> str:
        return text(chars) if chars else ""

    if of == ffi.NULL:
        return [Variable(f"{letter}{i + 1}", "", "", 0.0, -1e300, 1e300) for i in range(n)]
    return [Variable(word(v.name), word(v.unit), word(v.description), v.initial, v.low, v.high) for v in of[0:n]]


def linearize(model: Union[Model, str], x: Optional["ArrayLike"] = None, u: Optional["ArrayLike"] = None,
              p: Optional[Parameters] = None) -> Linear:
    """`Model(model).linearize(x, u, p)`."""
    return (Model(model) if isinstance(model, str) else is_a(Model, "model", model)).linearize(x, u, p)


class Integrated:
    """A model with its parameters, its state and an integrator."""

    def __init__(self, model: Model, x0: Optional["ArrayLike"], p: Optional[Parameters], integrator: Optional[str],
                 dead_time: float) -> None:
        out, reason, options = ffi.new("struct apc_plant **"), why(), ffi.new("struct apc_plant_options *")
        called = ffi.NULL if integrator is None else ffi.new("char[]", utf8("integrator", integrator))
        options.size, options.integrator, options.dead_time = ffi.sizeof(options[0]), called, dead_time
        p_, x_ = model._parameters(p), None if x0 is None else doubles("x0", x0, model.nx)
        check(lib.apc_plant_create(out, model._model, pointer(p_), pointer(x_), options, reason), reason)
        self.model = model
        self._owned = Owned("plant", out[0], lib.apc_plant_destroy)

    def advance(self, dt: float, u: "ArrayLike") -> "NDArray[np.float64]":
        """dt s on with u [nu] held. Returns y [ny]."""
        import numpy as np

        u_, y = doubles("u", u, self.model.nu), np.zeros(self.model.ny)
        with self._owned as plant:
            code = lib.apc_plant_advance(plant, dt, pointer(u_))
            if code < 0:
                raise error(code, text(lib.apc_plant_error(plant)) or text(lib.apc_err_text(code)))
            lib.apc_plant_output(plant, pointer(u_), pointer(y))
        return y

    def disturb(self, name: str, value: float) -> None:
        """Give a disturbance a value from now on."""
        names = [v.name for v in self.model.disturbances]
        if name not in names:
            raise error(lib.APC_ENOTFOUND, f"{self.model.name} has no disturbance \"{name}\": {', '.join(names)}")
        with self._owned as plant:
            check(lib.apc_plant_disturb(plant, names.index(name), value), why())

    @property
    def x(self) -> "NDArray[np.float64]":
        """Its state [nx]."""
        import numpy as np

        with self._owned as plant:
            return np.array(list(lib.apc_plant_state(plant)[0:self.model.nx]))

    @property
    def time(self) -> float:
        """s since it was made."""
        with self._owned as plant:
            return lib.apc_plant_time(plant)  # type: ignore[no-any-return]

    def close(self) -> None:
        self._owned.close()


class Estimator:
    """The state of a plant from what went in and what was measured. Each sample: `correct` with what was measured, use
    `x`, `predict` with what goes out.

    Of a sampled `Linear` a Kalman filter, with `steady` one of constant gain; of a `Model`, with `Ts`, an extended one.
    """

    def __init__(self, model: Union[Linear, Model], q: "ArrayLike", r: "ArrayLike", p0: Optional["ArrayLike"] = None,
                 steady: bool = False, Ts: float = 0.0) -> None:
        """`q` [nx] is the variance that each state gains, per period; of a `Model` per second. `r` [ny] that of each
        measurement's noise. `p0` [nx] those to begin with; None: q."""
        import numpy as np

        out, reason, options = ffi.new("struct apc_estimator **"), why(), ffi.new("struct apc_estimator_options *")
        linear = isinstance(model, Linear)
        if not linear:
            is_a(Model, "model", model)
        self._nx, self._n, self._ny = ((len(model.x0), len(model.u0), len(model.y0)) if isinstance(model, Linear) else
                                       (model.nx, model.nu + model.nd, model.ny))
        if isinstance(model, Linear) and not model.Ts:
            raise error(lib.APC_EINVAL, "a continuous model is sampled first: linear.sample(Ts)")
        q_, r_, p0_ = (None if value is None else doubles(name, value, n) for name, value, n in
                       (("q", q, self._nx), ("r", r, self._ny), ("p0", p0, self._nx)))
        options.size, options.q, options.r, options.p0 = ffi.sizeof(options[0]), pointer(q_), pointer(r_), pointer(p0_)
        options.kind = (lib.APC_KALMAN_EXTENDED if not linear else lib.APC_KALMAN_STEADY if steady else lib.APC_KALMAN)
        self._keeps = model._made(0.0) if isinstance(model, Linear) else None
        if isinstance(model, Linear):
            options.linear = self._keeps._pointer  # type: ignore[union-attr]
        else:
            options.model, options.Ts = model._model, Ts
        check(lib.apc_estimator_create(out, options, reason), reason)
        self._owned = Owned("estimator", out[0], lib.apc_estimator_destroy)
        self._s = np.zeros(lib.apc_estimator_size(out[0]))
        self.reset()

    def reset(self, x: Optional["ArrayLike"] = None) -> None:
        """Begin with state x [nx]; None: the model's own."""
        x_ = None if x is None else doubles("x", x, self._nx)
        with self._owned as e:
            lib.apc_estimator_reset(e, pointer(self._s), pointer(x_))

    @property
    def x(self) -> "NDArray[np.float64]":
        """The state [nx] as it is estimated."""
        return self._s[:self._nx].copy()

    @property
    def deviation(self) -> "NDArray[np.float64]":
        """Standard deviation [nx] of the estimate."""
        import numpy as np

        with self._owned as e:
            return np.array([lib.apc_estimator_deviation(e, pointer(self._s), i) for i in range(self._nx)])

    def correct(self, y: "ArrayLike", u: "ArrayLike", usable: Optional[Sequence[bool]] = None) -> int:
        """Take measurements y [ny], those that are `usable` and not NaN; u [nu + nd] acts. Returns how many were."""
        import numpy as np

        measured = np.array(y, dtype="f8", ndmin=1)
        y_, u_ = doubles("y", np.nan_to_num(measured, nan=0.0), self._ny), doubles("u", u, self._n)
        good = ffi.new("bool[]", [bool(g) and bool(np.isfinite(v)) for g, v in
                                  zip([True] * self._ny if usable is None else usable, measured)])
        if len(good) != self._ny:
            raise error(lib.APC_EINVAL, f"usable has {len(good)} elements, not {self._ny}")
        with self._owned as e:
            return check(lib.apc_estimator_correct(e, pointer(self._s), pointer(y_), good, pointer(u_)), why())

    def predict(self, u: "ArrayLike") -> None:
        """One period on, with u [nu + nd]."""
        u_ = doubles("u", u, self._n)
        with self._owned as e:
            check(lib.apc_estimator_predict(e, pointer(self._s), pointer(u_)), why())

    def close(self) -> None:
        self._owned.close()
