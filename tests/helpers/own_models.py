"""Models of one's own: those of the examples, and those of the library, which are equations as well."""

import importlib.util
from functools import cache
from pathlib import Path

import fracid
from fracid.models import Model
from fracid.models.library import MODEL as LIBRARY

EXAMPLES = Path(__file__).parents[2] / "examples"


@cache
def of_file(path):
    """A module of the examples."""
    spec = importlib.util.spec_from_file_location(f"example_{Path(path).stem}", EXAMPLES / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def of_library():
    """Each model of the library with all the states that it may have."""
    for name in LIBRARY:
        model = fracid.model(name)
        yield name, model.equipped([p.name for p in model.parameters])


def own_models():
    """Name → model."""
    titin, cell = of_file("real/titin/model.py"), of_file("real/supercapacitor/model.py")
    others = {f"{module.__name__[8:]} {n}": m for module in (titin, cell) for n, m in vars(module).items()
              if isinstance(m, Model)}  # fmt: skip
    return {
        "duffing": of_file("duffing.py").model, "dashpot": of_file("duffing.py").dashpot,
        "flexible link": of_file("flexible_link.py").model, "supercapacitor": of_file("supercapacitor.py").model,
        **dict(of_library()), **others,
    }  # fmt: skip
