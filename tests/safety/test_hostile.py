"""What a careless user does, and a malicious one: nothing is answered wrongly in silence, no work is lost."""

import json
import signal
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import fracid
from fracid.errors import InputError, Unfinished
from fracid.recording import Recording, load_recording
from fracid.runs.folder import run_state
from fracid.tasks.local import deaf_to_ctrl_c
from program import leave_figures_out, run
from twins import write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

# --- recordings that are mangled as real ones are ------------------------------------------------------

T = np.arange(0, 8, 0.004)
ALPHA = 2 * np.pi / 4096 * np.rint(4096 / (2 * np.pi) * 1.05 * np.cos(8 * T) * np.exp(-0.3 * T))


def changed(samples, where, value):
    """The samples with some of them replaced."""
    x = samples.copy()
    x[where] = value
    return x


MANGLED = {
    "counts as they are": ("counts-as-radians", T, np.rint(4096 / (2 * np.pi) * ALPHA)),
    "milliseconds": ("wrong-clock", 1e3 * T, ALPHA),
    "microseconds": ("wrong-clock", 1e6 * T, ALPHA),
    "the number of the sample as time": ("wrong-clock", np.arange(T.size, dtype=float), ALPHA),
    "minutes": ("wrong-clock", T / 60, ALPHA),
    "one wild sample": ("jump", T, changed(ALPHA, 700, 50.0)),
    "a wild sample of 30 degrees": ("jump", T, changed(ALPHA, 700, ALPHA[700] + 0.5)),
    "zeros where nothing was read": ("jump", T, changed(ALPHA, slice(690, 720), 0.0)),
    "-9999 where nothing was read": ("jump", T, changed(ALPHA, slice(690, 720), -9999.0)),
    "a count that was wrapped": ("jump", T, changed(ALPHA, slice(700, None), ALPHA[700:] + 2 * np.pi)),
    "a wrapped angle": ("jump", T, np.mod(ALPHA + 6.0, 2 * np.pi)),
    "the recording twice in one file": ("jump", np.arange(2 * T.size) * 0.004, np.tile(ALPHA, 2)),
}


@pytest.mark.parametrize("how", MANGLED)
def test_a_mangled_recording_is_not_called_good(how):
    code, time, alpha = MANGLED[how]
    report = Recording.of("swing", time, {"alpha": alpha}).report
    assert {f.code for f in report.findings} == {code}
    assert report.level == "usable"
    (found,) = report.findings
    assert (found.number > found.limit) != (how == "minutes")


def test_single_samples_of_the_wrong_sign_are_jumps_though_few_samples_draw_a_swing():
    t, flipped = np.arange(0, 10, 1 / 30), [66, 82, 130, 171, 172, 210, 258]
    swing = 0.7 * np.cos(7 * t) * np.exp(-t / 20) + 2e-3 * np.random.default_rng(1).standard_normal(t.size)
    clean, spoilt = (
        Recording.of("s", t, {"alpha": x}).report for x in (swing, changed(swing, flipped, -swing[flipped]))
    )
    assert clean.findings == ()
    [found] = spoilt.findings
    assert found.code == "jump"
    assert "a single sample lies" in str(found)
    assert "Leave those cells blank" in str(found)


def test_the_jump_of_a_whole_turn_says_unwrap_and_another_does_not():
    turn, glitch = (Recording.of("s", *MANGLED[how][1:2], {"alpha": MANGLED[how][2]}).report.findings[0].sentence
                    for how in ("a count that was wrapped", "one wild sample"))  # fmt: skip
    assert "unwrap = true" in turn
    assert "unwrap" not in glitch
    assert "once after 2.796 s" in turn


@pytest.mark.parametrize(
    "moves",
    [
        np.where(T < 2, 1.0, np.cos(9 * (T - 2))),  # let go
        np.where(T < 2, 0.0, np.minimum(30 * (T - 2), 1.0)),  # hits a stop
        np.cumsum(np.random.default_rng(3).choice([0, 0.0314], T.size, p=[0.8, 0.2])),  # a stepper motor's steps
        np.random.default_rng(4).standard_normal(T.size),  # all noise
        np.round(np.cos(0.9 * T), 2),  # a coarse encoder
    ],
)
def test_what_moves_as_things_do_does_not_jump(moves):
    found = Recording.of("arm", T, {"theta": moves, "alpha": ALPHA}).report.findings
    assert "jump" not in {f.code for f in found}


def written(folder, header, *columns):
    """A text recording."""
    file = folder / "swing.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return file


COUNTS = np.rint(4096 / (2 * np.pi) * ALPHA)


@pytest.mark.parametrize(
    ("header", "first", "alpha", "columns", "says"),
    [
        ("t,alpha [counts]", T, COUNTS, {"alpha": 1}, "alpha is in counts, as the header says; type counts_per_turn ="),
        ("t,alpha", T, COUNTS, {"alpha": {"column": 1, "counts_per_turn": 4096}}, 'type unit = "counts", or leave'),
        ("t,alpha", T, ALPHA, {"alpha": {"column": 1, "unit": "deg", "counts_per_turn": 4}}, "and its unit is deg"),
        ("t,alpha", T, ALPHA, {"alpha": 0}, "alpha and time are both column 0, 't', of swing.csv; give each its own."),
        ("t,alpha", T, ALPHA, {"theta": 1, "alpha": 1}, "alpha and theta are both column 1"),
    ],
)
def test_columns_that_cannot_be_meant_so_are_refused(tmp_path, header, first, alpha, columns, says):
    with pytest.raises(InputError) as refused:
        load_recording(written(tmp_path, header, first, alpha), columns)
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("header", "factor", "channel"),
    [
        ("time [min],alpha [counts]", 1 / 60, {"counts_per_turn": 4096}),
        ("time [h],alpha [ticks]", 1 / 3600, {"counts_per_turn": 4096}),
        ("time [\u03bcs],alpha", 1e6, {"unit": "counts", "counts_per_turn": 4096}),
        ("time (msec),alpha (Counts)", 1e3, {"counts_per_turn": 4096}),
    ],
)
def test_what_a_header_says_of_time_and_counts_is_taken(tmp_path, header, factor, channel):
    found = load_recording(written(tmp_path, header, factor * T, COUNTS), {"alpha": {"column": 1, **channel}})
    assert found.step == pytest.approx(0.004, rel=1e-6)
    assert np.ptp(found.signals["alpha"]) == pytest.approx(np.ptp(ALPHA), abs=1e-9)
    assert found.report.findings == ()


@pytest.mark.parametrize(
    ("unit", "factor"), [("mrad", 1e3), ("gon", 200 / np.pi), ("\u00b5rad", 1e6), ("rev", 0.5 / np.pi)]
)
def test_a_unit_of_a_header_is_the_units_own_factor(tmp_path, unit, factor):
    found = load_recording(written(tmp_path, f"t,alpha [{unit}]", T, factor * ALPHA), {"alpha": 1})
    np.testing.assert_allclose(found.signals["alpha"], ALPHA, rtol=1e-8, atol=1e-12)


def test_a_rate_that_the_files_own_clock_denies_is_told_however_the_recording_is_cut(tmp_path):
    file = written(tmp_path, "time,alpha", T, ALPHA)
    told = load_recording(file, {"alpha": 1}, time={"rate": 500}, start=1.0).report
    assert "the rate is 500 Hz, as given, and the column 'time' runs at 250 Hz" in " ".join(told.notes)
    assert told.level == "usable"
    for rate, factor in ((250, 1.0), (250.5, 1.0), (250, 1e3), (250, 1e6)):  # rounded, or the column in ms or us
        file = written(tmp_path, "time,alpha", factor * T, ALPHA)
        assert load_recording(file, {"alpha": 1}, time={"rate": rate}).report.level == "good"


# --- options --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("check FILE --column alpha=1 --column alpha=2", "--column says alpha twice"),
        ("check FILE --column alpha=1,unit=deg,unit=rad", "says unit twice, deg and rad; say it once."),
        ("init FILE --column alpha=1 --column alpha=2", "--column says alpha twice"),
        ("regress FILE --column alpha=1 --column alpha=2", "--column says alpha twice"),
        ("regress FILE --column alpha=1 --order mu=1 --order mu=2", "--order says mu twice, 1.0 and 2.0; say it once."),
        ("simulate qube-servo2 --order mu=1 --order mu=0.9", "--order says mu twice"),
        ("simulate qube-servo2 --initial alpha=1deg --initial alpha=2deg", "--initial says alpha twice"),
        ("simulate qube-servo2 --noise 1deg --noise 2deg", "--noise says all twice"),
    ],
)
def test_an_option_that_says_two_things_of_one_is_refused(tmp_path, capsys, words, says):
    file = written(tmp_path, "t,alpha", T, ALPHA)
    code, _, err = run(capsys, *(str(file) if w == "FILE" else w for w in words.split()))
    assert code == 2
    assert says in err


# --- nothing is lost -------------------------------------------------------------------------------------

PROJECT = """
[model]
rig = "srv02-rotpen"
[model.orders]
lambda = 1.0
mu = { start = 1.0, lower = 0.6, upper = 1.2 }
[[recording]]
file = "swing.npz"
theta = { column = "theta" }
alpha = { column = "alpha" }
[fit]
initial_state = "rest"
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A short swing and a project file beside it."""
    folder = tmp_path_factory.mktemp("project")
    write_release(folder / "swing.npz", orders={"lambda": 1.0, "mu": 0.95}, alpha=0.3, step=0.01, end=2.0, noise=1e-3)
    (folder / "rig.toml").write_text(PROJECT)
    return folder / "rig.toml"


def drawn_so(monkeypatch, draw):
    leave_figures_out(monkeypatch, draw)


@pytest.mark.broad
@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (Unfinished("run/figures cannot be written: the disk is full."), 1, "the disk is full."),
        (OSError(28, "No space left on device"), 1, "No space left on device"),
        (MemoryError(), 1, "There is not enough memory for the figures."),
        (KeyboardInterrupt(), 1, "Interrupted while the figures were drawn."),
    ],
    ids=lambda v: type(v).__name__ if isinstance(v, BaseException) else "",
)
def test_a_fit_whose_figures_fail_shows_and_keeps_its_result_and_resume_draws_them(
    project, tmp_path, capsys, monkeypatch, error, code, says
):
    def failing(_):
        raise error

    drawn_so(monkeypatch, failing)
    ended, out, err = run(capsys, "fit", project, "--out", tmp_path / "run", "--jobs", 1)
    assert ended == code
    assert "mu" in out
    assert says in err
    assert f"To draw them: fracid resume {tmp_path / 'run'}" in err
    assert json.loads((tmp_path / "run" / "result.json").read_text())["orders"]["mu"]["value"] == pytest.approx(
        0.95, abs=0.05
    )
    assert not run_state(tmp_path / "run").finished

    drawn_so(monkeypatch, lambda _: (tmp_path / "run" / "report.html",))
    ended, out, _ = run(capsys, "resume", tmp_path / "run", "--jobs", 1)
    assert ended == 0
    assert "report.html" in out
    assert run_state(tmp_path / "run").finished


@pytest.mark.broad
def test_a_fit_that_was_cut_short_and_is_typed_again_goes_on_and_another_begins_anew(
    project, tmp_path, capsys, monkeypatch
):
    def stopped(_):
        raise KeyboardInterrupt

    words = ("fit", project, "--out", tmp_path / "run", "--jobs", 1)
    drawn_so(monkeypatch, stopped)
    run(capsys, *words)
    drawn_so(monkeypatch, lambda _: ())
    code, _, err = run(capsys, *words)
    assert (code, run_state(tmp_path / "run").finished) == (0, True)
    assert "holds this fit, interrupted: it is resumed." in err
    assert "it is resumed" not in run(capsys, *words)[2]  # finished
    drawn_so(monkeypatch, stopped)
    run(capsys, *words)
    assert "it is resumed" not in run(capsys, *words, "--seed", 7)[2]


def _blocked():
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.broad
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no masks of signals here")
def test_a_process_beside_does_not_hear_ctrl_c_from_its_first_moment_on():
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        with deaf_to_ctrl_c():
            found = pool.submit(_blocked)
        assert found.result()
    assert not _blocked()


# --- from Python, as a newcomer writes it ------------------------------------------------------------------


def decay(t, x, u, p, out):
    out[0] = -p[0] * x[0]


def wraps_in_place(t, x, u, p, out):
    x[0] = x[0] % 1.5
    out[0] = -x[0]


def counts_calls(t, x, u, p, out):
    p[0] += 1.0
    out[0] = -x[0]


SOLVED = {"orders": 0.8, "initial": [1.0], "step": 0.01, "end": 1.0, "parameters": [1.0]}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"initial": np.ma.masked_array([1.0], [True])}, "initial: 1 of 1 values are masked"),
        ({"inputs": np.ones((101, 1), complex)}, "expected numbers"),
        ({"inputs": np.ones((1, 101))}, "Transpose it: inputs.T."),
        ({"inputs": np.full((101, 1), np.nan)}, "every value must be a finite number"),
        ({"step": "0.01"}, "step = '0.01': expected a number of seconds."),
        ({"step": None}, "step = None: expected a number of seconds."),
        ({"step": 1e-12, "end": 1e6}, "makes 1e+18 steps; give a longer one"),
        ({"end": [1.0]}, "end = [1.0]: expected a number of seconds."),
        ({"tolerance": "a"}, "tolerance = 'a': expected a number above 0."),
        ({"limit": -1.0}, "limit = -1.0: expected a number above 0."),
        ({"limit": np.nan}, "limit = nan: expected a number above 0."),
        ({"times": []}, "times must be a list of times"),
        ({"rhs": wraps_in_place, "initial": [2.0]}, "wraps_in_place changes x, u or p, which are not its own"),
        ({"rhs": counts_calls}, "counts_calls changes x, u or p, which are not its own"),
    ],
)
def test_what_cannot_be_solved_as_given_is_a_sentence(changed, says):
    with pytest.raises(InputError) as refused:
        fracid.solve_fde(**{"rhs": decay, **SOLVED, **changed})
    assert says in str(refused.value)
    assert len(str(refused.value)) < 300


def test_what_is_given_is_neither_changed_nor_need_it_lie_in_one_piece():
    states = np.arange(8.0)[::4][:1] + 1.0
    states.setflags(write=False)
    parameters = np.array([[1.0, 9.0]], dtype=np.float32)[:, :1].ravel()
    given = {**SOLVED, "initial": states, "parameters": parameters, "inputs": np.zeros((202, 2))[::2, :1]}
    assert fracid.solve_fde(decay, **given).states == pytest.approx(fracid.solve_fde(decay, **SOLVED).states, abs=1e-15)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"model": "srv02-rotpen"}, "fracid.rotary_pendulum('srv02-rotpen')"),
        ({"initial": {"alpha": "10deg"}}, "numpy.radians(10)"),
    ],
)
def test_a_simulation_that_is_asked_for_wrongly_is_a_sentence(changed, says):
    asked = {"model": fracid.rotary_pendulum("srv02-rotpen"), "orders": 1.0, "initial": {}, "step": 0.01, "end": 1.0}
    with pytest.raises(InputError) as refused:
        fracid.simulate(**{**asked, **changed})
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("time", "signals", "units", "says"),
    [
        (T, {"alpha": ALPHA + 0j}, None, "s: alpha is no array of real numbers"),
        (np.datetime64("2026-01-01") + (1e3 * T).astype("m8[ms]"), {"alpha": ALPHA}, None, "time is no array of real"),
        (T, {"alpha": np.full(T.size, "a")}, None, "alpha is no array of real numbers"),
        (T, {"alpha": np.degrees(ALPHA)}, {"alpha": "deg"}, "Degrees: numpy.radians(samples)."),
        (T, {"alpha": ALPHA}, {"alfa": "rad"}, "the unit 'rad' of 'alfa' is not possible"),
        (T, {}, None, "no signal"),
        (T * np.nan, {"alpha": ALPHA}, None, "2000 time stamps are not finite"),
    ],
)
def test_arrays_that_are_no_recording_are_refused(time, signals, units, says):
    with pytest.raises(InputError) as refused:
        Recording.of("s", time, signals, units)
    assert says in str(refused.value)


def test_what_is_masked_in_an_array_is_missing_and_makes_the_recording_unfit():
    assert Recording.of("s", T, {"alpha": np.ma.masked_greater(ALPHA, 0.0)}).report.level == "unfit"


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"problem": "rig.toml"}, 'fracid.identify(fracid.load_project("rig.toml"))'),
        ({"validation": (1,)}, 'a project has its own, by use = "validate"'),
        ({"seed": -1}, "seed = -1; expected a whole number, 0 or more."),
        ({"seed": 1.5}, "seed = 1.5; expected a whole number"),
        ({"starts": 0}, "starts = 0; expected a whole number, 1 or more."),
        ({"executor": "gpu"}, "There is no executor 'gpu'"),
    ],
)
def test_what_cannot_be_identified_as_asked_is_a_sentence_before_anything_is_searched(project, asked, says):
    with pytest.raises(InputError) as refused:
        fracid.identify(**{"problem": fracid.load_project(project), **asked})
    assert says in str(refused.value)


# --- one command does not take another's place -----------------------------------------------------------------


@pytest.mark.broad
def test_the_fit_of_another_project_is_not_written_over(project, tmp_path, capsys, monkeypatch):
    drawn_so(monkeypatch, lambda _: ())
    folder = tmp_path / "run"
    run(capsys, "fit", project, "--out", folder, "--jobs", 1)
    kept = (folder / "result.json").read_bytes()
    other = project.with_name("other.toml")
    other.write_text(PROJECT.replace("start = 1.0", "start = 0.9"))
    code, _, err = run(capsys, "fit", other, "--out", folder, "--jobs", 1)
    assert code == 2
    assert f"holds the fit of another project, {project}" in err
    assert (folder / "result.json").read_bytes() == kept
    other.rename(tmp_path / "gone.toml")


@pytest.mark.broad
def test_what_is_reproduced_does_not_take_the_place_of_a_result(project, tmp_path, capsys, monkeypatch):
    drawn_so(monkeypatch, lambda _: ())
    folder = tmp_path / "run"
    run(capsys, "fit", project, "--out", folder, "--jobs", 1)
    kept = (folder / "result.json").read_bytes()
    code, _, err = run(capsys, "reproduce", folder, "--out", folder, "--jobs", 1)
    assert code == 2
    assert "holds files already; give an empty or a new folder: --out DIR." in err
    assert (folder / "result.json").read_bytes() == kept


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            "fit PROJECT --multi-start 2 --executor processes --scheduler tcp://h:1",
            "are two places; give one of the two.",
        ),
        ("compare PROJECT --executor processes --scheduler tcp://h:1", "are two places; give one of the two."),
        ("fit PROJECT --seed 9223372036854775808", "expected less than 2^63."),
        ("profile PROJECT --seed -1", "--seed"),
        ("noise PROJECT --seed -1", "--seed"),
        ("draw PROJECT --zero upright", "--zero is for a rig;"),
        ("simulate qube-servo2 --order mu=abc", "e.g. --order mu=0.91."),
        ("simulate qube-servo2 --initial alpha=1m", "e.g. --initial alpha=10deg."),
        ("simulate qube-servo2 --hold -1", "hold = -1 s is not possible; expected 0 or more."),
    ],
)
def test_an_option_out_of_its_range_or_beside_its_rival_is_refused(project, tmp_path, capsys, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *(str(project) if w == "PROJECT" else w for w in words.split()))
    assert code == 2
    assert says in err
    assert list(tmp_path.iterdir()) == []
