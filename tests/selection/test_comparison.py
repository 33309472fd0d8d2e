"""The ladder: who holds whom, what the recordings see, a fair judgement on what was not fitted, and its words."""

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fracid
from fracid import InputError
from fracid.errors import Unfinished
from fracid.estimation import long_records
from fracid.estimation.horizons import Watch, refined
from fracid.models import Model, Parameter
from fracid.models.friction import RUNGS
from fracid.models.library import from_library
from fracid.models.written.equations import Equation, Equations
from fracid.problem import Experiment, Free, Problem, Tied
from fracid.problem.costs import COSTS, Cost
from fracid.selection.comparison import compare
from fracid.selection.comparison_records import Comparison, OrderOfRow, Row, Score, mean_rmse
from fracid.selection.comparison_verdict import integer_does_as_well, not_helped, verdict_of
from fracid.selection.ladder import OWN, PAPER, assignment, held, ladder, name_of, unseen
from fracid.selection.step import quiet_substeps
from fracid.signals.left_over import LeftOver
from fracid.solver.methods import METHODS
from fracid.tasks.job import Progress
from fracid.tasks.journal import Journal
from twins import frictions, release

RIG = fracid.rotary_pendulum("stepper-freeswing")  # its arm is clamped: one degree of freedom
C1 = RIG.parameter("C1").value
MU = {"lambda": 1.0, "mu": Free(1.0, 0.5, 1.2)}
INERTIA = {"C1": Free(C1, 0.3 * C1, 3 * C1)}


def swing(angle=0.6, mu=1.0, *, dry=0.0, drag=0.0, rest=0.0, noise=1e-3, seed=1, end=3.0, name=None):
    """A free swing of that order and friction, with white noise [rad]."""
    parameters = {"b_alpha": 1e-5, "coulomb_alpha": dry, "drag_alpha": drag, "alpha_rest": rest}
    return release(name or f"{angle} rad", RIG, orders={"lambda": 1.0, "mu": mu}, parameters=parameters,
                   alpha=angle + rest, step=1e-2, end=end, outputs=("alpha",), noise=noise, seed=seed,
                   known=False)  # fmt: skip


def problem(*fitted, **options):
    return Problem(RIG, fitted, **{"orders": MU, "parameters": INERTIA, "outputs": ("alpha",),
                                   "initial_state": "rest"} | options)  # fmt: skip


DRAG = ["drag_theta", "drag_alpha"]


SIMPLE = ("viscous", "Coulomb", "drag", "cable")


def judged(problem, **options):
    """A comparison without the rung of the drag."""
    return compare(problem, **{"keep": DRAG, "rungs": SIMPLE} | options)


OTHERS = tuple({"angle": a, "seed": s} for a, s in ((0.45, 2), (0.3, 3), (0.2, 4)))

TRUTHS = {"dry": {"dry": 5e-5}, "fractional": {"mu": 0.95, "dry": 3e-5}, "drag": {"drag": 1e-5, "dry": 2e-5}}


@cache
def compared(truth):
    """A comparison on twins of that truth, three of them held out."""
    others = [swing(**TRUTHS[truth], **other) for other in OTHERS]
    options = {"keep": []} if truth == "drag" else {}
    return judged(problem(swing(**TRUTHS[truth])), validation=others, **options)


@cache
def compared_with_odds():
    """A comparison on two recordings of dry friction, with and without the evidence."""
    fitted, others = problem(swing(dry=5e-5)), [swing(dry=5e-5, **OTHERS[0])]
    rungs = ("viscous", "Coulomb")
    return [judged(fitted, validation=others, rungs=rungs, evidence=asked) for asked in (False, True)]


@pytest.mark.broad
def test_posterior_odds_stand_beside_and_change_neither_claim_norverdict_of():
    plain, with_odds = compared_with_odds()
    assert all(math.isnan(row.log_odds) for row in plain.rows)
    odds = {row.name: row.log_odds for row in with_odds.rows}
    assert max(odds, key=odds.__getitem__) == "viscous + Coulomb, orders 1"
    assert max(odds.values()) == 0.0
    assert odds["viscous, orders 1"] < -50
    assert -10 < odds["viscous + Coulomb, orders free"] < -0.5  # an order that is not needed costs what it narrows
    assert [replace(row, log_odds=0.0) for row in plain.rows] == [replace(row, log_odds=0.0) for row in with_odds.rows]
    for name in ("claim", "claim_reasons", "verdict", "notes"):
        assert getattr(plain, name) == getattr(with_odds, name)
    again = Comparison.of_json(json.loads(json.dumps(with_odds.to_json())))
    assert [row.log_odds for row in again.rows] == [*odds.values()]
    assert {line["log_odds"] for line in with_odds.lines()} == {*odds.values()}


def test_evidence_of_a_cost_of_ones_own_is_refused_before_anything_is_fitted():
    own = replace(COSTS["rmse"], name="own", loss=None, weight=None, function=lambda time, e: float(np.sum(e**2)))
    with pytest.raises(InputError, match="The cost own is a user's own, of unknown likelihood"):
        judged(problem(swing(), cost_function=own), evidence=True)


# --- the ladder -------------------------------------------------------------------------------------------


@pytest.mark.broad
def test_each_rung_frees_more_friction_and_holds_the_ones_below_exactly():
    found = ladder(problem(swing(dry=5e-5)), rungs=RUNGS)
    rungs = ["viscous", "Coulomb", "drag", "presliding", "LuGre", "springpot"]
    assert frictions(found) == (*(" + ".join(rungs[: k + 1]) for k in range(len(rungs))), OWN)
    for s in found.structures:
        for name in s.below:
            lower = found[name]
            assert set(lower.problem.names) < set(s.problem.names)
            x = lower.problem.start * 1.02  # anywhere
            values = assignment(lower.problem, x)
            springpot = s.friction.endswith("springpot") and s.friction != lower.friction
            coarse = 5e-3 if springpot else 0.0  # its order starts otherwise
            assert s.problem.cost(s.embed(values)) == pytest.approx(lower.problem.cost(x), rel=coarse, abs=0.0)


def test_a_range_that_excludes_no_friction_is_widened_to_hold_it():
    free = INERTIA | {"coulomb_alpha": Free(5e-5, 1e-5, 1e-4), "b_alpha": Free(1e-5, 1e-6, 1e-4)}
    top = ladder(problem(swing(), parameters=free, orders={"lambda": 1.0, "mu": Free(0.9, 0.8, 0.95)})).structures[-1]
    ranges = {u.name: u.range for u in top.problem.unknowns}
    assert (ranges["coulomb_alpha"].lower, ranges["coulomb_alpha"].upper) == (0.0, 1e-4)
    assert ranges["b_alpha"].lower == 0.0
    assert ranges["mu"].upper == 1.0


@pytest.mark.few(2)
@pytest.mark.parametrize("method", ["gl", "gl-paper", "pi2", "pi3"])
def test_every_structure_is_solved_by_one_method_of_second_order_or_better(method):
    found = ladder(problem(swing(), method=method))
    methods = {s.problem.method for s in found.structures}
    assert len(methods) == 1
    assert METHODS[methods.pop()].convergence_order >= 2
    assert any("makes orders of its own" in note for note in found.notes) == method.startswith("gl")


def test_orders_are_1_or_as_the_problem_frees_them_and_the_paper_has_viscous_friction_alone():
    found = ladder(problem(swing()))
    for s in found.structures:
        assert ("mu" in s.problem.names) == s.fractional
        assert s.fractional or s.problem.orders == {"lambda": 1.0, "mu": 1.0}
    assert name_of(*PAPER) in [s.name for s in found.structures]


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("orders", "free"),
    [
        ({"lambda": 1.0, "mu": 1.0}, ["mu"]),  # all are fixed: all are freed that can be seen
        ({"lambda": Free(1.0, 0.6, 1.2), "mu": 1.0}, []),  # of a clamped arm nothing can be said
        ({"lambda": 1.0, "mu": 0.9}, ["mu"]),
    ],
)
def test_which_orders_are_free(orders, free):
    found = ladder(problem(swing(), orders=orders))
    assert [n for n in found["viscous, orders free"].problem.names if n in orders] == free


@pytest.mark.broad
def test_tied_orders_stay_tied():
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 0.95, "mu": 0.95}, initial={"alpha": 0.5}, step=1e-2, end=3.0)
    twin = Experiment("twin", 1e-2, run.states[:, [0, 2]], np.zeros((1, 1)))
    tied = Problem(rig, (twin,), {"lambda": Free(1.0, 0.5, 1.2), "mu": Tied("lambda")}, initial_state="held")
    found = ladder(tied)
    assert found["viscous, orders free"].problem.names[:2] == ("lambda", "b_theta")
    row = judged(tied, keep=[*DRAG, "cable_stiffness", "coulomb_theta", "coulomb_alpha"])["viscous, orders free"]
    assert row.orders["mu"] == row.orders["lambda"]
    assert row.orders["mu"].value == pytest.approx(0.95, abs=1e-4)


def test_what_a_clamped_arm_does_not_show_is_left_out_and_said():
    found = ladder(problem(swing()))
    assert not any("theta" in n for s in found.structures for n in s.problem.names)
    assert "The rung + cable is skipped: no recording depends on cable_stiffness." in found.notes
    assert any("do not depend on b_theta" in note for note in found.notes)


def test_what_only_a_recording_that_is_not_fitted_sees_is_found_there():
    voltage = {"torque_per_volt": Free(-0.1, -1.0, 0.0)}
    rig = fracid.rotary_pendulum("srv02-rotpen")
    run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.5}, step=1e-2, end=3.0)
    y = run.states[:, [0, 2]]
    free, driven = (Experiment(n, 1e-2, y, u) for n, u in (("free", np.zeros((1, 1))), ("driven", np.ones((301, 1)))))
    whole = Problem(rig, (free,), {"lambda": 1.0, "mu": 1.0}, voltage, ("torque_per_volt",))
    top = ladder(whole, others=[driven]).structures[-1]
    assert not any("torque_per_volt" in n for n in top.problem.names)
    assert "torque_per_volt [driven]" in top.on({}, driven).names
    assert not any("torque_per_volt" in n for n in top.on({}, free).names)


def test_friction_to_keep_stays_as_the_problem_has_it():
    found = ladder(problem(swing(), parameters=INERTIA | {"b_alpha": 2e-5}), keep=["b_alpha"])
    assert frictions(found)[:2] == ("Coulomb", "Coulomb + drag")
    assert {s.problem.parameters["b_alpha"] for s in found.structures} == {2e-5}


def test_a_ladder_that_cannot_be_is_refused_in_words():
    with pytest.raises(InputError, match=r"'b_alfa': did you mean b_alpha\?"):
        ladder(problem(swing()), keep=["b_alfa"])

    def decay(t, x, u, p, out):
        out[0] = -p[0] * x[0]

    bare = Model("decay", decay, ("x",), ("q",), {"x": 0}, ("u",), (Parameter("rate", "1/s", 1.0, "of decay"),), "", "")
    e = Experiment("one", 0.1, np.exp(-np.arange(20) / 10)[:, None], np.zeros((1, 1)))
    own = Problem(bare, (e,), {"q": Free(1.0, 0.5, 1.2)}, outputs=("x",), initial_state="held")
    assert [s.name for s in ladder(own).structures] == ["decay, orders 1", "decay, orders free"]
    none = Problem(replace(bare, integer_orders={"q": None}), (e,), own.orders, outputs=("x",), initial_state="held")
    with pytest.raises(InputError, match=r"gives q no integer value .* name one, \[\[alternative\]\] in the project"):
        ladder(none)
    plain = replace(bare, orders=(1.0,))
    with pytest.raises(InputError, match="decay has no order that the recordings see, so there is nothing to compare"):
        ladder(Problem(plain, (e,), {}, {"rate": Free(1.0, 0.1, 3.0)}, outputs=("x",), initial_state="held"))
    nu = Equations({"x": Equation("-rate*x", "1 - nu")}, {"x": Equation("x")}).model(
        "rod", [Parameter("nu", "", 0.5, ""), *bare.parameters]
    )
    with pytest.raises(InputError, match=r"rod has an order 1 - nu, a parameter, .* give the state a name of \[model"):
        ladder(Problem(nu, (e,), {}, {"nu": Free(0.5, 0.1, 0.9)}, initial_state="held"))


def test_a_model_of_ones_own_climbs_the_rungs_that_it_has():
    def mass(t, x, u, p, out):
        out[0] = x[1]
        out[1] = -4.0 * x[0] - (p[0] + p[1] * abs(x[1])) * x[1]

    parameters = (Parameter("b_slide", "1/s", 0.1, "viscous"), Parameter("drag_slide", "1/m", 0.0, "drag"))
    own = Model("slide", mass, ("x", "v"), ("q", "q"), {"x": 0}, ("u",), parameters, "", "")
    run = fracid.simulate(own, orders={"q": 1.0}, initial={"x": 1.0}, step=2e-2, end=8.0)
    e = Experiment("one", 2e-2, run.states[:, :1], np.zeros((1, 1)), initial={"x": 1.0})
    found = ladder(Problem(own, (e,), {"q": Free(1.0, 0.5, 1.2)}, outputs=("x",), initial_state="held"))
    assert frictions(found) == ("viscous", "viscous + drag", OWN)  # that has viscous friction as it is, 0.1 1/s
    assert found.notes[0] == (
        "The model slide has no parameter of the rungs Coulomb (coulomb_…), cable (cable_… or spring_…), presliding "
        "(presliding_…), LuGre (presliding_damping_… or stiction_… or stribeck_speed_…)."
    )


def test_the_branches_of_a_capacitor_are_rungs_and_begin_where_its_own_size_is():
    cell, time = from_library("capacitor"), np.arange(0, 300.0)
    u = np.where(time < 60, 1.0, -0.2)
    run = fracid.simulate(cell, orders={"q": 1.0}, parameters={"C_1": 6.0, "R_1": 1.0}, initial={}, step=1.0,
                          end=299.0, inputs=u)  # fmt: skip
    e = Experiment("cell", 1.0, run.states[:, :1] + 0.05 * u[:, None], u[:, None], initial={"v": 0.0})
    free = {"C0": Free(15.0, 1.0, 150.0), "R": Free(0.05, 0.005, 0.5)}
    found = ladder(Problem(cell, (e,), {"q": Free(1.0, 0.6, 1.2)}, free, outputs=("voltage",), initial_state="held"))
    assert frictions(found) == ("branch", "branch + second branch", OWN)
    assert found.notes == ()
    ranges = found["branch, orders 1"].problem.parameters
    assert (ranges["C_1"].start, ranges["R_1"].start) == pytest.approx((1.5, 0.5))
    assert found["branch + second branch, orders 1"].embed({"C_1": 6.0})[-2:].tolist() == [0.0, 30.0]


def test_what_is_held_and_what_is_unseen():
    p = problem(swing())
    assert held(p, {"mu", "C1"}).names == ("alpha(0) [0.6 rad]",)
    assert unseen(p, 0.0) == set()
    assert unseen(replace(p, parameters={"b_theta": Free(0.0, 0.0, 1e-3)}), 1e-4) == {"b_theta"}


def test_what_moves_far_sees_an_unknown_that_its_noise_does_not_hide():
    model, force = fracid.model("oscillator", m=1.0, k=0.0), 3.0 * np.ones((400, 1))
    run = fracid.simulate(model, initial={}, orders={"mu": 1.0}, step=1e-2, end=3.99, inputs=force)
    noise = np.random.default_rng(1).standard_normal((400, 1))
    for size, blind in ((0.1, {"coulomb_displacement"}), (1e-4, set())):
        e = Experiment("far", 1e-2, run.states[:, :1] + size * noise, force, initial={})
        free = {"coulomb_displacement": Free(0.0, 0.0, 5e-3)}
        p = Problem(model, (e,), {"mu": 1.0}, free, initial_state="rest")
        assert unseen(p, 1e-4) == blind


# --- fits and scores ----------------------------------------------------------------------------------------


@pytest.mark.broad
@pytest.mark.parametrize("truth", TRUTHS)
def test_a_richer_structure_never_fits_worse(truth):
    found = compared(truth)
    for s in ladder(problem(swing(**TRUTHS[truth])), rungs=SIMPLE).structures[: len(found.rows)]:
        for name in s.below:
            assert found[s.name].cost <= found[name].cost


@pytest.mark.few(1)
@pytest.mark.parametrize("truth", TRUTHS)
def test_the_true_structure_predicts_to_the_noise_and_what_lacks_it_does_not(truth):
    found = compared(truth)
    true = "viscous + Coulomb + drag" if "drag" in TRUTHS[truth] else "viscous + Coulomb"
    own = found[f"{true}, orders {'free' if truth == 'fractional' else '1'}"]
    assert own.error == pytest.approx(1e-3, rel=0.15)
    assert found["viscous, orders 1"].error > 2 * own.error
    assert [s.rmse["alpha"] for s in own.held_out.values()] == pytest.approx([1e-3] * 3, rel=0.2)
    assert [*own.held_out] == ["0.45 rad", "0.3 rad", "0.2 rad"]
    assert [*own.in_sample] == ["0.6 rad"]


@pytest.mark.broad
def test_a_true_order_comes_back_with_its_interval_and_a_fixed_one_has_none():
    row = compared("fractional")["viscous + Coulomb, orders free"]
    value, ends = row.orders["mu"].value, row.orders["mu"].interval95
    assert ends[0] <= 0.95 <= ends[1]
    assert value == pytest.approx(0.95, abs=2e-3)
    assert row.orders["lambda"] == OrderOfRow(1.0, None)


def test_schwarz_counts_what_an_idle_order_costs():
    found = compared("dry")
    integer, free = found["viscous + Coulomb, orders 1"], found["viscous + Coulomb, orders free"]
    assert integer.bic == 0.0
    assert free.parameters == integer.parameters + 1
    assert 0 < free.bic < math.log(found.effective_samples) + 1e-9


@pytest.mark.broad
def test_scores_are_those_of_the_residual():
    e, others = swing(dry=5e-5), [swing(0.3, dry=5e-5, seed=3)]
    p = problem(e, parameters=INERTIA | {"b_alpha": 1e-5, "coulomb_alpha": 5e-5})
    score = judged(p, validation=others, keep=["b_alpha", "b_theta"])["Coulomb, orders 1"].in_sample["0.6 rad"]
    found = fracid.identify(replace(p, orders={"lambda": 1.0, "mu": 1.0}, parameters=INERTIA | {
        "b_alpha": 1e-5, "coulomb_alpha": Free(5e-5, 0, 1e-2)})).recordings["0.6 rad"]  # fmt: skip
    assert score.rmse["alpha"] == pytest.approx(found.rmse["alpha"], rel=1e-4)
    assert score.fit_percent["alpha"] == pytest.approx(found.fit_percent["alpha"], abs=1e-2)
    itae = COSTS["itae"].value(e.time, found.residual("alpha")[:, None])
    assert score.itae["alpha"] == pytest.approx(itae, rel=1e-3)


def nested(found, hierarchy):
    """Pairs of rows of which the second can be all that the first is."""
    return [(found[n], found[s.name]) for s in hierarchy.structures for n in s.below]


@pytest.mark.broad
def test_the_project_s_own_structure_is_a_row_that_costs_what_its_fit_finds_and_no_row_costs_more_than_one_in_it():
    p = problem(swing(dry=5e-5), parameters=INERTIA | {"b_alpha": 2e-5, "coulomb_alpha": Free(1e-5, 0.0, 1e-3)})
    found, hierarchy = compare(p), ladder(p)
    assert [s.name for s in hierarchy.structures if s.given] == [f"{OWN}, orders free"]
    own, fit = found[f"{OWN}, orders free"], fracid.identify(p)
    assert own.cost <= (1 + 1e-6) * fit.cost
    assert own.values["mu"] == pytest.approx(fit.orders["mu"].value, abs=1e-4)
    assert own.values["b_alpha" if "b_alpha" in own.values else "coulomb_alpha"] == pytest.approx(
        fit.parameters["coulomb_alpha"].value, rel=1e-2)  # fmt: skip
    pairs = nested(found, hierarchy)
    assert (own.name, "viscous + Coulomb, orders free") in [(a.name, b.name) for a, b in pairs]
    for simpler, richer in pairs:
        assert richer.cost <= (1 + 1e-3) * simpler.cost, (simpler.name, richer.name)


def test_a_project_that_is_a_rung_is_no_row_of_its_own_and_rungs_that_are_picked_are_alone():
    free = {"b_alpha": Free(1e-5, 0.0, 1e-3), "coulomb_alpha": Free(1e-5, 0.0, 1e-3)}
    rung = ladder(problem(swing(dry=5e-5), parameters=INERTIA | free))
    assert [s.name for s in rung.structures if s.given] == ["viscous + Coulomb, orders free"]
    assert OWN not in frictions(rung)
    picked = problem(swing(dry=5e-5), parameters=INERTIA | {"b_alpha": 2e-5})
    assert OWN in frictions(ladder(picked))
    assert frictions(ladder(picked, rungs=["viscous", "Coulomb"])) == ("viscous", "viscous + Coulomb")
    with_dry = replace(picked, parameters=INERTIA | {"b_alpha": Free(1e-5, 0.0, 1e-3), "coulomb_alpha": 5e-5})
    found = ladder(with_dry)  # it has the unknowns of the viscous rung, and another dry friction
    assert found[f"{OWN}, orders 1"].below == ("viscous, orders 1",)
    assert f"{OWN}, orders 1" in found["viscous + Coulomb, orders 1"].below


@pytest.mark.broad
def test_a_bound_that_stops_the_fit_of_the_project_is_opened_for_every_structure_and_said():
    narrow = {"b_alpha": Free(1e-6, 0.0, 2e-6), "coulomb_alpha": Free(1e-5, 0.0, 1e-3)}
    p = problem(swing(dry=5e-5), parameters=INERTIA | narrow)
    found, fit = compare(p, rungs=["viscous", "Coulomb"]), fracid.identify(p)
    assert fit.parameters["b_alpha"].value > 5e-6
    row = found["viscous + Coulomb, orders free"]
    assert row.cost <= (1 + 1e-3) * fit.cost
    assert row.values["b_alpha"] == pytest.approx(fit.parameters["b_alpha"].value, rel=0.02)
    assert row.values["b_alpha"] < found.problems[row.name].parameters["b_alpha"].upper
    assert any(
        note.startswith("b_alpha was stopped by its upper bound, 2e-06 N m s/rad: opened to") for note in found.notes
    )


def test_at_a_finer_step_the_structures_are_the_same_whatever_the_recordings_see_there(monkeypatch):
    def there(problem, threshold):
        return unseen(problem, threshold) | ({"coulomb_alpha"} if problem.substeps > 1 else set())

    monkeypatch.setattr("fracid.selection.ladder.unseen", there)
    monkeypatch.setattr("fracid.selection.comparison.is_coarse", lambda _: True)  # its step may be chosen
    monkeypatch.setattr("fracid.selection.comparison.quiet_substeps", lambda *_, **__: 2)
    found = compare(problem(swing(dry=5e-5)), rungs=["viscous", "Coulomb"])
    assert [*found.problems] == [row.name for row in found.rows]
    assert {row.friction for row in found.rows} == {"viscous", "viscous + Coulomb"}
    for row in found.rows:
        assert found.problems[row.name].substeps == 2
        assert found.problems[row.name].names == (*row.values,)


@pytest.mark.parametrize(("noise", "finer"), [(0.1, False), (0.006, True)])
def test_the_step_of_a_comparison_is_fine_enough_for_every_unknown_and_not_for_orders_alone(noise, finer):
    rig = fracid.rotary_pendulum("srv02-rotpen")
    drag = {"b_alpha": Free(rig.parameter("b_alpha").value, 0.0, 1.0)}
    twin = release("twin", rig, orders={"lambda": 1.0, "mu": 1.0}, alpha=0.5, step=1e-3, end=4.0, noise=noise)
    twin = replace(twin, step=1e-2, measured=twin.measured[::10])
    p = Problem(rig, (twin,), {"lambda": 1.0, "mu": 1.0}, drag, initial_state="held")
    assert (quiet_substeps(p, refined(p, p.start, Watch()).best.point) > 1) == finer


@pytest.mark.broad
def test_every_structure_counts_what_it_frees_wherever_its_values_end():
    p = problem(swing(dry=5e-5))
    rungs = ["viscous", "Coulomb", "presliding", "LuGre"]
    found, hierarchy = compare(p, rungs=rungs), ladder(p, rungs=rungs)
    for row in found.rows:
        assert row.parameters == len(hierarchy[row.name].problem.names), row.name
        if row.fractional:
            assert row.parameters == found[row.name.replace("free", "1")].parameters + 1


@pytest.mark.broad
def test_a_model_without_friction_is_compared_as_it_is_with_its_orders_integer_and_free():
    def spring(t, x, u, p, out):
        out[0] = x[1]
        out[1] = -p[0] * x[0]

    model = Model("spring", spring, ("x", "v"), ("q", "q"), {"x": 0}, (), (Parameter("k", "1/s^2", 20.0, ""),), "", "")
    run = fracid.simulate(model, orders={"q": 0.96}, parameters={"k": 25.0}, initial={"x": 1.0}, step=1e-2, end=5.0)
    y = run.states[:, :1] + 1e-3 * np.random.default_rng(1).standard_normal((501, 1))
    e = Experiment("one", 1e-2, y, np.zeros((1, 0)), units={"x": "m"})
    p = Problem(
        model, (e,), {"q": Free(1.0, 0.5, 1.2)}, {"k": Free(20.0, 1.0, 90.0)}, outputs=("x",), initial_state="held"
    )
    for rungs in (None, ["viscous"], RUNGS):
        found = compare(p, rungs=rungs)
        assert [row.name for row in found.rows] == ["spring, orders 1", "spring, orders free"]
    assert found.rows[1].orders["q"].value == pytest.approx(0.96, abs=1e-3)
    assert found.rows[1].in_sample["one"].rmse["x"] == pytest.approx(1e-3, rel=0.1)
    assert "orders explain more in sample" in found.verdict
    assert any("[[alternative]] in the project" in note for note in found.notes)
    only_order = compare(replace(p, parameters={"k": 25.0}))
    assert [row.parameters for row in only_order.rows] == [0, 1]  # of the integer-order model nothing is free
    assert only_order.rows[1].orders["q"].value == pytest.approx(0.96, abs=1e-3)


@pytest.mark.broad
def test_initial_state_and_rest_are_found_again_on_what_is_not_fitted():
    fitted = swing(dry=5e-5, rest=0.01)
    moved = swing(0.35, dry=5e-5, rest=-0.03, seed=9)
    free = INERTIA | {"alpha_rest": Free(0.0, -0.1, 0.1)}
    found = judged(problem(fitted, parameters=free), validation=[moved])
    assert found["viscous + Coulomb, orders 1"].error == pytest.approx(1e-3, rel=0.15)
    fixed = judged(problem(fitted, parameters=INERTIA | {"alpha_rest": 0.01}), validation=[moved])
    assert fixed["viscous + Coulomb, orders 1"].error > 5e-3


@pytest.mark.broad
def test_a_structure_that_diverges_where_it_was_not_fitted_is_told_and_is_valid_json():
    fast = replace(swing(0.3, dry=5e-5), name="fast", step=5.0)  # steps far too long
    found = judged(problem(swing(dry=5e-5)), validation=[fast])
    assert all(row.held_out["fast"].failed for row in found.rows)
    assert found.verdict == "No structure predicts every held-out recording: their runs fail."
    content = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert content["structures"][0]["held_out"]["fast"]["rmse"] == {"alpha": None}
    assert found.lines()[-1]["rmse_deg"] is None


# --- leave one out --------------------------------------------------------------------------------------------


@pytest.mark.broad
def test_left_out_in_turn_each_recording_is_judged_by_a_fit_that_never_saw_it():
    good, odd = swing(dry=5e-5, end=2.0), swing(0.5, dry=1.5e-4, seed=7, end=2.0, name="odd")  # as if of another rig
    found = judged(problem(good), validation=[odd], leave_one_out=True)
    assert found.held_out == ("0.6 rad", "odd")
    row = found["viscous + Coulomb, orders 1"]
    assert [*row.in_sample] == ["0.6 rad", "odd"]
    alone = judged(problem(good), validation=[odd])["viscous + Coulomb, orders 1"]
    assert row.held_out["odd"] == alone.held_out["odd"]
    assert row.held_out["odd"].error > 5e-3 > 2e-3 > alone.in_sample["0.6 rad"].error


@pytest.mark.broad
@pytest.mark.parametrize(("mu", "claim"), [(1.0, "integer"), (0.95, "fractional")])
def test_long_recordings_are_compared_on_means_of_their_first_swings(monkeypatch, mu, claim):
    for name, value in {"LONG": 10_000, "FEWEST": 500, "PART": 600, "TELLING": 3}.items():
        monkeypatch.setattr(long_records, name, value)
    fine, beside = (
        release(name, RIG, orders={"lambda": 1.0, "mu": mu}, parameters={"b_alpha": 1e-5, "coulomb_alpha": 3e-5},
                alpha=angle, step=1e-3, end=14.0, outputs=("alpha",), noise=1e-3, seed=1, known=False)
        for name, angle in (("long", 0.6), ("beside", 0.4))
    )  # fmt: skip
    found = judged(problem(fine), validation=[beside], rungs=("viscous", "Coulomb"))
    assert found.notes[0].startswith("Long recordings are compared on means of 8 samples, the first 4.8 s of each")
    row = found.best(fractional=True)
    value, (low, high) = row.orders["mu"].value, row.orders["mu"].interval95
    assert low - 0.002 < mu < high + 0.002, (low, value, high)
    assert found.claim == claim
    assert mean_rmse(row.held_out)["alpha"] < 1e-3  # of the means


def test_one_recording_alone_cannot_be_left_out():
    with pytest.raises(InputError, match=r"two at least: add another \[\[recording\]\]"):
        compare(problem(swing()), leave_one_out=True)


# --- the same to the bit ---------------------------------------------------------------------------------------


@cache
def plain():
    """A comparison in one go, on one thread."""
    return judged(problem(swing(dry=5e-5, end=2.0)), validation=[swing(0.3, dry=5e-5, seed=3, end=2.0)])


@pytest.mark.broad
def test_numbers_are_the_same_for_any_number_of_threads():
    p, other = problem(swing(dry=5e-5, end=2.0)), [swing(0.3, dry=5e-5, seed=3, end=2.0)]
    assert judged(p, validation=other, jobs=3).to_json() == plain().to_json()


@pytest.mark.broad
def test_cut_short_and_gone_on_with_it_ends_the_same_and_repeats_nothing(tmp_path):
    p, other = problem(swing(dry=5e-5, end=2.0)), [swing(0.3, dry=5e-5, seed=3, end=2.0)]
    told = []

    def stop(progress: Progress):
        told.append((progress.done, progress.total))
        assert progress.left is None, "richer structures take longer"
        if progress.done == 3:
            raise KeyboardInterrupt

    with Journal(tmp_path / "journal.jsonl", {}) as journal, pytest.raises(Unfinished, match="3 of 5 fits"):
        judged(p, validation=other, journal=journal, progress=stop)
    before = (tmp_path / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(before) == 1 + 3
    assert {total for _, total in told} == {5}  # the project as it stands, and four structures
    with Journal(tmp_path / "journal.jsonl", {}) as journal:
        ended = judged(p, validation=other, journal=journal)
    after = (tmp_path / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    assert after[:4] == before
    assert len(after) == 1 + 5
    assert ended.to_json() == plain().to_json()


def test_a_problem_in_memory_stays_in_its_process():
    with pytest.raises(InputError, match=r'give a project .* or executor = "threads"'):
        compare(problem(swing()), executor="processes")


# --- the verdict ------------------------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("truth", "claim", "begins"),
    [
        (
            "dry",
            "integer",
            "Orders make no difference, an integer-order model predicts as well: viscous + Coulomb, ord",
        ),
        ("fractional", "fractional", "Orders help on 3 of 3 held-out recordings, by "),
        (
            "drag",
            "integer",
            "Orders make no difference, an integer-order model predicts as well: viscous + Coulomb + d",
        ),
    ],
)
def test_verdict_and_claim_on_twins_are_their_truth(truth, claim, begins):
    assert compared(truth).verdict.startswith(begins)
    assert compared(truth).claim == claim


def row(friction, fractional, errors, *, bic=0.0, mu=(0.95, (0.94, 0.96))):
    """A row with those errors [rad] on recordings that are held out."""
    scores = {f"r{i}": Score({"alpha": e}, {"alpha": 90.0}, {"alpha": e}, "" if math.isfinite(e) else "diverged")
              for i, e in enumerate(errors)}  # fmt: skip
    name = f"{friction}, orders {'free' if fractional else '1'}"
    orders = {"mu": OrderOfRow(*mu) if fractional else OrderOfRow(1.0, None)}
    return Row(friction, fractional, name, name == "viscous, orders free", 0.1, 5, bic, orders, {}, (), {}, scores, "")


DRY = "viscous + Coulomb"
VERDICTS = {
    "orders help": (
        [4, 3, 2, 1],
        3,
        "Orders help on 3 of 3 held-out recordings, by 50 %: viscous + Coulomb, orders free",
    ),
    "orders replace dry friction": (
        [4, 3, 1, 1],
        3,
        "Coulomb friction explains the data better than free orders: alpha 1.7°",
    ),
    "a rung with orders is worse": ([4, 3, 1, 2], 3, "Coulomb friction explains the data better than free orders"),
    "nothing matters": ([1, 1, 1, 1], 3, "Orders make no difference, an integer-order model predicts as well"),
    "orders hurt": ([1, 1.5, 1.2, 1.4], 3, "Orders fit better and predict worse, by 40 % on held-out recordings"),
    "the paper's is the best": (
        [4, 1, 2, 2],
        3,
        "Orders help on 3 of 3 held-out recordings, by 50 %: viscous, orders free",
    ),
}


@pytest.mark.parametrize("case", VERDICTS)
def test_the_verdict_follows_the_held_out_errors(case):
    errors, count, begins = VERDICTS[case]
    kinds = [("viscous", False), ("viscous", True), (DRY, False), (DRY, True)]
    rows = tuple(row(*kind, [0.01 * e] * count) for kind, e in zip(kinds, errors, strict=True))
    assert verdict_of(result(rows)).startswith(begins)


@pytest.mark.parametrize("coloured", [False, True])
def test_a_doubt_of_the_claim_names_the_residual_and_noise_of_a_filter_raises_none(coloured):
    correlated = {"r1, s": LeftOver(5e-5, 0.0, part=0.05, coloured=coloured), "r1, α": LeftOver(1e-3, 0.0, part=1.0)}
    rows = (replace(row("viscous", False, [1.0]), left_over=correlated), row("viscous", True, [1.0]))
    doubts = replace(result(rows), claim="integer").doubts
    assert doubts == ({} if coloured else {"Fit": "the model lacks something: the residual of r1, s is correlated"})


def result(rows):
    return Comparison(rows, "", (), ("alpha",), 100.0, False, "rmse", 1, 1)


@pytest.mark.parametrize(
    ("integer", "free", "says"),
    [
        ([1, 1, 1], [0.5, 1.1, 1.1], "Orders help on 1 of 3 held-out recordings only, which is no evidence"),
        (
            [1],
            [0.5],
            "orders free (alpha 29°) against viscous, orders 1 (alpha 57°). One held-out recording is not enough",
        ),
        ([1, 1], [0.5, 0.5], "Two held-out recordings are not enough; hold out more."),
        ([math.inf, 1], [1, 1], "Orders help on 1 of 2 held-out recordings only"),
        ([1, 1], [1, math.inf], "Orders fit better and do not predict: viscous, orders free (a run fails) against"),
        ([math.inf], [math.inf], "No structure predicts every held-out recording"),
    ],
)
def test_the_verdict_counts_recordings_and_runs_that_fail(integer, free, says):
    assert says in verdict_of(result((row("viscous", False, integer), row("viscous", True, free))))


@pytest.mark.parametrize(
    ("cost", "parameters", "integer"),
    [(0.1001, 5, True), (0.1001, 9, False), (0.102, 5, False)],
)
def test_what_predicts_as_well_is_integer_only_where_it_explains_the_fitted_recordings_as_well(
    cost, parameters, integer
):
    plain = replace(row("two Maxwell", False, [0.0101], bic=30.0), cost=cost, parameters=parameters)
    found = result((plain, row("viscous", True, [0.01])))
    verdict = verdict_of(found)
    assert integer_does_as_well(found) is integer
    assert verdict.startswith("Orders make no difference" if integer else "Held-out recordings do not decide")
    assert ("less well (BIC 30 higher)" in verdict) is not integer
    assert not [*not_helped(found)]


def test_without_a_criterion_held_out_recordings_decide_alone():
    rows = (row("viscous", False, [0.01], bic=math.inf), row("viscous", True, [0.01], bic=math.inf))
    assert verdict_of(result(rows)).startswith("Orders make no difference")
    assert integer_does_as_well(result(rows))


def test_an_integer_structure_that_explains_and_predicts_as_well_counts_beside_one_that_predicts_better():
    best = replace(row("viscous", False, [0.0056], bic=152.0), cost=0.02)
    other = replace(row("one RC branch", False, [0.0058]), cost=0.0014, parameters=6)
    orders = replace(row("viscous", True, [0.011], bic=17.0), cost=0.002)
    assert integer_does_as_well(result((best, other, orders)))
    assert not integer_does_as_well(result((best, orders)))


def test_orders_that_are_1_within_their_intervals_are_said_to_be():
    rows = (row("viscous", False, [1.0] * 3), row("viscous", True, [0.9] * 3, mu=(1.01, (0.98, 1.04))))
    assert "There the orders are 1 within their intervals (μ 1.010 ± 0.030)." in verdict_of(result(rows))
    rows = (row("viscous", False, [1.0] * 3), row("viscous", True, [0.9] * 3))
    assert "within their intervals" not in verdict_of(result(rows))


def test_what_is_integer_is_what_the_model_says():
    rows = (row("viscous", False, [1.0] * 3), row("viscous", True, [0.9] * 3, mu=(0.01, (-0.02, 0.04))))
    assert "There the orders are 0 within their intervals (μ 0.010 ± 0.030)." in verdict_of(result(rows), {"mu": 0.0})
    assert "within their intervals" not in verdict_of(result(rows), {"mu": None})


def test_on_the_ladder_orders_1_stands_for_what_the_model_calls_integer():
    rig, free = fracid.rotary_pendulum("srv02-rotpen"), {"lambda": Free(0.9, 0.2, 1.2), "mu": Free(1.0, 0.5, 1.2)}
    run = fracid.simulate(rig, orders={"lambda": 0.9, "mu": 0.95}, initial={"alpha": 0.5}, step=5e-3, end=2.0)
    released = Experiment("release", 5e-3, run.states[:, [0, 2]], np.zeros((1, 1)))
    model = replace(rig, integer_orders={"lambda": 0, "mu": None})
    both = Problem(model, (released,), free, initial_state="held")
    found = ladder(both)
    integer, orders = found["viscous, orders 1"], found["viscous, orders free"]
    assert any("where a structure has orders 1, lambda = 0." in note for note in found.notes)
    assert any("mu has no integer value by its model: it is free in every structure." in note for note in found.notes)
    assert integer.whole.orders["lambda"] == 1e-9
    assert isinstance(integer.whole.orders["mu"], Free)
    below = {u.name: u.range.start for u in integer.problem.unknowns} | {"mu": 0.9}
    same = orders.embed(below)
    at = dict(zip(orders.problem.names, same.tolist(), strict=True))
    assert (at["lambda"], at["mu"]) == (1e-9, 0.9)
    assert np.all((orders.problem.space.lower <= same) & (same <= orders.problem.space.upper))
    with pytest.raises(InputError, match="gives lambda and mu no integer value"):
        ladder(replace(both, model=replace(rig, integer_orders={"lambda": None, "mu": None})))


@pytest.mark.parametrize(
    ("gain", "says"),
    [(50.0, "orders explain more in sample (BIC 50 lower)"), (-3.0, "orders explain nothing more")],
)
def test_without_held_out_recordings_the_verdict_is_by_schwarz_and_no_proof(gain, says):
    low = min(0.0, gain)
    rows = (row("viscous", False, [], bic=gain - low), row("viscous", True, [], bic=-low))
    verdict = verdict_of(result(rows))
    assert verdict.startswith("No recording was held out, so this is no proof: ")
    assert says in verdict
    assert "--leave-one-out" in verdict


# --- what leaves it -----------------------------------------------------------------------------------------------


def test_the_table_has_a_line_for_each_structure_recording_and_output():
    found = compared("dry")
    lines = found.lines()
    assert len(lines) == len(found.rows) * 4
    first = lines[0]
    assert (first["friction"], first["orders"], first["use"]) == ("viscous", "1", "fit")
    assert first["rmse_deg"] == pytest.approx(math.degrees(found.rows[0].in_sample["0.6 rad"].rmse["alpha"]))


def test_the_json_names_the_best_and_holds_every_number():
    content = json.loads(json.dumps(compared("dry").to_json(), allow_nan=False))
    assert content["best"]["fractional"] == "viscous + Coulomb, orders free"
    assert [s["name"] for s in content["structures"]] == [r.name for r in compared("dry").rows]
    assert sum(s["paper"] for s in content["structures"]) == 1
    assert content["effective_samples"] > 100


def test_the_figure_has_a_panel_for_the_fit_and_for_each_recording_held_out():
    figure = compared("dry").plot()
    assert [a.get_title() for a in figure.axes] == [
        "fitted: 0.6 rad",
        *(f"held out: {n} rad" for n in (0.45, 0.3, 0.2)),
    ]
    assert [t.get_text() for t in figure.axes[0].get_xticklabels()] == ["viscous", "+ Coulomb"]


@pytest.mark.broad
def test_a_cost_of_ones_own_is_fitted_by_evolution_and_judged_held_out():
    e, other = (replace(swing(a, end=1.5, seed=i), initial={"alpha": a}) for i, a in enumerate((0.6, 0.3)))
    mean_square = Cost("mean_square", function=lambda t, r: float(np.mean(r**2)))
    p = problem(e, parameters={}, cost_function=mean_square, initial_state="held", orders={"lambda": 1.0, "mu": 1.0})
    found = judged(p, validation=[other], keep=["coulomb_theta", "coulomb_alpha", *DRAG])
    assert found["viscous, orders 1"].error == pytest.approx(1e-3, rel=0.2)
    assert all(r.bic == math.inf for r in found.rows)


@pytest.mark.broad
def test_a_comparison_at_40_hz_chooses_its_step_else_orders_would_stand_in_for_it(tmp_path):
    noise = np.random.default_rng(1)
    for name, angle in (("fitted", 1.2), ("held_out", 0.8)):
        run = fracid.simulate(fracid.rotary_pendulum("srv02-rotpen"), orders={"lambda": 1.0, "mu": 1.0},
                              parameters={"coulomb_alpha": 1e-3}, initial={"alpha": angle}, step=1e-3,
                              end=5.0)  # fmt: skip
        y = run.states[::25, [0, 2]] + 1e-4 * noise.standard_normal((len(run.time[::25]), 2))
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([run.time[::25], y]), header="t,theta,alpha", comments="",
                   delimiter=",")  # fmt: skip
    channels = '{ column = "theta", unit = "rad" }\nalpha = { column = "alpha", unit = "rad" }'
    recordings = "".join(
        f'[[recording]]\nname = "{n}"\nfile = "{n}.csv"\ntime = {{ column = "t" }}\ntheta = {channels}\nuse = "{use}"\n'
        for n, use in (("fitted", "fit"), ("held_out", "validate"))
    )
    text = (
        '[model]\nname = "rotary-pendulum"\nrig = "srv02-rotpen"\n[model.parameters]\n'
        "b_alpha = { start = 3e-4, lower = 0.0, upper = 0.01 }\n[model.orders]\nlambda = 1.0\n"
        f"mu = {{ start = 1.0, lower = 0.8, upper = 1.2 }}\n{recordings}[fit]\n"
    )
    claims = {}
    for step, line in (("fixed", "substeps = 1\n"), ("chosen", "")):
        (tmp_path / f"{step}.toml").write_text(text + line, encoding="utf-8")
        claims[step] = compare(fracid.load_project(tmp_path / f"{step}.toml"), rungs=["viscous", "Coulomb"])
    assert claims["fixed"].verdict.startswith("Orders help on 1 of 1")
    assert claims["chosen"].claim == "integer"
    assert claims["chosen"].notes[0].startswith("The step was refined to")
    with_coulomb = claims["chosen"]["viscous + Coulomb, orders 1"]
    assert with_coulomb.values["coulomb_alpha"] == pytest.approx(1e-3, rel=0.02)


@pytest.mark.broad
def test_the_structures_of_a_long_recording_are_told_apart_on_the_part_that_they_are_compared_on(tmp_path, monkeypatch):
    t = 1e-3 * np.arange(300_000)
    np.savez(tmp_path / "long.npz", time=t, alpha=0.3 * np.cos(6 * t))
    (tmp_path / "rig.toml").write_text(
        '[model.parameters]\nb_alpha = { start = 1e-4, lower = 0.0, upper = 1.0 }\n'
        '[[recording]]\nfile = "long.npz"\nalpha = { column = "alpha" }\n'
    )  # fmt: skip
    seen = []

    def looked(problem, **_options):
        seen.extend(len(e.measured) for e in problem.experiments)
        raise InputError("enough")

    monkeypatch.setattr("fracid.workflows.comparison.ladder", looked)
    with pytest.raises(InputError, match="enough"):
        fracid.run_comparison(tmp_path / "rig.toml", out=tmp_path / "out")
    assert seen == [16_001]
