"""From a config node to the object that it names, and which objects a file may name."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig, ListConfig, OmegaConf

from dore.errors import InputError, shown

MOVED = {
    "dore.agents.": "dore.learn.agents.",
    "dore.networks.": "dore.learn.networks.",
    "dore.env.": "dore.learn.env.",
    "dore.budget.": "dore.learn.budget.",
    "dore.performance.": "dore.learn.evaluator.",
    "dore.layout.": "dore.world.layout.",
    "dore.reach.": "dore.world.reach.",
    "dore.instances.": "dore.world.instances.",
    "torchrl.record.loggers.TensorboardLogger": "dore.learn.loggers.TensorBoard",
}
"""Where the classes of version 0.1 are now, for the model files and run folders that name them."""

OWN = ("dore.learn", "dore.planners", "dore.sim", "dore.world")
TORCH = (
    *("torch.nn.modules", "torch.optim"),
    *("torchrl.data.replay_buffers", "torchrl.objectives", "torchrl.record.loggers"),
)
"""Where the classes live that a model file or a run folder may name: this package's, torch's layers, and the parts of
TorchRL that the configs use. Nothing else of what such a file says is ever imported or called."""

_users: set[str] = set()


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
    if not isinstance(node, Mapping):
        raise InputError(f"{name}: got {shown(node)}, want one of its options ({name}=NAME)")
    if "_target_" not in node:
        raise InputError(f"{name}: only {', '.join(map(str, node))} given, want one of its options ({name}=NAME) too")
    try:
        if node.get("_partial_"):
            return instantiate(node, _convert_="all")
        factory = instantiate(node, _partial_=True, _convert_="all")
        inspect.signature(factory.func).bind(**factory.keywords, **given)
    except (InstantiationException, ImportError, TypeError) as error:
        if isinstance(error, InstantiationException) and isinstance(error.__cause__, ImportError):
            raise _not_found(name, str(error), error.__cause__) from None
        # Nested nodes are built on the way, and say best themselves what is wrong with them.
        if isinstance(error.__cause__, InputError | OSError | MemoryError):
            raise error.__cause__ from None
        raise _refusal(name, error) from None
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
        raise _refusal(name, error) from None


def _refusal(name: str, error: Exception) -> InputError:
    """An error of a constructor in one line, without the constructor's own name."""
    text = re.sub(r"\b[\w.]*\.__init__\(\) ", "", " ".join(str(error).split()))
    return InputError(f"{name}: {text}")


def _not_found(name: str, text: str, cause: ImportError) -> InputError:
    """A class that cannot be imported, in one line: what, why, and where it was looked for."""
    target, key = re.search(r"target '([^']*)'", text), re.search(r"full_key: (\S+)", text)
    why = str(cause.__cause__ or cause).splitlines()[0]
    why = re.sub(r"No module named '([\w.]+)\.(\w+)'; .*", r"\1 has no \2", why)
    wanted = "want a class of a module that is installed, in the current folder, or on PYTHONPATH"
    return InputError(f"{key[1] if key else name}._target_: {target[1] if target else text}: {why}; {wanted}")


def trust(*modules: str) -> None:
    """Let files name the classes of these modules too, and of what lies inside them; `trust=[mine]` on a command line.

    Raises:
        InputError: no name of a module.
    """
    for module in modules:
        if not isinstance(module, str) or not all(part.isidentifier() for part in module.split(".")):
            raise InputError(f"trust: got {shown(module)}, want names of modules")
    _users.update(modules)


def trust_command_line(cfg: DictConfig) -> None:
    """Let files name what the user's own command line names: the modules in its key `trust`, and its own classes.

    Raises:
        InputError: `trust` is no list of modules.
    """
    modules = cfg.get("trust", ListConfig([]))
    if not isinstance(modules, ListConfig):
        raise InputError(f"trust: got {shown(modules)}, want a list of modules, as trust=[mine]")
    trust(*modules)
    _users.update(name for name in _targets(OmegaConf.to_container(cfg)) if isinstance(name, str))


def check_classes(config: Any) -> None:
    """Go through a config that a file gave, before any of it is built.

    Raises:
        InputError: it names something else than a class that files may name; that is neither imported nor called.
    """
    for name in _targets(config):
        if not isinstance(name, str) or not _allowed(name):
            raise InputError(
                f"_target_: the file names {shown(name)}, want a class of dore or torch; "
                "if you wrote it yourself: trust=[its module]"
            )


def _targets(node: Any) -> Iterator[Any]:
    """The value of every `_target_` in a config."""
    if isinstance(node, Mapping):
        for key, value in node.items():
            if key == "_target_":
                yield value
            else:
                yield from _targets(value)
    elif isinstance(node, list | tuple):
        for value in node:
            yield from _targets(value)


def _allowed(name: str) -> bool:
    if _within(name, tuple(_users)):
        return True
    if not _within(name, (*OWN, "torch.nn", "torch.optim", "torchrl.data", "torchrl.objectives", "torchrl.record")):
        return False
    found = _found(name)
    if inspect.ismethod(found):  # A constructor of its own, as Layout.grid.
        found = found.__self__
    if inspect.isfunction(found):  # That which describes an arm, as dore.sim.scene.panda.panda.
        return found.__module__.startswith("dore.sim.scene.") and found.__annotations__.get("return") == "ArmModel"
    return inspect.isclass(found) and _within(found.__module__, (*OWN, *TORCH))


def _within(name: str, modules: tuple[str, ...]) -> bool:
    return any(name == module or name.startswith(f"{module}.") for module in modules)


def _found(name: str) -> Any:
    """What a dotted name stands for; None: nothing."""
    parts = name.split(".")
    for length in range(len(parts) - 1, 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:length]))
        except ImportError:
            continue
        for part in parts[length:]:
            found = getattr(found, part, None)
        return found
    return None
