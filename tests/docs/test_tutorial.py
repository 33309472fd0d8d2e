"""The tutorial's commands are run as they stand on its page, and print what stands below them."""

import json
import math
import re
import shlex
from pathlib import Path

import pytest

from program import run

PAGE = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
TRUTH = {
    "lambda": 0.93,
    "mu": 0.96,
    "b_alpha": 5e-4,
    "C1": 0.004290672,
    "coulomb_theta": 0.042,
    "coulomb_alpha": 2.5e-4,
}


def steps():
    """The page's blocks in order, [(console or toml or text, content), …], without the installation and its end."""
    body = PAGE.split("## 1. A recording")[1].split("## Your own recording")[0]
    return re.findall(r"```(\w+)\n(.*?)```", body, re.DOTALL)


def edited(project, block):
    """The project with a block of the page: a recording before [fit], a line in place of its own or after from."""
    if block.startswith("[[recording]]"):
        return project.replace("\n[fit]", f"\n{block}\n[fit]")
    key = block.split(" = ")[0]
    line = block.strip()
    replaced = re.sub(rf"^{key} = .*$", line, project, flags=re.MULTILINE)
    return replaced if replaced != project else re.sub(r"^from = .*$", rf"\g<0>\n{line}", project, flags=re.MULTILINE)


def same(shown, printed, part=0.05):
    """Whether a line is the one that the page shows: the same words, and numbers within that part of its largest."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    numbers = [[float(n.replace(",", "")) for n in NUMBER.findall(line)] for line in (shown, printed)]
    largest = max(map(abs, numbers[0]), default=0.0)
    return all(math.isclose(a, b, abs_tol=part * largest) for a, b in zip(*numbers, strict=True))


def not_printed(block, output, part=0.05):
    """The lines of a block that the program did not print in this order; one that ends with … is a beginning."""
    lines, missing = iter(output.splitlines()), []
    for shown in block.splitlines():
        if shown == "…":
            continue
        start = shown.removesuffix("…")
        if not any(same(start, line[: len(start)] if start != shown else line, part) for line in lines):
            missing.append(shown)
            lines = iter(())
    return missing


@pytest.mark.slow
def test_the_tutorial_runs_and_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    project, output = tmp_path / "release.toml", ""
    for kind, block in steps():
        if kind == "toml":
            before = project.read_text(encoding="utf-8")
            project.write_text(edited(before, block), encoding="utf-8")
            assert project.read_text(encoding="utf-8") != before
        elif kind == "text":
            assert not_printed(block, output) == []
        for line in block.replace("\\\n", "").splitlines() if kind == "console" else ():
            code, output, said = run(capsys, *shlex.split(line.removeprefix("$ fracid ")))
            assert code == 0, (line, said)
    result = json.loads((tmp_path / "runs" / "release" / "result.json").read_text(encoding="utf-8"))
    found = {name: (result["orders"] | result["parameters"])[name]["interval95"] for name in TRUTH}
    assert [name for name, (low, high) in found.items() if not low <= TRUTH[name] <= high] == []


def test_every_command_of_the_tutorial_is_one_that_the_program_has():
    from fracid.cli import app

    names = {command.callback.__name__ for command in app.registered_commands}
    typed = re.findall(r"^(?:\$ )?fracid +(\w+)", PAGE, re.MULTILINE)
    assert len(typed) > 10
    assert set(typed) <= names


def test_a_line_that_the_page_shows_is_found_or_missed():
    printed = "mu     0.96002   ± 0.0007\nrest   3.5e-05   ± 0.00091   rad"
    assert not_printed("…\nmu 0.9601 ± 0.0007\nrest 3.9e-05 ± 0.00091 rad", printed) == []
    assert not_printed("mu 0.9601 ± 0.0007 s", printed) == ["mu 0.9601 ± 0.0007 s"]
    assert not_printed("mu 1.06 ± 0.0007", printed) == ["mu 1.06 ± 0.0007"]
    assert not_printed("rest 3.5e-05 ± 0.00091 rad\nmu 0.96002 ± 0.0007", printed) == ["mu 0.96002 ± 0.0007"]
    assert not_printed("mu 0.96002 …", printed) == []
