"""Python files that are in no package: the scripts of benchmarks/ and docs/, the examples."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

ROOT = Path(__file__).parents[2]


def module_of(path, name=None):
    """The module in a file, by its path or where it lies below the root; it may import its neighbours.

    What is compiled in it is kept under its name: where others import it as well, that has to be theirs.
    """
    path = ROOT / path
    spec = spec_from_file_location(name or f"script_{path.stem}", path)
    module = sys.modules[spec.name] = module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    return module
