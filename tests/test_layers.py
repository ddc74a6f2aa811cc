"""Who may import whom: arrows run one way (DESIGN, section 2), and the command line starts fast."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / "dore").rglob("*.py"))
WORLD = {
    f"dore.{name}"
    for name in (
        "errors paths board layout reach rules sampling splits tensor_files instances plan plan_files".split()  # noqa: SIM905
    )
}
SIMULATION = {"mani_skill", "sapien", "pin", "pinocchio", "coal", "hppfcl", "gymnasium"}


def module_of(path: Path) -> str:
    """`dore.planners.base` of dore/planners/base.py, `dore.planners` of its package file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path: Path) -> set[str]:
    """Every module that a file imports anywhere, functions and type-checking blocks included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            # `from dore import board` names a module, `from dore.board import bit` a function of one.
            found |= {f"{module}.{name.name}" for name in node.names if f"{module}.{name.name}" in MODULES} or {module}
    return found


MODULES = {module_of(path) for path in FILES}
IMPORTS = {module_of(path): imports_of(path) for path in FILES}


def inside(module: str, room: str) -> bool:
    """Whether a module is a room or lies in it."""
    return module == room or module.startswith(f"{room}.")


def offences(users: list[str], banned: list[str], but: tuple[str, ...] = ()) -> list[str]:
    """Imports of banned rooms by modules of the user rooms."""
    return sorted(
        f"{module} imports {name}"
        for module, names in IMPORTS.items()
        for name in names
        if any(inside(module, room) for room in users) and module not in but and any(inside(name, b) for b in banned)
    )


def test_the_files_are_seen() -> None:
    assert WORLD <= MODULES
    assert "dore.reach" in IMPORTS["dore.rules"]
    assert "dore.board" in IMPORTS["dore.reach"]
    assert "torch" in IMPORTS["dore.reach"]


def test_the_world_imports_only_the_world() -> None:
    known = WORLD | {"torch", "numpy", "safetensors"} | set(sys.stdlib_module_names)
    strangers = sorted(
        f"{module} imports {name}"
        for module in WORLD
        for name in IMPORTS[module]
        if not any(inside(name, room) for room in known)
    )
    assert strangers == []


def test_only_the_sim_knows_the_simulator() -> None:
    others = sorted(MODULES - {module for module in MODULES if inside(module, "dore.sim")})
    assert [one for one in offences(["dore"], sorted(SIMULATION)) if not one.startswith("dore.sim")] == []
    assert "dore.reach" in others


def test_only_the_command_line_knows_the_sim() -> None:
    assert [one for one in offences(["dore"], ["dore.sim"], but=("dore.cli",)) if not one.startswith("dore.sim")] == []


@pytest.mark.parametrize(
    ("users", "banned"),
    [
        (["dore"], ["mplib"]),
        (["dore.networks", "dore.losses"], ["dore.agents", "dore.env", "dore.training"]),
        (["dore.agents"], ["dore.env", "dore.training"]),
        (["dore.env"], ["dore.agents", "dore.networks", "dore.losses", "dore.planners"]),
        (["dore.planners"], ["dore.training", "dore.cli", "dore.sim", "dore.evaluation"]),
        (["dore.training"], ["dore.planners", "dore.evaluation", "dore.cli"]),
        (
            ["dore.evaluation", "dore.tables", "dore.render", "dore.board_art"],
            ["dore.training", "dore.agents", "dore.env"],
        ),
        (["dore.sim"], ["dore.cli", "dore.training", "dore.agents", "dore.env", "dore.planners", "dore.evaluation"]),
        ([module for module in sorted(MODULES) if module not in ("dore", "dore.cli")], ["dore.cli"]),
    ],
    ids=lambda rooms: "+".join(rooms[:3]),
)
def test_arrows_run_one_way(users: list[str], banned: list[str]) -> None:
    # Learning on one instance is what the planner of transfer learning does.
    assert offences(users, banned, but=("dore.planners.transfer",)) == []


def test_the_command_line_loads_neither_torch_nor_the_simulator() -> None:
    if "dore.cli" not in MODULES:
        pytest.skip("no command line yet")
    code = "import sys, dore.cli; print(*sorted({'torch', 'mani_skill', 'sapien', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == ""
