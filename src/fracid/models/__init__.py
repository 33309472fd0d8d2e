"""Models of nonlinear mechanical systems and the rigs they stand for.

======================  ================================================================================
to have                 take
======================  ================================================================================
the paper's pendulum    :func:`rotary_pendulum`, with a rig of :data:`RIGS` and any constant overridden
its constants           :func:`lumped_constants`, from masses and lengths: a :class:`Geometry`
your own system         a :class:`Model`; the numbered list in :mod:`fracid.models.base` shows how
what is friction in it  :mod:`fracid.models.friction`
one of the library      :func:`model`: "cart-pole", "capacitor", one file each in :mod:`fracid.models.library`
what a file names       :func:`model_from_name`: "rotary-pendulum", or "my_rig.py:model"
======================  ================================================================================
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from fracid.errors import InputError, entry_of
from fracid.models.base import Model as Model
from fracid.models.base import Parameter as Parameter
from fracid.models.pendulum import mass_matrix as mass_matrix
from fracid.models.pendulum import rotary_pendulum as rotary_pendulum
from fracid.models.rigs import RIGS as RIGS
from fracid.models.rigs import Geometry as Geometry
from fracid.models.rigs import Rig as Rig
from fracid.models.rigs import lumped_constants as lumped_constants
from fracid.safety.user_code import attribute_of


def _collected() -> dict[str, Callable[..., Model]]:
    """What the files of this folder offer."""
    files = [import_module(f"{__name__}.{file.name}") for file in pkgutil.iter_modules(__path__)]
    return {name: build for file in files for name, build in getattr(file, "MODEL", {}).items()}


MODELS = _collected()
"""The library's models, by the name a project file gives them: a new one is a file of equations in ``library/``, or
a file here with its ``MODEL``."""


def model(name: str, **parameters: Any) -> Model:
    """Return a model of the library.

    Parameters
    ----------
    name : str
        As ``fracid models`` lists it.
    **parameters
        Values that replace the model's own [SI]; of a model with a pendulum also ``zero``, ``"hanging"`` or
        ``"upright"``, and of the rotary pendulum all that :func:`rotary_pendulum` takes.

    Raises
    ------
    InputError
        For an unknown name, an unknown parameter, or an impossible value.

    Examples
    --------
    >>> import fracid
    >>> cart = fracid.model("cart-pole", M=0.5)
    >>> cart.inputs, tuple(cart.outputs), cart.parameter("M").value
    (('force',), ('position', 'angle'), 0.5)
    """
    return entry_of('model (a user\'s own is written "my_rig.py:model")', MODELS, name)(**parameters)


def model_from_name(
    name: str, rig: str | None = None, zero: str | None = None, actuation: str | None = None, *,
    parameters: Mapping[str, float] | None = None, folder: str | Path = ".",
) -> Model:  # fmt: skip
    """Return the model that a name stands for: built in, or from a user's own file.

    Parameters
    ----------
    name
        A name in :data:`MODELS`, or ``"file.py:attribute"``, where the attribute is a
        :class:`Model` or a function that returns one.
    rig, zero, actuation
        As for :func:`rotary_pendulum`; those given are passed on as keywords to a user's function.
        A :class:`Model` takes none of them but a ``zero`` that is its own.
    parameters
        Parameters that replace the model's own [SI].
    folder
        What a relative file name starts from.

    Returns
    -------
    Model

    Raises
    ------
    InputError
        If there is no such model, file or attribute, if the file does not run, or if what it
        gives is no model.

    Examples
    --------
    >>> model_from_name("rotary-pendulum", rig="qube-servo2", parameters={"b_alpha": 1e-4}).zero
    'hanging'
    """
    options = {key: value for key, value in dict(rig=rig, zero=zero, actuation=actuation).items() if value is not None}
    values = dict(parameters or {})
    if ":" in name or name.endswith(".py"):
        own = attribute_of("model", name, Path(folder), "fracid_user_")
        return _built(own, options, name).with_parameters(**values)
    return model(name, **{**values, **options})


def _built(thing: Any, options: Mapping[str, str], name: str) -> Model:
    """Return the Model that a user's attribute is or makes."""
    others = [key for key in options if key != "zero"]
    if isinstance(thing, Model) and others:
        raise InputError(f"model {name!r} is a Model, which knows no {others[0]}: leave {others[0]} out")
    if callable(thing) and not isinstance(thing, Model):
        try:
            thing = thing(**options)
        except InputError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise InputError(f"model {name!r} cannot be called with {dict(options)}: {reason}") from error
    if not isinstance(thing, Model):
        raise InputError(f"model {name!r} is {thing!r}: expected a fracid Model or a function that returns one")
    if options.get("zero", thing.zero) != thing.zero:
        raise InputError(f"model {name!r} has zero = {thing.zero!r}, not {options['zero']!r}: write its own, or none")
    return thing
