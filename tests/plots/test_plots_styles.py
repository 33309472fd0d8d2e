"""Every figure comes in every style, says where angles are zero, and is the same file each time it is written."""

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from inspect import getmembers, isfunction
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axis import Tick
from matplotlib.collections import Collection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

import fracid
from fracid import plots
from fracid.errors import InputError
from fracid.estimation.cost_plane import CostPlane
from fracid.estimation.starts import Start
from fracid.experiments.plan import expected_curves
from fracid.export.state_space import integer_model
from fracid.figures import STYLES, Style
from fracid.plots import writing
from fracid.problem import Experiment, Free, Problem
from fracid.recording import Recording
from fracid.selection.amplitude import AmplitudeTest, Drift
from fracid.selection.comparison_records import Comparison, Row, Score
from fracid.validation.unknown_past import AsFitted, CutCheck, Treatment
from lettering import faults_of_lettering
from twins import COUNT, fit_of, release

TIME = np.arange(0, 12, 5e-3)
SWING = 0.3 * np.exp(-0.2 * TIME) * np.cos(6 * TIME)
NOISE = 2e-3 * np.random.default_rng(1).standard_normal(TIME.size)
ORDERS = np.linspace(0.8, 1.0, 9)
VALLEY = 1e-3 + (ORDERS[:, None] - 0.86) ** 2 + 9 * (ORDERS - 0.91) ** 2


@cache
def rig():
    return fracid.rotary_pendulum("srv02-rotpen", b_alpha=2e-4)


@cache
def twin():
    swing = {"theta": 0.2 * SWING, "alpha": SWING}
    residual = {name: COUNT * np.round((y + NOISE) / COUNT) - y for name, y in swing.items()}
    return fit_of(swing, residual, TIME, "release 92°", zero="hanging")


@cache
def problem():
    swing = release("twin", rig(), alpha=0.3, step=1e-2, end=2.0, noise=1e-3, known=False)
    return Problem(rig(), (swing,), {"lambda": 0.9, "mu": Free(0.95, 0.5, 1.2)}, initial_state="estimate")


@cache
def profiles():
    return fracid.profile(problem(), parameters=["mu", "alpha(0) [twin]"], joint=("mu", "alpha(0) [twin]"), points=4)


@cache
def study():
    held = replace(problem(), initial_state="held")
    return fracid.noise_study(held, np.array([0.95]), levels=[1e-3, 2e-3], seeds=3)


@cache
def plan():
    space = fracid.DesignSpace(release=(10, 30, 60), seconds=(1, 2), rate=100)
    return fracid.design(rig(), space, experiments=2, of=("lambda", "mu"), free=("lambda", "mu", "b_alpha"))


@cache
def posterior():
    return fracid.posterior(replace(problem(), initial_state="held"), draws=200)


@cache
def integer():
    return integer_model(Problem(rig(), (Experiment("t", 2e-3, np.zeros((5000, 2)), np.zeros((1, 1))),),
                                 {"lambda": 0.9, "mu": 1.0}))  # fmt: skip


def comparison():
    """As many rungs as a real ladder has, and a recording that is held out: two panels side by side."""
    more = ("viscous", "Coulomb", "presliding", "LuGre", "drag", "cable")
    rows = [Row(" + ".join(more[:k]), free, "", free and k == 1, 1.0, 3, 0.0, {}, {}, (), scores("release", k),
                scores("held out", k), "")
            for k in range(1, len(more) + 1)
            for free in (False, True)]  # fmt: skip
    return Comparison(tuple(rows), "", (), ("alpha",), 9.0, False, "rmse", 1, 1)


def scores(recording, rungs):
    return {recording: Score({"alpha": 0.01 / rungs}, {"alpha": 95.0}, {"alpha": 0.1})}


PAST = Treatment({"lambda": 0.95, "mu": 1.05}, 0.1, {"alpha": 0.1}, {"lambda": 0.05, "mu": 0.05}, False)
CUT = CutCheck(AsFitted({"lambda": 0.9, "mu": 1.0}, 0.1, {"alpha": 0.1}), {"lambda": None, "mu": 0.01},
               {"with the past": PAST}, {})  # fmt: skip
DRIFTS = tuple(Drift(order, "release 92°", (0.5, 0.1), (0.99, 0.95), (1e-3, 2e-3), 1e-9, 1.0, -0.04)
               for order in ("lambda", "mu"))  # fmt: skip
STARTS = [Start("given", {}, 1.0, {}, 0.1, "converged", None, 9),
          Start("Sobol 1", {}, 2.0, {}, 0.7, "converged", None, 5)]  # fmt: skip

TENTH, PLANE = np.linspace(0, 1, len(VALLEY)), CostPlane(("lambda", "mu"), ORDERS, ORDERS, VALLEY)

FIGURES = {
    "rig_drawing": lambda **o: rig().plot(**o),
    "recording_overview": lambda **o: Recording.of("twin", TIME, {"theta": 0.2 * SWING, "alpha": SWING}).plot(**o),
    "fitted_over_time": lambda **o: twin().plot(**o),
    "residual_plots": lambda **o: twin().plot_residuals("alpha", **o),
    "residual_diagnostics": lambda **o: twin().plot_residuals("alpha", tests=True, **o),
    "cost_plane": lambda **o: plots.cost_plane(PLANE, best=(0.86, 0.91), cost_name="itae", **o),
    "cost_plane_near_1": lambda **o: plots.cost_plane(
        replace(PLANE, first=0.996 + 0.01 * TENTH, second=0.9993 + 0.0018 * TENTH), best=(1.0006, 1.0001), **o
    ),
    "profiles": lambda **o: profiles().plot(**o),
    "cut_shifts": lambda **o: CUT.plot(**o),
    "ladder": lambda **o: comparison().plot(**o),
    "amplitudes": lambda **o: AmplitudeTest((), DRIFTS).plot(**o),
    "waterfall": lambda **o: plots.waterfall(STARTS, cost_name="rmse", **o),
    "noise_levels": lambda **o: study().plot(**o),
    "design_landscape": lambda **o: plan().plot(**o),
    "expected_curves": lambda **o: plots.expected_curves(expected_curves(plan()), rig(), **o),
    "posterior_corner": lambda **o: posterior().plot(**o),
    "posterior_predictive": lambda **o: posterior().plot_predictive(**o),
    "linear_response": lambda **o: plots.linear_response(integer(), "upright", **o),
}
"""Every figure, by the call that people use where there is one."""


@cache
def drawn(name, style="screen"):
    figure = FIGURES[name](style=style)
    if style != "screen":
        figure.draw_without_rendering()
    return figure


def parts(artist):
    """All that a figure is made of, but for ticks: those beyond the ends of an axis are made and not drawn."""
    for child in artist.get_children():
        if not isinstance(child, Tick):
            yield child
            yield from parts(child)


def words(figure):
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def test_all_figures_are_looked_at_here():
    elsewhere = {"control_loop"}  # tests/feedback
    assert set(FIGURES) - {"cost_plane_near_1"} == set(dict(getmembers(plots, isfunction))) - {"save"} - elsewhere


# --- a journal's columns -----------------------------------------------------------------------------


def test_a_predictive_figure_draws_the_residual_of_what_is_measured_now_and_then_from_sample_to_sample():
    drawn, swing = posterior(), posterior().problem.experiments[0]
    blank = tuple((t + 0.5 * swing.step, t + 19.5 * swing.step) for t in swing.time[::20].tolist())
    rarely = replace(swing, blanks=((), blank))
    figure = replace(drawn, problem=replace(drawn.problem, experiments=(rarely,))).plot_predictive()
    often, rare = (axes.lines[0].get_xydata() for axes in figure.axes)
    assert len(rare) == np.count_nonzero(rarely.scored[:, 1]) < len(often) / 10
    assert np.isfinite(rare).all()


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_a_journals_figure_is_as_wide_as_a_column_or_a_page_and_fits_it(name):
    width, height = 25.4 * drawn(name, "journal").get_size_inches()
    assert width == pytest.approx(88) or width == pytest.approx(180)
    assert height <= 230.0001


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_a_journals_text_is_neither_too_small_nor_too_large_and_has_no_serifs(name):
    for text in drawn(name, "journal").findobj(Text):
        if text.get_text() and text.get_visible():
            assert 6.4 < text.get_fontsize() < 11, text.get_text()
            assert text.get_fontfamily() == ["sans-serif"]


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_no_line_of_a_journals_figure_is_thinner_than_half_a_point(name):
    for part in parts(drawn(name, "journal")):
        if isinstance(part, Line2D | Patch | Collection) and part.get_visible():
            widths = np.atleast_1d(part.get_linewidth())
            assert (widths[widths > 0] >= 0.5 - 1e-9).all(), part


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_a_journals_figure_has_letters_and_no_heading(name):
    screen, journal = drawn(name), drawn(name, "journal")
    assert journal.get_suptitle() == ""
    assert "" != screen.get_suptitle() == screen.get_label()
    assert journal.get_label().startswith(screen.get_suptitle())  # for the file's metadata, and for the caption
    headed = [a for a in journal.axes if a.get_title() or a.get_title(loc="left")]
    said = " ".join(words(journal))
    for letter, _ in zip("abcdefgh", headed if len(headed) > 1 else (), strict=False):
        assert f"({letter}) " in said


QUICK = {"fitted_over_time", "cost_plane", "ladder", "waterfall", "rig_drawing", "cut_shifts", "amplitudes"}
"""Figures whose data cost nothing to make."""


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("name", "style"),
    [pytest.param(name, style, marks=[] if name in QUICK and style == "journal" else pytest.mark.broad)
     for name in FIGURES for style in STYLES],
)  # fmt: skip
def test_no_text_leaves_the_sheet_or_lies_on_another(name, style):
    assert not [*faults_of_lettering(drawn(name, style))]


@pytest.mark.broad
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n == "cost_plane" else pytest.mark.broad) for n in FIGURES]
)
def test_what_a_png_has_drawn_stays_where_it_is_in_the_next_file(name):
    figure = FIGURES[name](style="screen")
    with mpl.rc_context(writing.SETTINGS):
        writing._lay_out(figure)
        writing._rendered(figure, "png")
        before = places(figure)
        writing._hold_labels(figure)
        figure.draw_without_rendering()
        assert np.allclose(places(figure), before, atol=0.5)  # [pixels]
        assert not [*faults_of_lettering(figure)]


def places(figure):
    """Corners of every text that is not a tick's."""
    texts = [part for part in parts(figure) if isinstance(part, Text) and part.get_text() and part.get_visible()]
    return [text.get_window_extent().extents for text in texts]


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_the_legend_of_a_journals_figure_is_one_row(name):
    figure = drawn(name, "journal")
    for legend in figure.legends:
        heights = {round(text.get_window_extent().y0) for text in legend.get_texts()}
        assert max(heights) - min(heights) < 5, [text.get_text() for text in legend.get_texts()]  # [pixels]


@pytest.mark.broad
def test_a_journals_caption_has_what_its_panels_leave_out():
    figure = drawn("fitted_over_time", "journal")
    assert "RMSE 0.11" in figure.axes[0].get_title(loc="left")
    assert "encoder steps" in figure.get_label()
    assert "encoder steps" not in figure.axes[0].get_title(loc="left")


def test_a_title_longer_than_its_panel_is_broken_into_lines():
    left = replace(STARTS[0], cost=None, ended="left")
    figure = plots.waterfall([*STARTS, *[left] * 30], cost_name="rmse", style="journal")
    assert figure.axes[0].get_title() == "1 of 32 starts at the lowest cost;\n30 left for their cost"
    assert not [*faults_of_lettering(figure)]


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_lines_of_one_panel_are_told_apart_in_grey(name):
    for axes in drawn(name, "journal").axes:
        lines = [line for line in axes.lines if not line.get_label().startswith("_")]
        for one, other in combinations(lines, 2):
            if one.get_label() != other.get_label() and one.get_color() != other.get_color():
                apart = abs(grey(one) - grey(other)) > 0.12 or one.get_linewidth() > 1.5 * other.get_linewidth()
                assert apart or shape(one) != shape(other), (one.get_label(), other.get_label())


def grey(line):
    """How light a line is in print, from 0 to 1."""
    return np.dot(to_rgb(line.get_color()), (0.2126, 0.7152, 0.0722))


def shape(line):
    return line.get_linestyle(), line.get_marker(), line.is_dashed()


def test_a_style_of_ones_own_is_taken():
    narrow = drawn("waterfall", replace(STYLES["journal"], column=84))
    assert 25.4 * narrow.get_figwidth() == pytest.approx(84)
    assert 25.4 * drawn("waterfall", Style(column=100)).get_figwidth() == pytest.approx(100)


@pytest.mark.parametrize("name", ["rig_drawing", "fitted_over_time", "cost_plane", "ladder"])
def test_a_style_that_there_is_not_is_refused_with_those_there_are(name):
    with pytest.raises(InputError, match="unknown style 'nature'; the known ones are screen, journal"):
        FIGURES[name](style="nature")


def test_drawing_in_a_style_leaves_no_settings_behind():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    FIGURES["cut_shifts"](style="journal")
    assert dict(mpl.rcParams) == before


# --- zeros and units ---------------------------------------------------------------------------------


@pytest.mark.few(1)
@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_of_the_pendulums_angle_says_where_it_is_zero(name):
    for axes in drawn(name).axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            angle = label.endswith("[°]") and ("alpha" in label)
            if angle and not label.startswith(("residual", "RMSE", "bias")):  # differences have no zero to say
                assert any(word in label for word in ("hanging", "upright", "as recorded")), label


@pytest.mark.few(3)
@pytest.mark.parametrize("name", [n for n in FIGURES if n != "rig_drawing"])
def test_every_axis_has_its_unit(name):
    axes = drawn(name).axes
    labels = [label for a in axes for label in (a.get_xlabel(), a.get_ylabel()) if label]
    assert labels
    for label in labels:
        assert label.endswith("]") or "start" in label or "doubled" in label, label


# --- files -------------------------------------------------------------------------------------------

WRITE = """
import sys
import numpy as np
import fracid
from fracid.estimation.cost_plane import CostPlane
from fracid.plots import save
orders, rig = np.array([0.8, 1.0]), fracid.rotary_pendulum("srv02-rotpen")
valley = CostPlane(("lambda", "mu"), orders, orders, np.array([[1.0, 2.0], [3.0, 4.0]]))
plane = valley.plot(best=(0.8, 0.8), style="journal")
for name, figure in (("rig", rig.plot(style="journal")), ("plane", plane)):
    save(figure, sys.argv[1], name, ("pdf", "svg"))
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The same figures from two processes that count their hashes differently."""
    folders = [tmp_path_factory.mktemp(f"hash-{seed}") for seed in "12"]
    for seed, folder in zip("12", folders, strict=True):
        subprocess.run([sys.executable, "-c", WRITE, folder], check=True, env={**os.environ, "PYTHONHASHSEED": seed})
    return folders


@pytest.mark.broad
def test_two_processes_write_the_same_bytes(written):
    one, other = written
    names = sorted(path.name for path in one.iterdir())
    assert len(names) == 4
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


@pytest.mark.broad
def test_a_pdf_has_its_fonts_as_truetype_a_title_and_no_date(written):
    for path in written[0].glob("*.pdf"):
        content = path.read_bytes()
        assert b"/FontFile2" in content
        assert b"/Type3" not in content
        assert b"/Title" in content
        assert b"CreationDate" not in content
        width = float(content.split(b"/MediaBox [ 0 0 ")[1].split()[0])
        assert width / 72 * 25.4 == pytest.approx(88, abs=0.1)


@pytest.mark.broad
def test_an_svg_has_a_title_and_no_date(written):
    for path in written[0].glob("*.svg"):
        content = path.read_text(encoding="utf-8")
        assert "<dc:title>" in content
        assert "<dc:date>" not in content
        assert "$" not in content.split("<dc:title>")[1].split("</dc:title>")[0]
