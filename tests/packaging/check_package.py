"""Build the wheel and the sdist, look into both, install them where nothing else is, and use them there.

    make package                                  # on the oldest and the newest Python that pyproject.toml names
    .venv-package/bin/python tests/packaging/check_package.py --all

What must hold, each line of it a function below:

*   The wheel holds the files below ``src/fracid``, all of them (templates, scripts, twins, ``py.typed``), and nothing
    else.  The sdist holds these, the tests, the examples and the pages, and can build the same wheel.
*   The metadata are valid, and name the versions that are checked here.
*   In an empty folder, without the sources: the program runs, makes a recording, writes its project and fits it; a
    twin that comes with the package is fitted; ``import fracid`` works under ``python -W error``.
*   A stranger's ten lines pass ``mypy --strict`` by the types of the package, and a mistake in them is found.

It needs a network or a package cache, and the interpreters; one that is missing is said, the oldest is a must.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "fracid"
DIST = ROOT / "dist"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

TYPED = '''\
"""A stranger's script: it reads a project, identifies it, and asks the result."""
import fracid


def orders(path: str, names: list[str]) -> dict[str, float]:
    fit: fracid.Fit = fracid.identify(fracid.load_project(path), seed=1)
    return {name: fit.orders[name].value for name in names}


rig: fracid.Model = fracid.rotary_pendulum("qube-servo2")
run = fracid.simulate(rig, orders={"lambda": 1.0, "mu": 0.9}, initial={"alpha": 0.2}, step=1e-3, end=1.0)
highest: float = float(run.states.max())
print(highest, run.outcome.value)
'''

MISTAKE = "import fracid\n\nrig: int = fracid.rotary_pendulum()\n"


def main() -> None:
    """Do all of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--all", action="store_true", help="every version that the classifiers name")
    everything = parser.parse_args().all
    versions = supported()
    wheel, sdist = build()
    look_into_wheel(wheel)
    look_into_sdist(sdist)
    look_at_metadata(wheel, versions)
    chosen = versions if everything else sorted({versions[0], versions[-1]}, key=number)
    for version in chosen:
        python = interpreter(version)
        if python is None:
            if version == versions[0]:
                sys.exit(f"Python {version} is the oldest that is supported, and is not here.")
            print(f"Python {version}: not on this machine, not checked")
            continue
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            use(python, wheel, Path(folder), typed=True)
            if version == versions[0]:
                use(python, sdist, Path(folder) / "sdist", typed=False)
        print(f"Python {version}: installed and used, {time.monotonic() - began:.0f} s")


def number(version: str) -> tuple[int, ...]:
    """``3.13`` as numbers, to sort by."""
    return tuple(map(int, version.split(".")))


def supported() -> list[str]:
    """The versions of the classifiers, the oldest first: it is that of requires-python."""
    prefix = "Programming Language :: Python :: 3."
    found = sorted(("3." + c.removeprefix(prefix) for c in PROJECT["classifiers"] if c.startswith(prefix)), key=number)
    assert PROJECT["requires-python"] == f">={found[0]}", (PROJECT["requires-python"], found)
    return found


def build() -> tuple[Path, Path]:
    """Make both anew; the wheel is built from the sdist, so that this holds all that is needed."""
    shutil.rmtree(DIST, ignore_errors=True)
    held = os.environ | {"PIP_CONSTRAINT": str(ROOT / "tests" / "packaging" / "requirements.txt")}
    run([sys.executable, "-m", "build", "--outdir", str(DIST), str(ROOT)], env=held)
    (wheel,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    print(
        f"built {wheel.name} ({wheel.stat().st_size / 1e6:.2f} MB), {sdist.name} ({sdist.stat().st_size / 1e6:.2f} MB)"
    )
    return wheel, sdist


def sources() -> set[str]:
    """All files of the package, from its folder on."""
    return {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")
    }


def look_into_wheel(wheel: Path) -> None:
    """It holds the package and nothing else."""
    with zipfile.ZipFile(wheel) as content:
        names = {n for n in content.namelist() if ".dist-info/" not in n}
    expected = {f"fracid/{name}" for name in sources()}
    assert names == expected, f"not in the wheel: {sorted(expected - names)}; in it too: {sorted(names - expected)}"
    kinds = {Path(n).suffix or Path(n).name for n in names} | {Path(n).name for n in names}
    needed = {"py.typed", ".j2", ".js", ".css", ".toml", ".csv", ".in", "uPlot-LICENSE.txt"}
    assert needed <= kinds, f"not in the wheel: {needed - kinds}"
    print(f"the wheel holds the {len(names)} files of the package and nothing else")


def look_into_sdist(sdist: Path) -> None:
    """It holds what is needed to build, test and read."""
    with tarfile.open(sdist) as content:
        names = {n.split("/", 1)[1] for n in content.getnames() if "/" in n}
    expected = {f"src/fracid/{name}" for name in sources()}
    expected |= {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md", "Makefile",
                 "constraints.txt"}  # fmt: skip
    for folder, kinds in (("tests", "*.py"), ("examples", "*.py"), ("docs", "*.md"), ("benchmarks", "*.py")):
        found = {
            str(path.relative_to(ROOT)) for path in (ROOT / folder).rglob(kinds) if "__pycache__" not in path.parts
        }
        expected |= {name for name in found if tracked(name)}
    assert expected <= names, f"not in the sdist: {sorted(expected - names)}"
    junk = [
        n for n in names if n.startswith(("runs/", "dist/", ".venv", ".git/")) or n.endswith((".pyc", ".nbi", ".nbc"))
    ]
    assert not junk, f"in the sdist too: {junk[:5]}"
    print(f"the sdist holds {len(names)} files: package, tests, examples, pages")


def tracked(name: str) -> bool:
    """Whether git has a file; without git all count."""
    found = subprocess.run(["git", "check-ignore", "-q", name], cwd=ROOT, capture_output=True, check=False)
    return found.returncode != 0


def look_at_metadata(wheel: Path, versions: list[str]) -> None:
    """They are valid, and complete."""
    from packaging.metadata import Metadata

    with zipfile.ZipFile(wheel) as content:
        (name,) = [n for n in content.namelist() if n.endswith(".dist-info/METADATA")]
        said = Metadata.from_email(content.read(name), validate=True)
    assert said.name == "fracid"
    assert str(said.requires_python) == f">={versions[0]}"
    assert said.license_expression == "MIT"
    assert said.license_files
    assert said.author or said.author_email
    assert said.description_content_type == "text/markdown"
    assert said.description
    assert "](http" in said.description or "](" not in said.description, "links that a package index cannot resolve"
    assert len(said.requires_dist or ()) >= len(PROJECT["dependencies"])
    print(
        f"the metadata are valid: {said.name} {said.version}, Python {said.requires_python}, {said.license_expression}"
    )


def interpreter(version: str) -> str | None:
    """A Python of that version: on the path, or from pyenv."""
    candidates = [[f"python{version}"]]
    if pyenv := shutil.which("pyenv"):
        there = subprocess.run(
            [pyenv, "versions", "--bare"], capture_output=True, text=True, check=False
        ).stdout.split()
        for name in reversed([n for n in there if n.startswith(f"{version}.")]):
            where = subprocess.run([pyenv, "prefix", name], capture_output=True, text=True, check=False).stdout.strip()
            candidates.append([f"{where}/bin/python"])
    for candidate in candidates:
        try:
            code = "import sys, venv, ensurepip; print(sys.executable, '%d.%d' % sys.version_info[:2])"
            done = subprocess.run([*candidate, "-c", code], capture_output=True, text=True, check=False)
        except OSError:
            continue
        if done.returncode == 0 and done.stdout.split()[-1] == version:
            return done.stdout.split()[0]
    return None


def use(python: str, package: Path, folder: Path, *, typed: bool) -> None:
    """Install into a venv of its own, and do there what a stranger would."""
    folder.mkdir(exist_ok=True)
    venv, empty = folder / "venv", folder / "empty"
    empty.mkdir()
    run([python, "-m", "venv", str(venv)])
    bin_ = venv / "bin"
    install = [str(bin_ / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c",
               str(ROOT / "constraints.txt")]  # fmt: skip
    run([*install, str(package), *(["mypy"] if typed else [])])
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "NUMBA", "FRACID"))}

    def program(*words: str, expected: int = 0) -> str:
        return run([str(bin_ / "fracid"), *words], cwd=empty, env=clean, expected=expected)

    said = program("--version")
    assert said.split() == ["fracid", PROJECT["version"]], said
    assert run([str(bin_ / "python"), "-m", "fracid", "--version"], cwd=empty, env=clean) == said
    where = run(
        [str(bin_ / "python"), "-W", "error", "-c", "import fracid; print(fracid.__file__)"], cwd=empty, env=clean
    )
    assert str(venv) in where, where
    twin = ["--initial", "alpha=30deg", "--hold", "1", "--noise", "0.05deg", "--step", "5ms", "--end", "8"]
    program("simulate", "srv02-rotpen", *twin, "--to", "twin.csv")
    assert json.loads(program("check", "twin.csv", "--json"))["level"] == "good"
    if not typed:
        return
    shipped = Path(where.strip()).parent / "twins" / "reference-twin.toml"
    found = json.loads(program("fit", str(shipped), "--out", "run", "--json"))
    for name, true in (("lambda", 0.8623), ("mu", 0.9146)):
        low, high = found["orders"][name]["interval95"]
        assert low <= true <= high, (name, low, high)
    assert "<html" in (empty / "run" / "report.html").read_text(encoding="utf-8")
    assert len(list((empty / "run" / "figures").iterdir())) >= 4
    program("fit", "none.toml", expected=2)
    (empty / "script.py").write_text(TYPED, encoding="utf-8")
    (empty / "mistake.py").write_text(MISTAKE, encoding="utf-8")
    run([str(bin_ / "mypy"), "--strict", "script.py"], cwd=empty, env=clean)
    wrong = run([str(bin_ / "mypy"), "--strict", "mistake.py"], cwd=empty, env=clean, expected=1)
    assert 'expression has type "Model", variable has type "int"' in wrong, wrong


def run(command: list[str], *, cwd: Path = ROOT, env: dict[str, str] | None = None, expected: int = 0) -> str:
    """Run a command and give what it says; show all of it where it ends otherwise than expected."""
    done = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if done.returncode != expected:
        sys.exit(f"{' '.join(command)}\nended with {done.returncode}, not {expected}\n{done.stdout}\n{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    main()
