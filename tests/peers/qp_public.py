# SPDX-License-Identifier: BSD-3-Clause
"""qp_public.py FOLDER: the quadratic programs of predictive control that qpsolvers/mpc_qpbenchmark has, by libapc and by DAQP.

FOLDER is `data` of that repository, which is not part of this one. By hand: `pip install -r tests/peers/solvers.txt` and the wheel
of libapc. Fails where an answer is not optimal by its own residuals, or DAQP's is better by more than 1e-8 of the objective's terms.
"""
import pathlib
import sys

import numpy as np

import libapc as apc

try:
    import casadi
except ImportError:
    sys.exit("qp_public.py: skipped: casadi, which brings DAQP, is not installed: pip install -r tests/peers/solvers.txt")


def read(path):
    """H, f, A, low, high with x's own bounds first, as libapc takes them."""
    data = np.load(path, allow_pickle=True)
    n = len(data["q"])

    def part(name, otherwise):
        return data[name] if name in data and data[name].dtype != object else otherwise

    none, nothing = np.zeros((0, n)), np.zeros(0)
    A = np.vstack([part("G", none), part("A", none)])
    h, b = part("h", nothing), part("b", nothing)
    low = np.concatenate([part("lb", np.full(n, -np.inf)), np.full(len(h), -np.inf), b])
    return data["P"], data["q"], A, low, np.concatenate([part("ub", np.full(n, np.inf)), h, b])


def daqp(H, f, A, low, high):
    """The objective that DAQP finds; proximal steps are its own setting for a singular H."""
    n = len(f)
    flat = np.linalg.eigvalsh(H)[0] < 1e-10 * np.abs(H).max()
    options = {"primal_tol": 1e-9, "dual_tol": 1e-12, "eps_prox": 1e-6 if flat else 0.0}
    shape = {"h": casadi.Sparsity.dense(n, n), "a": casadi.Sparsity.dense(len(A), n)}
    solver = casadi.conic("daqp", "daqp", shape, {"error_on_fail": False, "print_time": False, "daqp": options})
    x = np.array(solver(h=H, g=f, a=A, lba=low[n:], uba=high[n:], lbx=low[:n], ubx=high[:n])["x"]).ravel()
    return 0.5 * x @ H @ x + f @ x if solver.stats()["success"] else np.inf


def main():
    paths = sorted(pathlib.Path(sys.argv[1]).glob("*.npz"))
    if not paths:
        sys.exit(f"qp_public.py: no *.npz in {sys.argv[1]}")
    worst = 0.0
    for path in paths:
        H, f, A, low, high = read(path)
        own, other = apc.QP(H, A if len(A) else None).solve(f, low, high), daqp(H, f, A, low, high)
        terms = 0.5 * np.abs(own.x) @ np.abs(H) @ np.abs(own.x) + np.abs(f) @ np.abs(own.x)
        print(f"{path.stem:12} n {len(f):3} m {len(A):3}  {own.objective:.12g}  DAQP {other:.12g}"
              f"  residuals {own.primal:.1e} {own.dual:.1e} {own.gap:.1e}")
        if max(own.primal, own.dual, own.gap) > 1e-8 or own.objective - other > 1e-8 * (terms + 1.0):
            sys.exit(f"{path.stem}: this is not the least value")
        worst = max(worst, max(own.primal, own.dual, own.gap))
    print(f"{len(paths)} solved, the largest residual {worst:.1e}")


main()
