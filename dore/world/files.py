"""Scene and plan files (JSON, ids 1..G). Reading checks everything; writing replaces the file whole."""

from __future__ import annotations

import os
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from dore.errors import InputError, shown
from dore.files import write_record
from dore.schema import Count, Degrees, checked, named, read_json
from dore.world.base_frame import BaseFrame, check_base_frame, in_base_frame
from dore.world.layout import MAX_CELLS, Layout
from dore.world.plan import Move, Plan, PlanFile, Status, replay
from dore.world.problem import Problem, Scene, cell_id
from dore.world.reach import Reach

SCENE_FORMAT = "dore-scene/1"
PLAN_FORMAT = "dore-plan/1"
Id = Annotated[int, Meta(ge=1, le=MAX_CELLS)]


class _ReachFields(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    clearance_m: float
    half_fan_deg: float
    n_sectors: int
    staging_m: float = 0.0
    lateral_limit_m: float | None = None
    max_yaw_deg: float | None = None


class _MoveFields(msgspec.Struct, forbid_unknown_fields=True):
    pick: Id
    place: Id
    pick_direction_deg: Degrees
    place_direction_deg: Degrees


class _SceneFields(msgspec.Struct, forbid_unknown_fields=True):
    """A scene file."""

    format: str
    layout: dict[str, Any]
    obstacles: list[Id]
    target: Id

    def scene(self) -> Scene:
        """The scene that they describe."""
        return Scene(Layout.from_dict(self.layout), tuple(cell - 1 for cell in self.obstacles), self.target - 1)


class _PlanFields(_SceneFields, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A plan file: a scene's fields, and these."""

    reach: _ReachFields
    status: Status
    moves: list[_MoveFields]
    target_direction_deg: Degrees | None
    planner: str
    planning_s: Annotated[float, Meta(ge=0)] = 0.0
    optimal_moves: Count | None = None
    lower_bound: Count | None = None
    base_frame: BaseFrame | None = None

    def plan(self) -> Plan:
        """The plan that they hold, not replayed."""
        moves = tuple(
            Move(move.pick - 1, move.place - 1, move.pick_direction_deg, move.place_direction_deg)
            for move in self.moves
        )
        return Plan(
            self.status,
            moves,
            self.target_direction_deg,
            self.planner,
            self.planning_s,
            optimal_moves=self.optimal_moves,
            lower_bound=self.lower_bound,
        )


KINDS: dict[str, type[_SceneFields]] = {SCENE_FORMAT: _SceneFields, PLAN_FORMAT: _PlanFields}


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """A scene file (a plan file's scene will do).

    Raises:
        InputError: no such file, no JSON, or a field that is wrong.
    """
    with named(path):
        return scene_of(read_json(path))


def scene_of(data: object) -> Scene:
    """The scene that the content of a scene file or a plan file describes.

    Raises:
        InputError: a field that is wrong; does not name the file.
    """
    return _fields(data, (SCENE_FORMAT, PLAN_FORMAT)).scene()


def read_plan(path: str | os.PathLike[str]) -> PlanFile:
    """A plan file, replayed before it is returned.

    Raises:
        InputError: no such file, no JSON, a field that is wrong, or a plan that does not replay.
    """
    with named(path):
        fields = _fields(read_json(path), (PLAN_FORMAT,))
        scene, plan = fields.scene(), fields.plan()
        problem = Problem(scene, Reach(scene.layout, **msgspec.structs.asdict(fields.reach)))
        replay(problem, plan)
        if fields.base_frame is not None:
            check_base_frame(fields.base_frame, problem, plan)
        return PlanFile(problem, plan)


def write_plan(path: str | os.PathLike[str], file: PlanFile) -> None:
    """Write a plan file, if its plan replays.

    Raises:
        PlanError: it does not.
    """
    replay(file.problem, file.plan)
    scene, plan = file.scene, file.plan
    fields = _PlanFields(
        PLAN_FORMAT,
        scene.layout.to_dict(),
        [cell_id(cell) for cell in scene.obstacles],
        cell_id(scene.target),
        reach=_ReachFields(**file.reach.to_dict()),
        status=plan.status,
        moves=[
            _MoveFields(cell_id(move.pick), cell_id(move.place), move.pick_direction_deg, move.place_direction_deg)
            for move in plan.moves
        ],
        target_direction_deg=plan.target_direction_deg,
        planner=plan.planner,
        planning_s=round(plan.planning_s, 6),
        optimal_moves=plan.optimal_moves,
        lower_bound=plan.lower_bound,
        base_frame=in_base_frame(file.problem, plan),
    )
    write_record(path, msgspec.to_builtins(fields))


def _fields(data: object, formats: tuple[str, ...]) -> Any:
    """The fields of a file of one of these formats, from its content."""
    found = data.get("format") if isinstance(data, dict) else type(data).__name__
    if found not in formats:
        raise InputError(f"format {shown(found)}, want {' or '.join(formats)}")
    return checked(data, KINDS[found])
