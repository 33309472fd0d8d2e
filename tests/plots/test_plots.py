"""Figures show what they are given, say what is missing, and are written whole, small and the same each time."""

import subprocess
import sys
import threading
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from scipy import stats

from fracid.arrays import extremes
from fracid.errors import InputError, Unfinished
from fracid.estimation.cost_plane import CostPlane
from fracid.estimation.records import RecordingFit
from fracid.plots import appearance, cost_plane, fitted_over_time, recording_overview, residual_plots, save
from fracid.plots.appearance import BINS
from fracid.plots.fitted import _fast_part
from fracid.recording import Recording

ENCODER = 2 * np.pi / 4096
STEPS = {"theta": ENCODER, "alpha": ENCODER}


def decay(time, frequency=7.0):
    return 0.2 * np.exp(-0.3 * time) * np.cos(frequency * time)


def twin(samples=20_000, **changes):
    """A decay at 1 kHz, measured by an encoder of 4096 counts."""
    time = 3.0 + 1e-3 * np.arange(samples)
    fitted = {"theta": 0.3 * decay(time - 3, 5.0), "alpha": decay(time - 3)}
    noise = np.random.default_rng(1).normal(0, ENCODER / 2, (2, samples))
    measured = {n: ENCODER * np.round((y + e) / ENCODER) for (n, y), e in zip(fitted.items(), noise, strict=True)}
    return replace(RecordingFit("twin", "fit", time, measured, fitted, 1e-3, {}, {}), **changes)


def failing_from(second, recording):
    """The recording, with a simulation that ends there."""
    late = recording.time >= second
    return replace(recording, fitted={n: np.where(late, np.nan, y) for n, y in recording.fitted.items()})


def words(figure):
    """All that is written in a figure."""
    return "\n".join(text.get_text() for text in figure.findobj(Text))


def data(axes, label):
    """The line of that label."""
    return next(line for line in axes.lines if line.get_label() == label)


# --- Figure 2 --------------------------------------------------------------------------------------


def test_figure_2_shows_measured_and_fitted_in_degrees_over_the_recordings_own_clock():
    recording = twin(400)
    panel = fitted_over_time(recording).axes[0]
    for label, y in (("measured", recording.measured), ("fitted", recording.fitted)):
        np.testing.assert_allclose(data(panel, label).get_xdata(), recording.time)
        np.testing.assert_allclose(data(panel, label).get_ydata(), np.degrees(y["theta"]))


def test_the_strip_below_shows_measured_minus_fitted():
    recording = twin(400)
    strip = fitted_over_time(recording).axes[1]
    np.testing.assert_allclose(
        data(strip, "residual (measured − fitted)").get_ydata(), np.degrees(recording.residual("theta"))
    )


def test_each_output_is_headed_by_its_fit_and_rmse():
    recording = twin()
    said = words(fitted_over_time(recording, resolution=STEPS))
    for name in recording.measured:
        rmse = recording.rmse[name]
        assert f"fit {recording.fit_percent[name]:.1f} %, RMSE {np.degrees(rmse):.3g}°" in said
        assert f"({rmse / ENCODER:.1f} encoder steps)" in said
    force = replace(recording, units=dict.fromkeys(recording.measured, "N"))
    assert "steps of the recording)" in words(fitted_over_time(force, resolution=STEPS))


@pytest.mark.few(1)
@pytest.mark.parametrize(("zero", "said"), [("hanging", "0 = hanging"), ("upright", "0 = upright")])
def test_figure_2_says_where_alpha_is_zero(zero, said):
    assert said in words(fitted_over_time(replace(twin(200), zero=zero)))


def test_a_model_without_a_zero_says_none():
    assert "0 =" not in words(fitted_over_time(replace(twin(200), zero="")))


@pytest.mark.broad
def test_only_a_validation_recording_says_that_it_was_not_fitted():
    assert "held out, predicted" in words(fitted_over_time(twin(200, use="validate")))
    assert "held out" not in words(fitted_over_time(twin(200)))


def test_a_long_recording_is_shown_close_up_where_it_is_fast():
    time = np.arange(0, 20, 1e-3)
    burst = np.exp(-(((time - 12) / 0.8) ** 2)) * np.sin(20 * time)
    (span,) = _fast_part(time, {"alpha": burst})
    assert 10.5 < time[span][0] < 12 < time[span][-1] < 13.5
    assert time[span].size < time.size / 4


def test_jitter_of_a_locked_arm_does_not_choose_the_close_up():
    time = np.arange(0, 20, 1e-3)
    jitter = 1e-3 * np.random.default_rng(1).normal(size=time.size)
    (alone,) = _fast_part(time, {"alpha": decay(time)})
    assert _fast_part(time, {"theta": jitter, "alpha": decay(time)}) == (alone,)


@pytest.mark.parametrize(
    "signal",
    [np.zeros(5000), np.full(5000, 0.1), np.sin(np.linspace(0, 12, 5000)), np.zeros(3), np.full(5000, np.nan)],
    ids=["zero", "constant", "two swings", "three samples", "unknown"],
)
def test_what_the_whole_shows_as_well_has_no_close_up(signal):
    assert _fast_part(np.arange(signal.size) * 1e-3, {"alpha": signal}) == ()


def test_a_failed_simulation_is_shown_as_missing_and_said_to_be():
    said = words(fitted_over_time(failing_from(0, twin(500))))
    assert "the simulation failed: no values" in said
    assert "no fit; the simulation has no value at 500 of 500 samples" in said
    assert "nan" not in said


def test_a_simulation_that_ends_early_says_how_much_is_missing():
    figure = fitted_over_time(failing_from(3.2, twin(500)))
    assert "no value at 300 of 500 samples" in words(figure)
    assert np.isfinite(data(figure.axes[0], "fitted").get_ydata()).sum() == 200


@pytest.mark.broad
def test_a_simulation_that_runs_away_leaves_the_measurement_visible():
    recording = twin()
    away = {n: y + 1e-3 * np.exp(recording.time - 3) for n, y in recording.fitted.items()}
    figure = fitted_over_time(replace(recording, fitted=away))
    low, high = figure.axes[0].get_ylim()
    assert high - low < 5 * np.degrees(np.ptp(recording.measured["theta"]))
    assert "fitted leaves the picture" in words(figure)


def test_a_constant_signal_has_no_fit_percent():
    time = np.arange(1000) * 1e-3
    still = RecordingFit(
        "still", "fit", time, {"alpha": np.full(1000, 0.1)}, {"alpha": 0.1 + 0.01 * np.sin(time)}, 1, {}, {}
    )
    assert "fit undefined (constant signal), RMSE" in words(fitted_over_time(still))


# --- Figure 3 --------------------------------------------------------------------------------------


def test_figure_3_has_four_panels_with_units_on_every_axis():
    figure = residual_plots(twin(), "alpha")
    assert len(figure.axes) == 4
    for axes in figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert label.endswith("]"), label


@pytest.mark.parametrize("samples", [3, 10, 1000])
def test_the_line_of_normal_quantiles_and_its_ppcc_are_those_of_scipy(samples):
    residual = np.random.default_rng(2).standard_t(4, samples)
    slope, intercept, ppcc = stats.probplot(residual)[1]
    recording = RecordingFit("t", "fit", np.arange(float(samples)), {"alpha": np.radians(residual)},
                             {"alpha": np.zeros(samples)}, 1, {}, {})  # fmt: skip
    panel = residual_plots(recording, "alpha").axes[3]
    assert panel.get_title() == f"normal probability, PPCC = {ppcc:.3f}"
    line = data(panel, "normal distribution")
    np.testing.assert_allclose(line.get_ydata(), intercept + slope * line.get_xdata(), atol=1e-12)


def test_the_histogram_and_the_normal_curve_both_hold_one():
    panel = residual_plots(twin(), "theta").axes[2]
    values, edges, _ = panel.patches[0].get_data()
    assert np.sum(values * np.diff(edges)) == pytest.approx(1)
    curve = data(panel, "normal distribution")
    assert np.trapezoid(curve.get_ydata(), curve.get_xdata()) == pytest.approx(1, abs=2e-3)


def test_a_residual_that_bends_with_the_angle_shows_in_the_mean_of_the_bins():
    recording = twin()
    bent = {"alpha": recording.fitted["alpha"] + 2 * recording.fitted["alpha"] ** 2}
    panel = residual_plots(replace(recording, measured=bent), "alpha").axes[1]
    line = data(panel, "mean of each bin")
    angle = np.radians(line.get_xdata())
    np.testing.assert_allclose(np.radians(line.get_ydata()), 2 * angle**2, atol=2e-4)


@pytest.mark.broad
def test_the_encoder_step_is_drawn_where_it_is_known():
    known = words(residual_plots(twin(), "alpha", resolution=STEPS))
    assert "± ½ encoder step of 0.0879°" in known
    for unknown in (None, {}, {"alpha": None}, {"alpha": 0.0}, {"alpha": np.nan}):
        assert "encoder" not in words(residual_plots(twin(200), "alpha", resolution=unknown))


@pytest.mark.broad
@pytest.mark.parametrize(
    ("residual", "said"),
    [
        (np.zeros(50), "all 50 residuals are 0°"),
        (np.full(50, np.radians(0.5)), "all 50 residuals are 0.5°"),
        (np.array([0.1, 0.2]), "too few different values"),
        (np.full(50, np.nan), "no residual: the simulation failed"),
        (np.append(np.zeros(40), 1e12), "mean"),
    ],
    ids=["perfect", "offset", "two", "failed", "a huge outlier"],
)
def test_degenerate_residuals_are_drawn_and_named(residual, said, tmp_path):
    fitted = np.linspace(0, 1, residual.size)
    measured = fitted + residual if said[0] != "a" else residual
    recording = RecordingFit("odd", "fit", np.arange(residual.size) * 0.01, {"alpha": measured},
                             {"alpha": measured - residual}, 1, {}, {})  # fmt: skip
    figure = residual_plots(recording, "alpha", resolution=STEPS)
    assert said in words(figure)
    save(figure, tmp_path, "odd", ("png",))


def test_residuals_of_outputs_that_take_turns_are_drawn():
    even = np.arange(400) % 2 == 0
    turns = twin(400, scored={"theta": even, "alpha": ~even})
    assert "RMSE" in words(residual_plots(turns, "alpha", resolution=STEPS))


def test_an_unknown_output_is_refused_with_those_there_are():
    with pytest.raises(InputError, match="unknown output of twin 'beta'"):
        residual_plots(twin(10), "beta")


# --- lines -----------------------------------------------------------------------------------------


@given(hnp.arrays(float, st.integers(1, 12_000), elements=st.floats(-1e3, 1e3), fill=st.floats(-1, 1)))
def test_an_outline_keeps_ends_and_extremes_in_order(y):
    shown = extremes([y], 2 * BINS)
    assert shown[0] == 0
    assert shown[-1] == y.size - 1
    assert np.all(np.diff(shown) > 0)
    assert shown.size <= max(2 * BINS + 2, y.size if y.size <= 2 * BINS else 0)
    assert (y[shown].min(), y[shown].max()) == (y.min(), y.max())


def test_an_outline_keeps_gaps_and_the_values_beside_them():
    y = np.sin(np.arange(20_000) / 100)
    y[8000:12_000] = np.nan
    shown = extremes([y], 2 * BINS)
    assert np.isnan(y[shown]).any()
    known = shown[np.isfinite(y[shown])]
    assert not np.any((known >= 8000) & (known < 12_000))
    assert known[known < 8000][-1] > 7900


# --- the cost over the orders ----------------------------------------------------------------------

LAMBDA, MU = np.linspace(0.7, 1.0, 13), np.linspace(0.8, 1.1, 11)
VALLEY = 1e-3 + (LAMBDA[:, None] - 0.86) ** 2 + 9 * (MU - 0.91) ** 2
LEAST = np.isclose(VALLEY, VALLEY.min())


def plane_of(first, second, cost, **options):
    return cost_plane(CostPlane(("lambda", "mu"), first, second, cost), **options)


def test_lambda_lies_along_x_and_mu_along_y():
    figure = plane_of(LAMBDA, MU, VALLEY, best=(0.86, 0.91))
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"order $\lambda$ [–]", r"order $\mu$ [–]")
    np.testing.assert_allclose([*axes.get_xlim(), *axes.get_ylim()], [0.7, 1.0, 0.8, 1.1])
    # The valley is narrow in μ: its lines reach farther in λ.
    lines = axes.collections[1].get_paths()
    width, height = np.ptp(lines[0].vertices, axis=0)
    assert width > 2 * height


def test_the_best_point_and_the_search_are_shown():
    tried = np.column_stack([np.linspace(0.6, 1.1, 21), np.full(21, 0.9)])
    figure = plane_of(LAMBDA, MU, VALLEY, best=(0.86, 0.91), evaluations=tried)
    said = words(figure)
    assert r"best: $\lambda$ = 0.8600, $\mu$ = 0.9100" in said
    inside = np.count_nonzero((tried[:, 0] >= 0.7) & (tried[:, 0] <= 1.0))
    assert f"evaluations ({inside} of 21 in this window; all: $\\lambda$ 0.60–1.10, $\\mu$ 0.90–0.90)" in said
    stayed = plane_of(LAMBDA, MU, VALLEY, evaluations=[[0.8, 0.9], [0.86, 0.91]])
    assert "evaluations (2)" in words(stayed)


def test_a_shallow_valley_is_told_apart_by_colour_down_to_a_hundredth_of_its_width():
    shallow = 1 + 1e-3 * ((LAMBDA[:, None] - 0.85) ** 2 + (MU - 0.95) ** 2)
    figure = plane_of(LAMBDA, MU, shallow)
    bar = figure.axes[1]
    assert bar.get_ylabel() == "cost relative to its least [–]"
    assert {"+0.001 %", "+0.0001 %"} <= {text.get_text() for text in bar.get_yticklabels()}
    levels = figure.axes[0].collections[0].levels
    assert levels[-1] - levels[0] > 1.5


def test_runs_that_nearly_diverge_do_not_take_the_colours_from_the_valley():
    costs = np.where(MU > 1.05, 1e9, VALLEY)
    said = words(plane_of(LAMBDA, MU, costs)).splitlines()
    assert {"×2", "×10", "×50"} <= set(said)


@pytest.mark.broad
def test_a_level_that_lies_on_the_plane_only_where_runs_diverge_has_no_line():
    costs = np.array([[1.0, 1.1, 1.2], [np.inf] * 3, [np.inf] * 3, [20.0, 21.0, 22.0]])
    figure = plane_of(np.linspace(0.8, 1.1, 4), np.linspace(0.8, 1.0, 3), costs)
    assert "×10" in words(figure)


def test_diverging_runs_are_hatched_and_named():
    costs = np.where(MU > 1.0, np.inf, VALLEY)
    costs[0, 0] = np.nan
    figure = plane_of(LAMBDA, MU, costs)
    assert "diverges" in words(figure)
    assert any(patch.get_hatch() for patch in figure.axes[0].patches)
    assert "diverges" not in words(plane_of(LAMBDA, MU, VALLEY))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("cost", "said"),
    [
        (np.full((13, 11), np.inf), "every simulation diverges"),
        (np.full((13, 11), 2.0), "mine.py:cost\\$_ relative to its least [–]"),
        (np.zeros((13, 11)), "mine.py:cost\\$_ "),
        (VALLEY - 1, "mine.py:cost\\$_ above the lowest "),
        (VALLEY * 1e-300, "lines of equal rise"),
        (np.where(LEAST, 1e-200, VALLEY), "lines of equal cost"),
        (np.where(LEAST, 1, np.inf), "diverges"),
    ],
    ids=["all diverge", "flat", "zero", "negative", "tiny", "bottomless", "one finite"],
)
def test_odd_planes_are_drawn(cost, said, tmp_path):
    figure = plane_of(LAMBDA, MU, cost, best=(0.5, 0.9), cost_name="mine.py:cost$_")
    assert said in words(figure).splitlines()
    save(figure, tmp_path, "odd", ("png",))


def test_a_best_point_outside_the_plane_is_still_in_the_picture():
    low, high = plane_of(LAMBDA, MU, VALLEY, best=(0.5, 0.9)).axes[0].get_xlim()
    assert (low, high) == (0.5, 1.0)


# --- writing ---------------------------------------------------------------------------------------

FIGURES = {
    "figure 2": lambda: fitted_over_time(twin(), resolution=STEPS),
    "figure 3": lambda: residual_plots(twin(), "alpha", resolution=STEPS),
    "plane": lambda: plane_of(LAMBDA, MU, VALLEY, evaluations=np.full((3000, 2), 0.9), cost_name="itae"),
}


@pytest.mark.broad
@pytest.mark.parametrize("make", FIGURES.values(), ids=FIGURES)
def test_files_are_small_and_the_same_each_time(make, tmp_path):
    first, second = save(make(), tmp_path / "a", "figure"), save(make(), tmp_path / "b", "figure")
    assert [path.name for path in first] == ["figure.svg", "figure.png"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert first[0].stat().st_size < 600_000
    assert ET.parse(first[0]).getroot().tag.endswith("svg")
    assert imread(first[1]).std() > 0.02  # not an empty sheet


@pytest.mark.broad
def test_threads_draw_the_same_files(tmp_path):
    def draw(name):
        save(fitted_over_time(twin(2000)), tmp_path / name, "figure")

    names = ["0", "1"]
    draw("alone")
    threads = [threading.Thread(target=draw, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for ending in ("svg", "png"):
        alone = (tmp_path / "alone" / f"figure.{ending}").read_bytes()
        assert all((tmp_path / name / f"figure.{ending}").read_bytes() == alone for name in names)


def test_saving_leaves_no_settings_and_no_other_files_behind(tmp_path):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    save(plane_of(LAMBDA, MU, VALLEY), tmp_path, "plane")
    assert dict(mpl.rcParams) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plane.png", "plane.svg"]


@pytest.mark.broad
def test_an_interrupted_write_leaves_the_old_file(tmp_path, monkeypatch):
    (old,) = save(plane_of(LAMBDA, MU, VALLEY), tmp_path, "plane", ("svg",))
    content = old.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(Unfinished, match="cannot be written: the disk is full"):
        save(plane_of(LAMBDA, MU, 2 * VALLEY), tmp_path, "plane", ("svg",))
    assert old.read_bytes() == content
    assert list(tmp_path.iterdir()) == [old]


def test_a_figure_that_cannot_be_drawn_writes_no_format(tmp_path):
    figure = Figure()
    figure.text(0.5, 0.5, r"$\nonsense{$")
    with pytest.raises(ValueError, match="nonsense"):
        save(figure, tmp_path / "new", "figure")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("stem", "formats", "message"),
    [
        ("figure", ("svg", "docx"), "unknown format of figures 'docx'.* known ones are .*png"),
        ("", ("svg",), "'' is no name for a file"),
        ("../figure", ("svg",), "is no name for a file"),
    ],
)
def test_bad_names_and_formats_are_refused(stem, formats, message, tmp_path):
    with pytest.raises(InputError, match=message):
        save(Figure(), tmp_path, stem, formats)


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        save(Figure(), tmp_path / "file", "figure")


@pytest.mark.broad
@pytest.mark.parametrize("name", ["$x_1", "a\nb", "50 % {x} \\alpha ^2", "Masse 振子", "long " * 60, ""])
def test_any_name_of_a_recording_can_be_drawn(name, tmp_path):
    recording = twin(50, name=name)
    recording = replace(recording, measured={"alpha": recording.measured["alpha"]})
    save(fitted_over_time(recording), tmp_path, "figure2", ("svg",))
    save(residual_plots(recording, "alpha"), tmp_path, "figure3", ("svg",))


def test_an_output_of_any_name_can_be_drawn(tmp_path):
    recording = twin(50)
    odd = {"x_$dot": recording.measured["alpha"]}
    save(fitted_over_time(replace(recording, measured=odd, fitted=odd)), tmp_path, "figure")


@pytest.mark.broad
def test_drawing_does_not_touch_pyplot():
    code = (
        "import sys, tempfile, numpy as np; from fracid.plots import appearance, save;"
        "from fracid.estimation.cost_plane import CostPlane; orders = np.arange(2.0);"
        "save(CostPlane(('lambda', 'mu'), orders, orders, np.eye(2) + 1).plot(), tempfile.mkdtemp(), 'plane');"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.broad
def test_what_draws_itself_imports_matplotlib_when_it_does():
    code = "import sys, fracid.fit, fracid.workflows.figures, fracid.report; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- a recording -----------------------------------------------------------------------------------


@pytest.mark.broad
def test_an_overview_shows_each_signal_whole_and_close_up_in_its_unit(tmp_path):
    time = np.arange(0, 10, 0.002)
    alpha = np.where(time < 2, 0.5, 0.5 * np.cos(6 * (time - 2)) * np.exp(-0.5 * (time - 2)))
    recording = Recording.of("held_$", time, {"alpha": alpha, "u": 0 * time}, units={"alpha": "rad", "u": "V"})
    figure = recording_overview(recording)
    assert [axes.get_ylabel() for axes in figure.axes] == [r"$\alpha$ as recorded [°]", "", "u [V]", ""]
    known = recording_overview(recording, zero="upright")
    assert known.axes[0].get_ylabel() == r"$\alpha$, 0 = upright [°]"
    assert "about the release at 1.99" in words(figure)
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata().max(), np.degrees(0.5))
    save(figure, tmp_path, "overview")


def test_a_long_name_at_an_axis_breaks_at_its_underscores_and_one_with_lines_of_its_own_stays(caplog):
    figure = appearance.new(4.0, 3.0)
    first, second = figure.subplots(2)
    first.set_ylabel("bias of damping_of_the_suspension_of_the_holder [s⁻¹]")
    second.set_ylabel("residual\n[°]")
    appearance.finish(figure, "long")
    assert first.get_ylabel().replace("\n", "").replace(" ", "") == "biasofdamping_of_the_suspension_of_the_holder[s⁻¹]"
    assert first.get_ylabel().count("\n") > 0
    assert second.get_ylabel() == "residual\n[°]"
    assert caplog.text == ""
