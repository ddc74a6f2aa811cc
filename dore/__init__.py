"""dore learns which obstacle to move, and where to, so that an arm can reach a target in clutter.

`make_env`, `plan`, `load_model` and `evaluate` are what the commands do, as functions; docs/python.md has examples.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dore.app.front_door import evaluate, load_model, make_env, plan

if find_spec("gymnasium"):
    import gymnasium

    _HERE = "dore.app.gymnasium_envs"
    gymnasium.register(
        "Dore/Rearrange-v0",
        entry_point=f"{_HERE}:Rearrange",
        vector_entry_point=f"{_HERE}:VectorRearrange",
    )

__version__ = "0.1.0"
__all__ = ["evaluate", "load_model", "make_env", "plan"]


def __getattr__(name: str) -> Any:
    """The functions are imported when they are first used: torch takes seconds."""
    if name not in __all__:
        raise AttributeError(f"module 'dore' has no attribute {name!r}")
    return getattr(import_module("dore.app.front_door"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
