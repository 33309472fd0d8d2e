"""Arrays of other packages, masks and other processes: what stands around fracid in a caller's program."""

import pickle
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import fracid
from fracid.errors import InputError
from fracid.models import Model, Parameter
from fracid.problem import Experiment, Free, Problem
from fracid.problem.costs import COSTS
from fracid.recording.loading import resampled
from fracid.solver.memory import memory_from_name

pytestmark = pytest.mark.usefixtures("without_rivals")

RIG = fracid.rotary_pendulum("srv02-rotpen")
H = 0.01


@pytest.fixture(scope="module")
def problem():
    """A release of a second and a half with mu free."""
    run = fracid.simulate(RIG, orders={"lambda": 1.0, "mu": 0.95}, initial={"alpha": 0.3}, step=H, end=1.5)
    swing = Experiment("swing", H, run.states[:, [0, 2]], np.zeros((1, 1)))
    return Problem(RIG, (swing,), {"lambda": 1.0, "mu": Free(1.0, 0.9, 1.1)}, initial_state="held")


# --- other processes and threads ------------------------------------------------------------------------


@pytest.mark.few(6)
@pytest.mark.parametrize("cost", COSTS)
@pytest.mark.parametrize("memory", ["full", "compressed", "short(50)"])
def test_a_problem_that_was_pickled_costs_the_same_to_the_bit(problem, cost, memory):
    sent = Problem(RIG, problem.experiments, problem.orders, cost_function=COSTS[cost], initial_state="held",
                   memory=memory_from_name(memory))  # fmt: skip
    back = pickle.loads(pickle.dumps(sent))
    x = np.array([0.97])
    assert back.cost(x) == sent.cost(x)
    np.testing.assert_array_equal(back.residuals(x), sent.residuals(x))


def test_a_fit_that_was_pickled_is_the_same(problem):
    fit = fracid.identify(problem, optimiser="least-squares")
    assert pickle.loads(pickle.dumps(fit)).to_json() == fit.to_json()


def test_a_project_that_was_pickled_is_the_same(tmp_path):
    t = np.arange(100) * H
    np.savez(tmp_path / "swing.npz", time=t, alpha=0.3 * np.cos(6 * t))
    (tmp_path / "rig.toml").write_text('[[recording]]\nfile = "swing.npz"\nalpha = { column = "alpha" }')
    project = fracid.load_project(tmp_path / "rig.toml")
    back = pickle.loads(pickle.dumps(project))
    assert (back.text, back.problem.names) == (project.text, project.problem.names)
    assert back.problem.cost(back.problem.start) == project.problem.cost(project.problem.start)


def _fitted(problem):
    return fracid.identify(problem, optimiser="least-squares").x.tolist()


@pytest.mark.broad
def test_fits_in_other_processes_and_many_in_threads_are_those_of_this_one(problem):
    alone = _fitted(problem)
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert pool.submit(_fitted, problem).result() == alone
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(_fitted, [problem] * 6)) == [alone] * 6


@pytest.mark.slow(minutes=2)
def test_two_hundred_fits_from_eight_threads_are_one_and_leave_no_thread_behind(problem):
    alone, before = _fitted(problem), threading.active_count()
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(_fitted, [problem] * 200)) == [alone] * 200
    assert threading.active_count() == before


# --- masks ----------------------------------------------------------------------------------------------


MASKED = np.ma.masked_greater([0.0, 0.1, 1e9, 0.3, 0.4, 0.5], 10.0)

CALLS = {
    "derivative": lambda: fracid.derivative(MASKED, 0.5, H),
    "solve_fde": lambda: fracid.solve_fde(lambda t, x, u, p, out: None, orders=0.5, initial=MASKED, step=H, end=1.0),
    "simulate": lambda: fracid.simulate(
        RIG, orders={"lambda": 1.0, "mu": 1.0}, initial={"alpha": 0.1}, step=H, end=5 * H, inputs=MASKED
    ),
    "Experiment": lambda: Experiment("swing", H, MASKED[:, None], np.zeros((1, 1))),
    "its inputs": lambda: Experiment("swing", H, np.zeros((6, 1)), MASKED[:, None]),
}


@pytest.mark.parametrize("call", CALLS)
def test_what_is_behind_a_mask_is_never_taken_for_a_number(call):
    with pytest.raises(InputError, match="1 of 6 values are masked, and what is behind a mask is no number"):
        CALLS[call]()


def test_masked_samples_of_a_recording_are_missing():
    recording = fracid.Recording.of("swing", H * np.arange(6), {"alpha": MASKED})
    assert "alpha misses 1 sample at 0.02 s" in recording.report.faults[0]


# --- pandas ---------------------------------------------------------------------------------------------


def test_tables_of_pandas_are_arrays_like_any(problem):
    pandas = pytest.importorskip("pandas")
    e = problem.experiments[0]
    table = pandas.DataFrame(
        e.measured, columns=["theta", "alpha"], index=pandas.date_range("2024", periods=len(e.time))
    )
    same = Experiment("swing", H, table, np.zeros((1, 1)))
    np.testing.assert_array_equal(same.measured, e.measured)
    recording = fracid.Recording.of("swing", pandas.Series(e.time), {"alpha": table["alpha"]})
    np.testing.assert_array_equal(recording.signals["alpha"], e.measured[:, 1])
    np.testing.assert_array_equal(
        fracid.derivative(table["alpha"], 0.5, H), fracid.derivative(e.measured[:, 1], 0.5, H)
    )


# --- polars ---------------------------------------------------------------------------------------------


class Column:
    """What polars' Series is to NumPy: an array on demand, in which missing values are NaN."""

    def __init__(self, values):
        self._values = values

    def __array__(self, dtype=None, copy=None):
        return np.array([np.nan if v is None else v for v in self._values], dtype=dtype)

    def __len__(self):
        return len(self._values)

    def __eq__(self, other):  # by elements, as all its operators
        return Column([v == other for v in self._values])

    __hash__ = None

    def __bool__(self):
        raise TypeError("the truth value of a Series is ambiguous")


class Table:
    """What polars' DataFrame is: columns with names, of two dimensions as an array; it has no ``items``."""

    def __init__(self, columns):
        self._columns = {n: Column(values) for n, values in columns.items()}

    def __array__(self, dtype=None, copy=None):
        return np.stack([np.asarray(c) for c in self._columns.values()], axis=-1).astype(dtype)

    def __getitem__(self, name):
        return self._columns[name]

    def to_dict(self):
        return dict(self._columns)


def polars_or_its_like(columns):
    """A table of polars where it is installed, else one that behaves so."""
    try:
        from polars import DataFrame
    except ImportError:
        return Table(columns)
    return DataFrame(columns)


@pytest.mark.parametrize("made", [Table, polars_or_its_like], ids=["its like", "polars"])
def test_tables_of_polars_are_arrays_like_any_and_their_columns_are_signals_by_name(problem, made):
    e = problem.experiments[0]
    theta, alpha = e.measured.T
    table = made({"time": e.time.tolist(), "alpha": alpha.tolist(), "theta": [None, *theta[1:].tolist()]})
    recording = fracid.Recording.of("swing", table["time"], {"alpha": table["alpha"]})
    np.testing.assert_array_equal(recording.signals["alpha"], alpha)
    recording = fracid.Recording.of("swing", e.time, table.to_dict())
    np.testing.assert_array_equal(recording.signals["theta"], [np.nan, *theta[1:]])
    np.testing.assert_array_equal(fracid.derivative(table["alpha"], 0.5, H), fracid.derivative(alpha, 0.5, H))
    angles = made({"theta": theta.tolist(), "alpha": alpha.tolist()})
    np.testing.assert_array_equal(Experiment("swing", H, angles, np.zeros((1, 1))).measured, e.measured)
    with pytest.raises(InputError, match=r"has no names of signals; .* of polars table.to_dict\(\)"):
        fracid.Recording.of("swing", e.time, angles)
    with pytest.raises(InputError, match="swing: alpha is no array of real numbers"):
        fracid.Recording.of("swing", e.time, {"alpha": made({"alpha": ["a"] * len(e.time)})["alpha"]})


# --- xarray, pint ---------------------------------------------------------------------------------------


class Labelled:
    """What xarray's DataArray is to NumPy: names about an array that it gives on demand."""

    def __init__(self, values, dims):
        self._values, self.dims, self.coords = values, dims, {}

    def __array__(self, dtype=None, copy=None):
        return np.array(self._values, dtype=dtype)

    def __len__(self):
        return len(self._values)


def test_labelled_arrays_are_arrays_like_any(problem):
    e = problem.experiments[0]
    same = Experiment("swing", H, Labelled(e.measured, ("time", "signal")), np.zeros((1, 1)))
    np.testing.assert_array_equal(same.measured, e.measured)
    time, alpha = Labelled(e.time, ("time",)), Labelled(e.measured[:, 1], ("time",))
    np.testing.assert_array_equal(fracid.Recording.of("swing", time, {"alpha": alpha}).signals["alpha"], alpha)
    np.testing.assert_array_equal(fracid.derivative(alpha, 0.5, H), fracid.derivative(e.measured[:, 1], 0.5, H))


class Quantity(Labelled):
    """What pint's and astropy's are: numbers whose unit is gone once they are an array, and which equal no word."""

    units = "degree"

    def to(self, unit):
        raise NotImplementedError

    def __eq__(self, other):
        raise TypeError

    __hash__ = None


class Holder(Labelled):
    """An array of xarray's around one of pint's."""

    data = Quantity(np.ones(5), ())


TAKE = {
    "a signal": lambda of: fracid.Recording.of("swing", H * np.arange(5), {"alpha": of}),
    "what is measured": lambda of: Experiment("swing", H, of, np.zeros((1, 1))),
    "a step": lambda of: Experiment("swing", of, np.zeros((5, 1)), np.zeros((1, 1))),
    "a signal to derive": lambda of: fracid.derivative(of, 0.5, H),
    "an order": lambda of: fracid.solve_fde(print, of, [1.0], step=H, end=1.0),
    "initial values": lambda of: fracid.solve_fde(print, [0.5], of, step=H, end=1.0),
    "the step of a run": lambda of: fracid.solve_fde(print, [0.5], [1.0], step=of, end=1.0),
    "a value to find": lambda of: fracid.Free(of, 0.0, 1.0),
}


@pytest.mark.parametrize("take", TAKE.values(), ids=TAKE)
@pytest.mark.parametrize(
    "what",
    [
        Quantity(np.ones(5), ()),
        Holder(np.ones(5), ()),
        np.arange(5).astype("datetime64[ms]"),
        np.arange(5).astype("m8[ms]"),
        np.array(["1"] * 5),
    ],
    ids=["unit", "unit within, as in xarray", "dates", "spans of time", "words"],
)
def test_what_is_more_than_numbers_is_refused_in_a_line_and_not_stripped_of_it(take, what):
    with pytest.raises(InputError, match="number") as refused:
        take(what)
    assert "\n" not in str(refused.value)


def test_a_step_to_resample_at_that_equals_no_word_is_refused():
    swing = fracid.Recording.of("swing", H * np.arange(5), {"alpha": np.arange(5.0)})
    with pytest.raises(InputError, match="is not possible; expected true, a step"):
        resampled(swing, Quantity(1.0, ()))


@pytest.mark.parametrize("times", [[0, 2, 1, 3, 4], [0, 1, 1, 2, 3], [0, 1, np.nan, 3, 4], [0, 1], np.ones((5, 1))])
def test_times_that_jump_back_or_are_not_one_for_each_sample_are_refused(times):
    with pytest.raises(InputError, match="swing: times do not increase from sample to sample"):
        Experiment("swing", H, np.zeros((5, 1)), np.zeros((1, 1)), times=times)


@pytest.mark.parametrize("signals", [np.ones(5), [1.0], Labelled(np.ones(5), ()), "alpha", None])
def test_signals_without_names_are_refused_in_a_line(signals):
    with pytest.raises(InputError, match=f"swing: a {type(signals).__name__} has no names of signals; expected e.g."):
        fracid.Recording.of("swing", H * np.arange(5), signals)


def test_a_table_with_words_in_it_is_refused():
    with pytest.raises(InputError, match="swing: measured is no array of real numbers"):
        Experiment("swing", H, np.array([["a"], ["b"]]), np.zeros((1, 1)))


def test_the_unit_that_an_array_brings_is_heeded():
    swing = Labelled(np.arange(5.0), ())
    swing.attrs = {"units": "V"}
    assert fracid.Recording.of("swing", H * np.arange(5), {"alpha": swing}).units == {"alpha": "V"}
    swing.attrs = {"units": "deg"}
    with pytest.raises(InputError, match="deg"):
        fracid.Recording.of("swing", H * np.arange(5), {"alpha": swing})


def test_a_step_of_another_float_is_a_step():
    assert type(Experiment("swing", np.float32(0.5), np.zeros((5, 1)), np.zeros((1, 1))).step) is float


@pytest.mark.parametrize("load", [fracid.load_project, fracid.load_run, fracid.load_recording])
def test_a_table_is_no_path(load):
    with pytest.raises(InputError, match="A dict is no path; expected e"):
        load({"alpha": [1.0, 2.0]})


def fades(t, x, u, p, out):
    out[0] = -p[0] * x[0]


@pytest.mark.parametrize("substeps", [1, 2])
def test_a_model_without_inputs_may_have_columns_of_none(substeps):
    model = Model("fades", fades, ("x",), (1.0,), {"x": 0}, (), (Parameter("k", "1/s", 1.0, "rate"),), "", "a test")
    fading = Experiment("fading", 0.1, np.exp(-0.1 * np.arange(50))[:, None], np.zeros((50, 0)), initial={"x": 1.0})
    problem = Problem(model, (fading,), {}, {"k": Free(1.0, 0.1, 5.0)}, initial_state="held", substeps=substeps)
    assert problem.evaluate(problem.start).cost < 1e-3
