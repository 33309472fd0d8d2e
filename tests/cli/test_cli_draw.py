"""``fracid draw``: the figures of a run, a comparison, a project or a rig again, in the formats of a paper."""

import json
import math
from dataclasses import replace

import pytest
from matplotlib.lines import Line2D
from matplotlib.text import Text

import fracid
from fracid.errors import InputError
from fracid.estimation.cost_profile import Profiles
from fracid.runs.folder import open_folder
from fracid.selection.comparison_records import Comparison, OrderOfRow, Row, Score
from program import fit_in, run
from twins import RIG, write_release

pytestmark = pytest.mark.usefixtures("without_rivals")

PROJECT = """
[model]
zero = "hanging"
[model.parameters]
C1 = 5e-3
[[recording]]
name = "release 20°"
file = "swing.csv"
theta = { column = "theta", unit = "rad" }
alpha = { column = "alpha", unit = "rad" }
initial = { theta = 0.0, alpha = 0.35 }
[fit]
initial_state = "held"
starts = 2
"""
OF_A_RUN = {"figure1-rig", "figure2-release-20", "figure3-release-20-theta", "figure3-release-20-alpha",
            "residuals-release-20-theta", "residuals-release-20-alpha", "cost-over-orders", "waterfall",
            "profiles", "linear-hanging", "linear-upright"}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A project with a twin of 2 s, its run with profiles, and the fit itself."""
    folder, fits = tmp_path_factory.mktemp("draw"), []
    write_release(folder / "swing.csv", RIG.with_parameters(C1=5e-3), alpha=0.35, step=5e-3, end=2.0, noise=1e-3)
    fit_in(folder, PROJECT, lambda fit: fits.append(fit) or ())
    profiles = fracid.profile(fits[0], points=4, joint=("lambda", "mu"))
    (folder / "run" / "profiles.json").write_text(json.dumps(profiles.to_json()), encoding="utf-8")
    return folder, fits[0], profiles


def content(figure):
    """All that is written and drawn in a figure, as text."""
    texts = [text.get_text() for text in figure.findobj(Text)]
    lines = [line.get_xydata().tolist() for line in figure.findobj(Line2D)]
    return repr((figure.get_size_inches().tolist(), texts, lines))


# --- what it draws -----------------------------------------------------------------------------------


@pytest.mark.broad
def test_of_a_run_it_draws_everything_for_a_journal_as_pdf(capsys, made, monkeypatch):
    folder, drawn = made[0], {}

    def kept(figure, where, stem, formats):
        drawn[stem] = 25.4 * figure.get_figwidth(), where, formats
        return (where / f"{stem}.{formats[0]}",)

    monkeypatch.setattr("fracid.plots.save", kept)
    code, out, err = run(capsys, "draw", folder / "run")
    assert (code, err) == (0, "")
    journal = folder / "run" / "figures" / "journal"
    assert set(drawn) == OF_A_RUN
    for stem, (width, where, formats) in drawn.items():
        assert f"figure   {journal / stem}.pdf" in out
        assert (where, formats) == (journal, ("pdf",))
        assert width == pytest.approx(88) or width == pytest.approx(180), stem


def test_a_new_run_takes_the_figures_of_the_old_one_away(tmp_path):
    folder = tmp_path / "run"
    (folder / "figures" / "journal").mkdir(parents=True)
    (folder / "run.json").write_text('{"kind": "fit"}')
    for name in ("figures/journal/figure2-old.pdf", "figures/cut.svg"):
        (folder / name).write_text("")
    open_folder(folder)
    assert not [path for path in (folder / "figures").rglob("*.*") if path.is_file()]


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("what", "words", "written"),
    [
        ("rig", ("--zero", "upright"), {"qube-servo2.pdf"}),
        ("rig", ("--format", "svg", "--format", "png", "--style", "screen"), {"qube-servo2.svg", "qube-servo2.png"}),
        ("project", (), {"rig.pdf"}),
    ],
)
def test_a_rig_is_drawn_by_its_name_or_with_the_constants_of_a_project(capsys, request, tmp_path, what, words, written):
    source = "qube-servo2" if what == "rig" else request.getfixturevalue("made")[0] / "rig.toml"
    capsys.readouterr()  # of the fixture
    code, _, err = run(capsys, "draw", source, *words, "--out", tmp_path)
    assert (code, err) == (0, "")
    assert {path.name for path in tmp_path.iterdir()} == written


@pytest.mark.broad
def test_of_a_comparison_it_draws_the_ladder(capsys, tmp_path):
    (tmp_path / "compare.json").write_text(json.dumps(comparison().to_json()), encoding="utf-8")
    code, _, err = run(capsys, "draw", tmp_path)
    assert (code, err) == (0, "")
    assert [path.name for path in (tmp_path / "figures" / "journal").iterdir()] == ["ladder.pdf"]


@pytest.mark.broad
def test_of_a_study_of_noise_it_draws_what_the_study_draws(capsys, made, tmp_path, monkeypatch):
    study = fracid.noise_study(made[1].problem, made[1].x, levels=[1e-3, 2e-3], seeds=2)
    (tmp_path / "noise.json").write_text(json.dumps(study.to_json()), encoding="utf-8")
    drawn = []
    monkeypatch.setattr("fracid.plots.save", lambda figure, *where: drawn.append((figure, *where)) or ())
    assert run(capsys, "draw", tmp_path) == (0, "", "")
    ((figure, where, stem, formats),) = drawn
    assert (where, stem, formats) == (tmp_path / "figures" / "journal", "noise", ("pdf",))
    assert content(figure) == content(study.plot(style="journal"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nonsense",), "'nonsense' is neither a run, nor a project, nor a rig"),
        (("qube-servo2", "--format", "docx"), "unknown --format 'docx'; the known ones are pdf, svg, png"),
        (("qube-servo2", "--style", "nature"), "unknown style 'nature'; the known ones are screen, journal"),
        (("qube-servo2", "--zero", "down"), "expected 'hanging' or 'upright'"),
        ((".",), "is no run folder"),
    ],
)
def test_mistakes_are_said_with_what_to_give(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "draw", *words)
    assert (code, out) == (2, "")
    assert said in err
    assert not [*tmp_path.iterdir()]


# --- the same from the folder as from the session ------------------------------------------------------


@pytest.mark.broad
@pytest.mark.few(1)
@pytest.mark.parametrize(
    "draw",
    [
        lambda run: run.plot(),
        lambda run: run.plot("release 20°", style="journal"),
        lambda run: run.plot_residuals(),
        lambda run: run.plot_residuals(output="theta"),
        lambda run: run.plot_residuals(tests=True),
        lambda run: run.plot_cost(points=5),
        lambda run: run.plot_rig(),
        lambda run: run.plot_starts(),
        lambda run: run.recordings["release 20°"].plot(),
    ],
    ids=["fit", "journal", "residuals", "of theta", "tests", "cost", "rig", "starts", "of a recording"],
)
def test_a_run_read_from_its_folder_draws_what_the_fit_draws(made, draw):
    folder, fit, _ = made
    one = content(draw(fit))
    assert len(one) > 1000
    assert content(draw(fracid.load_run(folder / "run"))) == one


@pytest.mark.broad
def test_a_fit_is_drawn_with_the_constants_that_it_found(made):
    model = made[1].problem.model
    found = {n: e.value for n, e in made[1].parameters.items() if n in model.parameter_names}
    assert content(made[1].plot_rig()) == content(model.with_parameters(**found).plot())


@pytest.mark.broad
def test_a_recording_that_is_not_there_is_refused_with_those_that_are(made):
    with pytest.raises(InputError, match="unknown recording 'b'; the known ones are release 20°"):
        made[1].plot("b")
    with pytest.raises(InputError, match="unknown output of release 20° 'beta'"):
        made[1].plot_residuals(output="beta")


@pytest.mark.broad
def test_profiles_come_back_from_their_file_as_they_were(made):
    _, fit, profiles = made
    again = replace(Profiles.of_json(json.loads(json.dumps(profiles.to_json()))), problem=fit.problem)
    assert again.to_json() == profiles.to_json()
    assert content(again.plot()) == content(profiles.plot())


def comparison():
    """Two rungs, of which one run fails."""
    rows = []
    for friction, error in (("viscous", 0.01), ("viscous + Coulomb", math.inf)):
        for free in (False, True):
            score = Score({"alpha": error}, {"alpha": 95.0 if error < 1 else -math.inf}, {"alpha": error}, "")
            orders = {"mu": OrderOfRow(0.95, (0.9, 1.0)) if free else OrderOfRow(1.0, None)}
            rows.append(Row(friction, free, f"{friction}, {free}", free, error, 3, error, orders, {"b_alpha": 1e-4},
                            ("b_alpha",), {"high": score}, {"low": score}, "converged"))  # fmt: skip
    return Comparison(tuple(rows), "Neither.", ("a note",), ("alpha",), math.nan, False, "rmse", 1, 2)


def test_a_comparison_comes_back_from_its_file_as_it_was():
    said = comparison().to_json()
    assert Comparison.of_json(json.loads(json.dumps(said))).to_json() == said
