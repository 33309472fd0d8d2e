"""Fuzzing that looks where the code goes: atheris keeps the inputs that reach new branches, and bends those further.

::

    pip install atheris                                                       (Linux; it is no dependency of fracid)
    python tests/safety/fuzz_guided.py mat -max_total_time=600                       options are libFuzzer's

It begins with the seeds of :mod:`corpus`, keeps what it finds in ``runs/fuzz/corpus-READER``, and ends at the
first input that gives anything but a recording or a line that can be printed; that one is in ``runs/fuzz/failures``.
Branches are counted in the readers, in Python; those in libhdf5, Arrow and zlib are not seen: ``tests/safety/fuzz.py``
runs those in processes that may die.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import fuzz
from corpus import SEEDS
from fuzz_inputs import READERS


def instrument(atheris: Any) -> None:
    """Count branches in the readers, and in the module of the project file alone.

    What the latter imports is compiled by Numba, and must stay as it is.
    """
    with atheris.instrument_imports(include=["fracid.recording", "tomllib"]):
        importlib.import_module("tomllib")
        importlib.import_module("fracid.recording")
    project = importlib.import_module("fracid.problem.project")
    for name, thing in list(vars(project).items()):
        if getattr(thing, "__module__", "") == project.__name__ and hasattr(thing, "__code__"):
            setattr(project, name, atheris.instrument_func(thing))


def main(reader: str, options: list[str]) -> None:
    """Run until something fails, or as the options say."""
    import atheris

    instrument(atheris)
    from fracid.errors import FracidError

    runs = fuzz.ROOT / "runs" / "fuzz"
    corpus = runs / f"corpus-{reader}"
    for folder in (corpus, runs / "failures"):
        folder.mkdir(parents=True, exist_ok=True)
    for k, seed in enumerate(SEEDS[reader]()):
        (corpus / f"seed-{k}").write_bytes(seed)
    scratch = Path(tempfile.mkdtemp(dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    (scratch / "swing.csv").write_bytes(SEEDS["text"]()[0])
    file = scratch / f"input{READERS[reader][0][0]}"

    def one(raw: bytes) -> None:
        file.write_bytes(raw)
        try:
            fuzz.read(reader, 0, file)
        except FracidError as error:
            fault = fuzz.fault_of_message(str(error))
            assert fault is None, fault

    warnings.simplefilter("error")
    limits = [f"-timeout={fuzz.SECONDS * 4:.0f}", f"-rss_limit_mb={2 * fuzz.MEMORY >> 20}", "-max_len=6000"]
    atheris.Setup([sys.argv[0], str(corpus), f"-artifact_prefix={runs}/failures/{reader}-", *limits, *options], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
