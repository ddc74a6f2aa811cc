"""From a config node to the object that it names."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate

from dore.errors import InputError

MOVED = {
    "dore.agents.": "dore.learn.agents.",
    "dore.networks.": "dore.learn.networks.",
    "dore.env.": "dore.learn.env.",
    "dore.budget.": "dore.learn.budget.",
    "dore.performance.": "dore.learn.evaluator.",
    "dore.layout.": "dore.world.layout.",
    "dore.reach.": "dore.world.reach.",
    "dore.instances.": "dore.world.instances.",
}
"""Where the classes of version 0.1 are now, for the model files and run folders that name them."""


def renamed(node: Any) -> Any:
    """A config with today's names of classes."""
    if isinstance(node, Mapping):
        return {key: _renamed_class(value) if key == "_target_" else renamed(value) for key, value in node.items()}
    return node


def _renamed_class(name: Any) -> Any:
    old = next((old for old in MOVED if isinstance(name, str) and name.startswith(old)), None)
    return name if old is None else MOVED[old] + name.removeprefix(old)


def leaves(node: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a config or of nested mappings, with its whole dotted key."""
    for key, value in node.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def make(node: Any, name: str, **given: Any) -> Any:
    """Instantiate a config node.

    Raises:
        InputError: the class refused its arguments; names the node.
    """
    if node is None:
        raise InputError(f"{name}: not given, want one of its options ({name}=NAME)")
    if "_target_" not in node:
        raise InputError(f"{name}: only {', '.join(map(str, node))} given, want one of its options ({name}=NAME) too")
    try:
        if node.get("_partial_"):
            return instantiate(node, _convert_="all")
        factory = instantiate(node, _partial_=True, _convert_="all")
        inspect.signature(factory.func).bind(**factory.keywords, **given)
    except (InstantiationException, ImportError, TypeError) as error:
        # Nested nodes are built on the way, and say best themselves what is wrong with them.
        if isinstance(error.__cause__, InputError | OSError | MemoryError):
            raise error.__cause__ from None
        raise InputError(f"{name}: {' '.join(str(error).split())}") from None
    return call(factory, name, **given)


def call(factory: Callable[..., Any], name: str, *given: Any, **named: Any) -> Any:
    """Call a class that a config names.

    Raises:
        InputError: it refused its arguments; names the node, unless the class has named the field itself.
    """
    try:
        return factory(*given, **named)
    except InputError:
        raise
    except (ValueError, TypeError, ImportError) as error:
        raise InputError(f"{name}: {' '.join(str(error).split())}") from None
