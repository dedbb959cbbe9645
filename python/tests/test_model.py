# SPDX-License-Identifier: BSD-3-Clause
# Promise(python): Linear models, steady states, quadratic programs and estimators in Python are the library's; wrong
#   arrays are exceptions.
import numpy as np
import pytest

import libapc as apc


def test_a_model_says_what_it_is():
    m = apc.Model("quadruple-tank")
    assert (m.nx, m.nu, m.ny) == (4, 2, 2) and len(m.states) == 4 and m.outputs[0].unit == "V"
    with pytest.raises(apc.Error, match="no-such"):
        apc.Model("no-such")


def test_linear_models():
    tau, K = 10.0, 2.0
    linear = apc.linearize("first-order", p={"tau": tau, "K": K})
    assert np.allclose(linear.A, [[-1 / tau]]) and np.allclose(linear.B, [[K / tau]]) and np.allclose(linear.C, [[1]])
    sampled = linear.sample(2.0)
    assert sampled.Ts == 2 and np.isclose(sampled.A[0, 0], np.exp(-0.2))
    plant = apc.Model("first-order").plant(p={"tau": tau, "K": K}, integrator="exact")
    u = np.array([[1.0], [1.0], [-2.0], [0.5]])
    measured = [0.0] + [plant.advance(2.0, v)[0] for v in u[:-1]]
    assert np.allclose(sampled.simulate(u)[:, 0], measured, atol=1e-12) and plant.time == 6
    held = linear.sample(2.0, dead_time=[3.0])
    assert held.A.shape[0] > 1 and np.allclose(held.simulate(np.ones((40, 1)))[-1], K, atol=1e-2)
    with pytest.raises(ValueError, match="sampled first"):
        linear.simulate(u)


def test_a_steady_state_is_found():
    m = apc.Model("quadruple-tank")
    u = [v.initial for v in (*m.inputs, *m.disturbances)]
    x = m.equilibrium(u, x=np.full(4, 5.0))
    plant = m.plant(x0=x)
    plant.advance(100.0, u[:m.nu])
    assert np.allclose(plant.x, x, rtol=1e-6)


def test_quadratic_programs():
    qp = apc.QP([[2.0, 0.0], [0.0, 2.0]], [[1.0, 1.0]])
    free = qp.solve([-2.0, -4.0], [-np.inf] * 3, [np.inf] * 3)
    assert np.allclose(free.x, [1, 2]) and (free.multipliers == 0).all()
    cut = qp.solve([-2.0, -4.0], [-np.inf, -np.inf, -np.inf], [np.inf, np.inf, 2.0])
    assert np.allclose(cut.x, [0.5, 1.5]) and cut.multipliers[2] > 0 and cut.gap < 1e-9
    with pytest.raises(apc.SolverError, match=r"rows \[.*2.*\] contradict each other"):
        qp.solve([0.0, 0.0], [1, 1, -np.inf], [2, 2, 1.5])
    soft = apc.QP([[2.0, 0.0], [0.0, 2.0]], [[1.0, 1.0]], linear=[0, 0, 10], square=[0, 0, 1])
    assert soft.solve([0.0, 0.0], [1, 1, -np.inf], [2, 2, 1.5]).soft > 0
    with pytest.raises(apc.Error, match="H of the QP is indefinite: pivot 2 of 2"):
        apc.QP([[1.0, 0.0], [0.0, -1.0]])
    flat = apc.QP([[1.0, 0.0], [0.0, 0.0]], [[1.0, 1.0]])
    assert np.allclose(flat.solve([0.0, -1.0], [-np.inf] * 3, [np.inf, np.inf, 3.0]).x, [-1, 4])
    with pytest.raises(apc.SolverError, match=r"falls without end along x\[1\]: they need a weight or a limit"):
        flat.solve([0.0, -1.0], [-9, -9, -np.inf], [9, np.inf, np.inf])


def test_an_h_that_is_not_symmetric_has_the_objective_that_is_written():
    H, f = np.array([[2.0, 1.5], [-0.5, 3.0]]), np.array([-1.0, 2.0])
    for h in (H, H.T, np.triu(H), np.tril(H)):
        solution = apc.QP(h).solve(f, [-np.inf] * 2, [np.inf] * 2)
        assert np.allclose(solution.x, np.linalg.solve((h + h.T) / 2, -f))
        assert np.isclose(solution.objective, solution.x @ h @ solution.x / 2 + f @ solution.x)
    symmetric = H + H.T
    qp = apc.QP(np.eye(2))
    qp.set(np.triu(symmetric) + np.triu(symmetric, 1))  # twice the upper half
    assert (qp.solve(f, [-9, -9], [9, 9]).x == apc.QP(symmetric).solve(f, [-9, -9], [9, 9]).x).all()


def test_a_state_is_estimated():
    linear = apc.linearize("first-order").sample(1.0)
    for steady in (False, True):
        filter_ = apc.Estimator(linear, q=[1e-4], r=[1e-2], steady=steady)
        x, pick = 3.0, np.random.default_rng(1)
        for k in range(200):
            assert filter_.correct([x + 0.1 * pick.standard_normal()], [1.0]) == 1
            estimate = filter_.x[0]
            filter_.predict([1.0])
            before, x = x, linear.A[0, 0] * x + linear.B[0, 0]
        assert abs(estimate - before) < 0.1 and 0 < filter_.deviation[0] < 0.1
        assert filter_.correct([np.nan], [1.0]) == 0 and filter_.correct([5.0], [1.0], [False]) == 0
    extended = apc.Estimator(apc.Model("first-order"), q=[1e-4], r=[1e-2], Ts=1.0)
    extended.reset([2.0])
    extended.predict([0.0])
    assert 0 < extended.x[0] < 2


@pytest.mark.parametrize("wrong", [[[1.0]], [1.0, 2.0], "text", [None], [np.nan], [1j], object(), [[1.0], [2.0, 3.0]]])
def test_wrong_arrays_are_refused(wrong):
    m = apc.Model("first-order")
    for act in (lambda: m.linearize(x=wrong), lambda: m.equilibrium(wrong), lambda: m.plant().advance(1.0, wrong),
                lambda: m.plant(x0=wrong), lambda: apc.QP(np.eye(1)).solve(wrong, [0.0], [1.0]),
                lambda: apc.Estimator(m.linearize().sample(1.0), q=wrong, r=[1.0]),
                lambda: m.linearize().sample(1.0).simulate([[1.0]], x=wrong)):
        with pytest.raises(ValueError, match="shape|no array of numbers|a number that is none"):
            act()


def test_arrays_of_any_order_and_type_are_taken():
    H = np.asfortranarray(np.array([[2, 1], [1, 3]], dtype=np.int32))
    A = np.arange(8.0).reshape(2, 4)[:, ::2]
    assert np.allclose(apc.QP(H).solve(np.float32([-1, -1]), [-9, -9], [9, 9]).x, np.linalg.solve(H, [1, 1]))
    assert np.allclose((A @ apc.QP(H, A).solve([-1, -1], [-9, -9, 0.5, -9], [9, 9, 0.5, 9]).x)[0], 0.5)
