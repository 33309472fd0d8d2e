"""Models of one's own: those of the examples, and a cart with a pendulum."""

import importlib.util
import math
from functools import cache
from pathlib import Path

from fracid.models import Model, Parameter
from fracid.models.joints import sliding

EXAMPLES = Path(__file__).parents[2] / "examples"


@cache
def of_file(path):
    """A module of the examples."""
    spec = importlib.util.spec_from_file_location(f"example_{Path(path).stem}", EXAMPLES / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def cart_rhs(t, x, u, p, out):
    M, ml, J, g, b_cart, b_alpha, coulomb_cart = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    sin, cos = math.sin(x[2]), math.cos(x[2])
    force = u[0] - b_cart * x[1] - sliding(x[1], coulomb_cart, 0.0, 1.0, 0.01) + ml * sin * x[3] * x[3]
    torque = -ml * g * sin - b_alpha * x[3]
    det = M * J - ml * ml * cos * cos
    out[0], out[2] = x[1], x[3]
    out[1] = (J * force - ml * cos * torque) / det
    out[3] = (M * torque - ml * cos * force) / det


def cart_pole():
    """A cart on a rail with a pendulum that hangs."""
    values = {"M": 0.8, "ml": 0.07, "J": 0.03, "g": 9.81, "b_cart": 5.0, "b_alpha": 2e-3, "coulomb_cart": 0.4}
    return Model(
        "cart-pole", cart_rhs, ("s", "D^lambda s", "alpha", "D^mu alpha"), ("lambda", "lambda", "mu", "mu"),
        {"s": 0, "alpha": 2}, ("force",), tuple(Parameter(n, "1", v, "") for n, v in values.items()), "", "an example",
    )  # fmt: skip


def own_models():
    """Name → model."""
    titin, cell = of_file("real/titin/model.py"), of_file("real/supercapacitor/model.py")
    others = {f"{module.__name__[8:]} {n}": m for module in (titin, cell) for n, m in vars(module).items()
              if isinstance(m, Model)}  # fmt: skip
    return {
        "duffing": of_file("duffing.py").model, "dashpot": of_file("duffing.py").dashpot,
        "flexible link": of_file("flexible_link.py").model, "supercapacitor": of_file("supercapacitor.py").model,
        "cart-pole": cart_pole(), **others,
    }  # fmt: skip
