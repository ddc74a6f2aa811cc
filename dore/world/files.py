"""Scene and plan files (JSON, ids 1..G), and named tensors with a text header (safetensors).

Reading checks everything; writing replaces the file whole.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from dore.errors import InputError, number
from dore.files import atomic_write
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanFile, Status, replay
from dore.world.problem import Problem, Scene, cell_id
from dore.world.reach import Reach

SCENE_FORMAT = "dore-scene/1"
PLAN_FORMAT = "dore-plan/1"


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """A scene file (a plan file's scene will do).

    Raises:
        InputError: no such file, no JSON, or a field that is wrong.
    """
    data = _read(path, (SCENE_FORMAT, PLAN_FORMAT))
    try:
        return _scene(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_scene(path: str | os.PathLike[str], scene: Scene) -> None:
    """Write a scene file."""
    _write(path, {"format": SCENE_FORMAT, **_scene_fields(scene)})


def read_plan(path: str | os.PathLike[str]) -> PlanFile:
    """A plan file, replayed before it is returned.

    Raises:
        InputError: no such file, no JSON, a field that is wrong, or a plan that does not replay.
    """
    data = _read(path, (PLAN_FORMAT,))
    try:
        scene = _scene(data)
        problem = Problem(scene, _reach(scene.layout, data.get("reach")))
        plan = _plan(data)
        replay(problem, plan)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return PlanFile(problem, plan)


def write_plan(path: str | os.PathLike[str], file: PlanFile) -> None:
    """Write a plan file, if its plan replays.

    Raises:
        PlanError: it does not.
    """
    replay(file.problem, file.plan)
    plan = file.plan
    fields: dict[str, Any] = {
        "format": PLAN_FORMAT,
        **_scene_fields(file.scene),
        "reach": file.reach.to_dict(),
        "status": str(plan.status),
        "moves": [
            {
                "pick": cell_id(move.pick),
                "place": cell_id(move.place),
                "pick_direction_deg": move.pick_direction_deg,
                "place_direction_deg": move.place_direction_deg,
            }
            for move in plan.moves
        ],
        "target_direction_deg": plan.target_direction_deg,
        "planner": plan.planner,
        "planning_s": round(plan.planning_s, 6),
    }
    if plan.optimal_moves is not None:
        fields["optimal_moves"] = plan.optimal_moves
    _write(path, fields)


def write_tensors(path: str | os.PathLike[str], tensors: dict[str, Tensor], header: dict[str, str]) -> None:
    """Replace the file at `path` by these tensors; `header` must name their "format"."""
    data = save({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, header)
    with atomic_write(path, "wb") as file:
        file.write(data)


def read_tensors(path: str | os.PathLike[str], wanted_format: str) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Tensors, on the CPU, and header.

    Raises:
        InputError: no such file, a damaged one, or one of another format.
    """
    try:
        with safe_open(os.fspath(path), framework="pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cut off or damaged ({str(error).splitlines()[0]})") from None
    if header.get("format") != wanted_format:
        raise InputError(f"{path}: format {header.get('format')!r}, want {wanted_format}")
    return tensors, header


def _read(path: str | os.PathLike[str], formats: tuple[str, ...]) -> dict[str, Any]:
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error})") from None
    if not isinstance(data, dict) or data.get("format") not in formats:
        got = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise InputError(f"{path}: format {got!r}, want {' or '.join(formats)}")
    return data


def _write(path: str | os.PathLike[str], fields: dict[str, Any]) -> None:
    with atomic_write(path) as file:
        json.dump(fields, file, indent=2)
        file.write("\n")


def _scene_fields(scene: Scene) -> dict[str, Any]:
    return {
        "layout": scene.layout.to_dict(),
        "obstacles": [cell_id(cell) for cell in scene.obstacles],
        "target": cell_id(scene.target),
    }


def _scene(data: dict[str, Any]) -> Scene:
    obstacles = data.get("obstacles")
    if not isinstance(obstacles, list):
        raise InputError(f"scene.obstacles: got {obstacles!r}, want a list of ids")
    return Scene(
        Layout.from_dict(data.get("layout")),
        tuple(_cell("scene.obstacles", cell) for cell in obstacles),
        _cell("scene.target", data.get("target")),
    )


def _reach(layout: Layout, data: object) -> Reach:
    if not isinstance(data, dict):
        raise InputError(f"reach: got {data!r}, want an object with clearance_m, half_fan_deg, n_sectors")
    try:
        return Reach(layout, **data)
    except TypeError as error:
        raise InputError(f"reach: {str(error).replace('Reach.__init__() ', '')}") from None


def _plan(data: dict[str, Any]) -> Plan:
    try:
        status = Status(str(data.get("status")))
    except ValueError:
        wanted = ", ".join(Status)
        raise InputError(f"plan.status: got {data.get('status')!r}, want one of {wanted}") from None
    moves = data.get("moves")
    if not isinstance(moves, list) or not all(isinstance(move, dict) for move in moves):
        raise InputError(f"plan.moves: got {moves!r}, want a list of moves")
    direction = data.get("target_direction_deg")
    optimal = data.get("optimal_moves")
    return Plan(
        status,
        tuple(
            Move(
                _cell("plan.moves.pick", move.get("pick")),
                _cell("plan.moves.place", move.get("place")),
                number("plan.moves.pick_direction_deg", move.get("pick_direction_deg")),
                number("plan.moves.place_direction_deg", move.get("place_direction_deg")),
            )
            for move in moves
        ),
        None if direction is None else number("plan.target_direction_deg", direction),
        str(data.get("planner", "unknown")),
        number("plan.planning_s", data.get("planning_s", 0.0)),
        optimal_moves=None if optimal is None else int(number("plan.optimal_moves", optimal)),
    )


def _cell(name: str, value: object) -> int:
    """The cell of an id that a file gives."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{name}: id {value!r}, want a whole number")
    return value - 1
