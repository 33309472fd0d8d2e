"""Python files that are in no package: the scripts of benchmarks/ and docs/, the examples."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

ROOT = Path(__file__).parents[2]


def module_of(path):
    """The module in a file, by its path or where it lies below the root; it may import its neighbours."""
    path = ROOT / path
    spec = spec_from_file_location(f"script_{path.stem}", path)
    module = sys.modules[spec.name] = module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    return module
