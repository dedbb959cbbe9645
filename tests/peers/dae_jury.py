# SPDX-License-Identifier: BSD-3-Clause
"""dae_jury.py LIBAPC FLASH: examples/plant/flash.c, moved by libapc, against the same equations in CasADi, moved by its IDAS; and the linear model
of both. Prints the largest relative difference of each, and fails where one is above 1e-8."""
import ctypes
import math
import sys

import casadi
import numpy as np

P, CP, HEAT, T_FEED, VALVE, FEED, Z = 101.325, 155.0, 32000.0, 90.0, 0.0062, 0.02, 0.5


class Options(ctypes.Structure):
    _fields_ = [("size", ctypes.c_size_t), ("integrator", ctypes.c_char_p), ("rtol", ctypes.c_double), ("atol", ctypes.c_double)]


def equations():
    x, z, u = casadi.SX.sym("x", 2), casadi.SX.sym("z", 3), casadi.SX.sym("u", 2)
    liquid, benzene = casadi.vertsplit(x)
    t, y, vapour = casadi.vertsplit(z)
    b = 0.133322 * 10 ** (6.90565 - 1211.033 / (t + 220.79))
    a = 0.133322 * 10 ** (6.95464 - 1344.8 / (t + 219.482))
    ode = casadi.vertcat(FEED - vapour - VALVE * u[1] / 100 * casadi.sqrt(liquid), (FEED * (Z - benzene) - vapour * (y - benzene)) / liquid)
    alg = casadi.vertcat(benzene * b / P + (1 - benzene) * a / P - 1, benzene * b / P - y,
                         (u[0] + FEED * CP * (T_FEED - t)) / HEAT - vapour)
    return x, z, u, ode, alg, casadi.vertcat(t, liquid)


def doubles(*values):
    return (ctypes.c_double * len(values))(*values)


def difference(ours, theirs):
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    return float(np.max(np.abs(ours - theirs) / np.maximum(np.abs(theirs), 1e-3)))


lib = ctypes.CDLL(sys.argv[1])
lib.apc_plant_state.restype = ctypes.POINTER(ctypes.c_double)
lib.apc_plant_error.restype = ctypes.c_char_p
lib.apc_plant_advance.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
model, handle, plant, why = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.c_void_p(), ctypes.create_string_buffer(4096)
assert lib.apc_model_find(sys.argv[2].encode(), ctypes.byref(model), ctypes.byref(handle), why) == 0, why.value
options = Options(32, None, 1e-11, 1e-13)
assert lib.apc_plant_create(ctypes.byref(plant), model, None, None, ctypes.byref(options), why) == 0, why.value

x, z, u, ode, alg, out = equations()
idas = casadi.integrator("idas", "idas", {"x": x, "z": z, "p": u, "ode": ode, "alg": alg}, 0.0, 20.0, {"reltol": 1e-12, "abstol": 1e-14})
state, algebraic, worst = np.array([10.0, 0.4]), np.array([95.0, 0.6, 0.01]), 0.0
for k in range(300):
    given = [350.0 + 100.0 * math.sin(0.7 * k), 50.0 + 20.0 * math.sin(0.4 * k)]
    code = lib.apc_plant_advance(plant, 20.0, doubles(*given))
    assert code == 0, lib.apc_plant_error(plant)
    end = idas(x0=state, z0=algebraic, p=given)
    state, algebraic = np.array(end["xf"]).ravel(), np.array(end["zf"]).ravel()
    worst = max(worst, difference(lib.apc_plant_state(plant)[0:5], [*state, *algebraic]))
print(f"states and algebraic variables, 300 steps of 20 s: {worst:.1e}")

at, matrices = doubles(8.0, 0.45), [doubles(*[0.0] * n) for n in (4, 8, 4, 8)]
assert lib.apc_model_linearize(model, None, at, None, *matrices, why) == 0, why.value
inputs = [350.0, 50.0]
root = casadi.rootfinder("root", "newton", {"x": z, "p": casadi.vertcat(x, u), "g": alg})
solved = root(x0=[95.0, 0.6, 0.01], p=[*at, *inputs])["x"]
rows, slope = casadi.vertcat(ode, out), casadi.solve(casadi.jacobian(alg, z), casadi.jacobian(alg, casadi.vertcat(x, u)))
exact = casadi.jacobian(rows, casadi.vertcat(x, u)) - casadi.mtimes(casadi.jacobian(rows, z), slope)
theirs = np.array(casadi.Function("exact", [x, z, u], [casadi.densify(exact)])(at, solved, inputs))
a, b, c, d = (np.array(m).reshape(2, -1) for m in matrices)
ours = np.block([[a, b[:, :2]], [c, d[:, :2]]])
linear = difference(ours, theirs)
print(f"linear model: {linear:.1e}")
sys.exit(worst > 1e-8 or linear > 1e-8)
