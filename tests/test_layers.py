"""Who may import whom: the packages' arrows run one way, and the command line starts fast."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / "dore").rglob("*.py"))
GROUND = {"dore", "errors", "schema", "files", "configure"}
"""What every package may import: the modules directly under dore/, `dore` itself among them."""
ALLOWED: dict[str, set[str]] = {
    "ground": set(),
    "world": set(),
    "draw": {"world"},
    "learn": {"world"},
    "planners": {"world", "learn"},
    "sim": {"world", "draw"},
    "report": {"world", "draw", "planners"},
    "app": {"world", "draw", "learn", "planners", "sim", "report"},
}
"""The packages that each package may import, the ground apart."""
ALLOWED_IN_SIM: dict[str, set[str]] = {
    "base": set(),
    "scene": {"base"},
    "motion": {"base"},
    "vision": {"base", "scene"},
    "run": {"base", "scene", "motion", "vision"},
}
"""The same between the packages of dore.sim; `base`: the modules directly under it."""
OWNERS = {
    **{key: {"sim"} for key in ("mani_skill", "sapien", "pinocchio", "pin", "coal", "hppfcl")},
    "gymnasium": {"sim", "app"},
    **{key: {"learn", "planners", "app"} for key in ("torchrl", "tensordict")},
    "matplotlib": {"draw", "report", "sim"},
    "mplib": set(),
}
"""Which packages may import a library that is slow to load or not always there."""
WITHOUT_A_NETWORK = (
    "base",
    "compiled",
    "exact",
    "graph_search",
    "straight_line",
    "policy",
    "simple",
    "relocation_graph",
)
"""Planners that load neither TorchRL nor TensorDict."""


def module_of(path: Path) -> str:
    """`dore.planners.base` of dore/planners/base.py, `dore.planners` of its package file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in FILES}


def imports_of(path: Path) -> set[str]:
    """Every module that a file imports anywhere, functions and type-checking blocks included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            # `from dore.world import board` names a module, `from dore.world.board import bit` a function of one.
            names = {f"{module}.{name.name}" for name in node.names}
            found |= (names & MODULES) | ({module} if names - MODULES else set())
    return found


IMPORTS = {module_of(path): imports_of(path) for path in FILES}


def package_of(module: str) -> str:
    """`planners` of dore.planners.base, `ground` of what lies directly under dore/.

    `import dore` and `python -m dore` are doors of app.
    """
    parts = module.split(".")
    if module in ("dore", "dore.__main__"):
        return "app"
    return "ground" if parts[1] in GROUND else parts[1]


def part_of(module: str) -> str | None:
    """`scene` of dore.sim.scene.task, `base` of dore.sim.frames; None outside dore.sim."""
    parts = module.split(".")
    if parts[:2] != ["dore", "sim"]:
        return None
    return parts[2] if len(parts) > 2 and (ROOT / "dore" / "sim" / parts[2]).is_dir() else "base"


def test_every_package_is_known_and_few_modules_lie_beside_them() -> None:
    assert {package_of(module) for module in MODULES} == set(ALLOWED)
    assert len(list((ROOT / "dore").glob("*.py"))) <= 6


@pytest.mark.parametrize("package", ALLOWED)
def test_arrows_run_one_way(package: str) -> None:
    allowed = ALLOWED[package] | {package, "ground"}
    offences = [
        f"{module} imports {name}"
        for module, names in sorted(IMPORTS.items())
        for name in sorted(names)
        if package_of(module) == package and name.split(".")[0] == "dore" and package_of(name) not in allowed
    ]
    assert offences == []


def test_every_package_of_sim_is_known() -> None:
    assert {part_of(module) for module in MODULES} == {None, *ALLOWED_IN_SIM}


@pytest.mark.parametrize("part", ALLOWED_IN_SIM)
def test_arrows_run_one_way_inside_sim(part: str) -> None:
    allowed = ALLOWED_IN_SIM[part] | {part, None}
    offences = [
        f"{module} imports {name}"
        for module, names in sorted(IMPORTS.items())
        for name in sorted(names)
        if part_of(module) == part and part_of(name) not in allowed
    ]
    assert offences == []


@pytest.mark.parametrize("library", OWNERS)
def test_a_library_stays_in_its_packages(library: str) -> None:
    users = {package_of(module) for module, names in IMPORTS.items() if any(n.split(".")[0] == library for n in names)}
    assert users <= OWNERS[library]


def test_arrows_are_seen() -> None:
    assert "dore.world.reach" in IMPORTS["dore.world.rules"]
    assert "dore.world.board" in IMPORTS["dore.world.reach"]
    assert "torch" in IMPORTS["dore.world.reach"]


def loaded_by(code: str, names: set[str]) -> str:
    """Which of the libraries a new process has loaded after some code."""
    code = f"import sys\n{code}\nprint(*sorted({names!r} & set(sys.modules)))"
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    ).stdout.strip()


def test_the_command_line_loads_neither_torch_nor_the_simulator() -> None:
    assert loaded_by("import dore.app.cli", {"torch", "mani_skill", "sapien", "matplotlib"}) == ""


@pytest.mark.parametrize("planner", WITHOUT_A_NETWORK)
def test_a_planner_without_a_network_loads_no_torchrl(planner: str) -> None:
    assert loaded_by(f"import dore.planners.{planner}", {"torchrl", "tensordict", "matplotlib"}) == ""


def test_dore_plan_with_exact_loads_no_torch(tmp_path: Path) -> None:
    code = f"""
from dore.app import cli
sys.argv = ["dore-plan", "scene=fig7", "planner=exact", "out={tmp_path}/plan.json"]
try:
    cli.plan()
except SystemExit as end:
    assert end.code == 0
"""
    said = loaded_by(code, {"torch", "torchrl", "tensordict", "pandas"})
    assert said.splitlines()[-1].endswith("plan.png")
