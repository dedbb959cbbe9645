# SPDX-License-Identifier: BSD-3-Clause
"""Small dense quadratic programs, solved again and again (apcqp.h)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Optional

from .columns import doubles, pointer
from .errors import error
from .native import Owned, check, ffi, lib, why

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


class Solution(NamedTuple):
    """Of a quadratic program."""

    x: "NDArray[np.float64]"  #: [n]
    multipliers: "NDArray[np.float64]"  #: [n + m] > 0 at high, < 0 at low
    objective: float
    soft: float  #: cost of the soft rows' violations
    iterations: int
    primal: float  #: largest violation of a hard row
    dual: float  #: largest |Hx + f + (I, A')multipliers|
    gap: float  #: largest |multiplier x distance| where one of the two ought to be 0


class QP:
    """minimise x'Hx / 2 + f'x  subject to  low <= (x, Ax) <= high

    H [n, n] is positive semidefinite, A [m, n]. Of an H that is not symmetric x'Hx is that of (H + H')/2, which is what is
    solved, and what multipliers belong to. Each solve begins from the working set of the former one.
    """

    def __init__(self, H: "ArrayLike", A: Optional["ArrayLike"] = None, linear: Optional["ArrayLike"] = None,
                 square: Optional["ArrayLike"] = None) -> None:
        """`linear` and `square` [n + m] are the weights of soft rows: both 0 is a hard one."""
        import numpy as np

        self.n, self.m = np.shape(H)[0] if np.ndim(H) else 1, np.shape(A)[0] if A is not None else 0
        out, reason, options = ffi.new("struct apc_qp **"), why(), ffi.new("struct apc_qp_options *")
        weights = [None if w is None else doubles(name, w, self.n + self.m)
                   for name, w in (("linear", linear), ("square", square))]
        options.size, options.linear, options.square = ffi.sizeof(options[0]), pointer(weights[0]), pointer(weights[1])
        check(lib.apc_qp_create(out, self.n, self.m, options, reason), reason)
        self._owned = Owned("quadratic program", out[0], lib.apc_qp_destroy)
        self.set(H, A)

    def set(self, H: "ArrayLike", A: Optional["ArrayLike"] = None) -> None:
        """Another H and A of the same sizes."""
        h = doubles("H", H, self.n, self.n)
        h = 0.5 * h + 0.5 * h.T  # the library reads one half of it
        a = doubles("A", A, self.m, self.n) if self.m else None
        reason = why()
        with self._owned as qp:
            check(lib.apc_qp_set(qp, pointer(h), pointer(a), reason), reason)

    def solve(self, f: "ArrayLike", low: "ArrayLike", high: "ArrayLike") -> Solution:
        """For f [n], low and high [n + m], x's own bounds first; -inf and inf: none. `SolverError`: there is no such x,
        with the rows that contradict each other, or the variables that run off, or none was found."""
        import numpy as np

        f_, low_, high_ = (doubles("f", f, self.n), doubles("low", low, self.n + self.m, infinite=True),
                           doubles("high", high, self.n + self.m, infinite=True))
        x, result = np.zeros(self.n), ffi.new("struct apc_qp_result *")
        result.size = ffi.sizeof(result[0])
        with self._owned as qp:
            code = lib.apc_qp_solve(qp, pointer(f_), pointer(low_), pointer(high_), pointer(x), result)
            rows, multipliers = lib.apc_qp_rows(qp), lib.apc_qp_multipliers(qp)
            which = [i for i in range(self.n + self.m) if rows[i]]
            if result.status == lib.APC_QP_UNBOUNDED:
                raise error(lib.APC_ESOLVER, f"the objective falls without end along x{which}: they need a weight or a limit")
            if code == lib.APC_ERANGE:
                raise error(lib.APC_ESOLVER, f"rows {which} contradict each other (below {self.n}: bounds of x)")
            if code < 0:
                raise error(lib.APC_ESOLVER, "no answer within the iterations allowed" if code == lib.APC_ETIMEDOUT else
                            "rounding left no answer that can be vouched for: are the numbers badly scaled?")
            values = np.array([multipliers[i] for i in range(self.n + self.m)])
        return Solution(x, values, result.objective, result.soft, result.iterations, result.primal, result.dual, result.gap)

    def close(self) -> None:
        self._owned.close()
