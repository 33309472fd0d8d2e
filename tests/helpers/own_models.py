"""Models of one's own: those of the examples, and those of the library, which are equations as well."""

from functools import cache

import fracid
from fracid.models import Model
from fracid.models.library import MODEL as LIBRARY
from scripts import module_of


@cache
def of_file(path):
    """A module of the examples."""
    return module_of(f"examples/{path}")


def of_library():
    """Each model of the library with all the states that it may have."""
    for name in LIBRARY:
        model = fracid.model(name)
        yield name, model.equipped([p.name for p in model.parameters])


def own_models():
    """Name → model."""
    titin, cell = of_file("real/titin/model.py"), of_file("real/supercapacitor/model.py")
    others = {f"{module.__name__[7:]} {n}": m for module in (titin, cell) for n, m in vars(module).items()
              if isinstance(m, Model)}  # fmt: skip
    return {
        "duffing": of_file("duffing.py").model, "dashpot": of_file("duffing.py").dashpot,
        "flexible link": of_file("flexible_link.py").model, "supercapacitor": of_file("supercapacitor.py").model,
        **dict(of_library()), **others,
    }  # fmt: skip
