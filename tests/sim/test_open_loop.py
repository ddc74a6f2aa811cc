"""Whole executions in the simulator: done, refused, or a fault that is seen; never a false success."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sapien

from dore.errors import InputError
from dore.sim.config import preset
from dore.sim.kinematics import ArmKinematics
from dore.sim.motion.outcome import Outcome
from dore.sim.run import execution
from dore.sim.run.execution import Execution
from dore.sim.run.feedback import PrivilegedState
from dore.sim.run.open_loop import OpenLoop
from dore.sim.run.operator import Operator
from dore.sim.run.report import ExecutionReport
from dore.sim.run.setup import REPORT_NAME, VIDEO_NAME, Setup
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanFile, Status, replay
from dore.world.problem import Problem, Scene
from dore.world.reach import Reach
from tests.rendering import needs_vulkan
from tests.setups import FIG7, LAYOUT, OBJECTS, REACH, plan_of, setup

pytestmark = pytest.mark.sim


def execute(plan_file: PlanFile, setup: Setup, folder: Path) -> ExecutionReport:
    return execution.run_loop(OpenLoop(plan_file), setup, folder)


FIG7_PLAN = plan_of(Move(15, 17, 0.0, 0.0), Move(2, 11, 0.0, 0.0), Move(8, 16, 0.0, 0.0))


@pytest.fixture(scope="module")
def fig7(tmp_path_factory) -> dict[str, Any]:
    """The paper's Fig. 7 plan, carried out in state mode: its report as the file holds it."""
    folder = tmp_path_factory.mktemp("fig7")
    execute(FIG7_PLAN, setup(), folder)
    assert [file.name for file in folder.iterdir()] == [REPORT_NAME]
    return json.loads((folder / REPORT_NAME).read_text())


def test_fig7_ends_with_the_target_out_and_all_upright(fig7):
    replay(FIG7_PLAN.problem, FIG7_PLAN.plan)
    assert fig7["success"]
    assert fig7["outcome"] == "done"
    named = ("target_lifted", "target_out", "all_upright", "all_in_cell", "success")
    assert fig7["conditions"] == dict.fromkeys(named, True)


def test_fig7_report_says_what_each_move_did(fig7):
    assert [(m["pick"], m["place"]) for m in fig7["moves"]] == [(16, 18), (3, 12), (9, 17), (15, None)]
    for move in fig7["moves"]:
        assert move["outcome"] == "done"
        assert len(move["moved_mm"]) == 6
        assert 5.0 < move["grasp_margin_mm"] < 18.0
        assert move["others_moved_mm"] < 1.0
        assert move["tilt_deg"] < 2.0
        assert 2.0 < move["simulated_s"] < 30.0
    assert all(move["placement_error_mm"] < 3.0 for move in fig7["moves"][:3])
    assert fig7["pictures"] == "no film asked for"


def test_same_seed_same_execution(tmp_path):
    one, two = (execute(plan_of(scene=Scene(LAYOUT, (3,), 2)), setup(seed=5), tmp_path / n) for n in "ab")
    assert one.success
    for report in (one, two):
        report.wall_s = report.rehearsal_s = 0.0
        report.moves = [replace(move, wall_s=0.0) for move in report.moves]
    assert one == two


def test_a_corridor_through_an_object_is_refused_before_anything_moves(tmp_path):
    report = execute(plan_of(), setup(), tmp_path)
    assert report.refused
    assert not report.success
    assert report.outcome is Outcome.BLOCKED
    assert report.message.startswith("refused: target (15): approach: the ")
    assert report.message.endswith("would touch the object on cell 3")
    assert report.moves == []
    assert json.loads((tmp_path / REPORT_NAME).read_text())["outcome"] == "blocked"


def test_a_layout_out_of_reach_and_a_plan_for_another_reach_are_refused_by_name(tmp_path):
    far = Layout.grid(6, 3, 0.12, 0.50)
    plan = PlanFile(Problem(Scene(far, (), 4), Reach(far, 0.10, 30.0, 61)), Plan(Status.SOLVED, (), 0.0, "test", 0.0))
    report = execute(plan, setup(), tmp_path / "far")
    assert report.refused
    assert report.outcome is Outcome.OUT_OF_REACH
    assert re.fullmatch(r"refused: the layout: cells (\d+, )*17(, \d+)* are out of the arm's reach", report.message)
    other = Reach(LAYOUT, 0.08, 30.0, 61, staging_m=0.07, lateral_limit_m=0.42, max_yaw_deg=60.0)
    report = execute(PlanFile(Problem(FIG7, other), FIG7_PLAN.plan), setup(), tmp_path / "other")
    assert report.refused
    assert report.outcome is Outcome.OTHER_REACH
    assert "made for another reach: " in report.message
    assert report.moves == []


def test_an_unsolved_plan_is_refused_and_low_objects_are_bad_input(tmp_path):
    plan = Plan(Status.GAVE_UP, (), None, "test", 0.0, reason="node budget")
    report = execute(PlanFile(Problem(FIG7, REACH), plan), setup(), tmp_path)
    assert report.refused
    assert report.outcome is Outcome.NO_PLAN
    assert report.message == "refused: test: gave_up (node budget)"
    with pytest.raises(InputError, match=r"objects\.height_m"):
        setup(objects=replace(OBJECTS, height_m=(0.05, 0.06)))


def test_an_interrupted_execution_leaves_a_report_that_says_so(tmp_path, monkeypatch):
    run = Operator.run

    def interrupted(self, rehearsal, state, task):
        if task.name.startswith("move 2"):
            raise KeyboardInterrupt
        return run(self, rehearsal, state, task)

    monkeypatch.setattr(Operator, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        execute(FIG7_PLAN, setup(), tmp_path)
    report = json.loads((tmp_path / REPORT_NAME).read_text())
    assert report["outcome"] == "incomplete"
    assert not report["finished"]
    assert not report["success"]
    assert [move["name"] for move in report["moves"]] == ["move 1 (16 to 18)"]


def test_a_move_s_end_is_not_enough(tmp_path, monkeypatch):
    """Every motion ends well, and an object has fallen meanwhile: not done."""
    conclude = Execution.conclude

    def after_an_accident(self):
        self.world.objects[1].set_pose(sapien.Pose(p=[0.9, 0.3, 0.03], q=[0.5**0.5, 0.5**0.5, 0, 0]))
        conclude(self)

    monkeypatch.setattr(Execution, "conclude", after_an_accident)
    report = execute(plan_of(scene=Scene(LAYOUT, (3,), 2)), setup(), tmp_path)
    assert report.outcome is Outcome.INCOMPLETE
    assert "not met: all_upright" in report.message


def test_jittered_and_turned_objects_are_carried_out(tmp_path):
    one, two = (setup(jitter_m=0.01, turned=turned).placing(FIG7) for turned in (False, True))
    far = np.linalg.norm(one["offsets_m"], axis=1)
    assert (far <= 0.01).all()
    assert (far > 0).all()
    assert (one["yaws_rad"] == 0).all()
    assert len(set(two["yaws_rad"])) == 7
    assert execute(FIG7_PLAN, setup(jitter_m=0.01, turned=True), tmp_path).success


def test_the_arm_is_built_once_for_an_execution(tmp_path, monkeypatch):
    built, make = [], ArmKinematics.__init__

    def counted(self, urdf, arm):
        built.append(urdf)
        make(self, urdf, arm)

    monkeypatch.setattr(ArmKinematics, "__init__", counted)
    assert execute(plan_of(scene=Scene(LAYOUT, (3,), 2)), setup(), tmp_path).success
    assert len(built) == 1


def test_what_is_put_down_elsewhere_is_misplaced(tmp_path, monkeypatch):
    placed = PrivilegedState.placed

    def kicked(self, task):
        self._task.objects[task.body].set_pose(sapien.Pose(p=[0.68, 0.20, 0.076]))
        return placed(self, task)

    monkeypatch.setattr(PrivilegedState, "placed", kicked)
    report = execute(FIG7_PLAN, setup(), tmp_path)
    assert report.outcome is Outcome.MISPLACED
    assert len(report.moves) == 1


def test_a_fault_ends_the_loop_and_a_dropped_object_has_no_placement_error(tmp_path, monkeypatch):
    monkeypatch.setattr(PrivilegedState, "still_held", lambda self, body: Outcome.DROPPED)
    report = execute(FIG7_PLAN, setup(), tmp_path)
    assert [(move.outcome, move.placement_error_mm) for move in report.moves] == [(Outcome.DROPPED, None)]
    assert [event["event"] for event in report.events] == ["fault"]
    assert report.message == "move 1 (16 to 18): dropped"
    assert not report.refused
    assert not report.success


def test_a_turned_cuboid_is_put_down_in_the_middle_of_its_cell(tmp_path):
    """The jaws turn it by 34 degrees and shift it; the arm sees that and makes up for it."""
    plan = plan_of(Move(14, 16, 30.0, 0.0), Move(16, 15, -20.0, 30.0), scene=Scene(LAYOUT, (14,), 0))
    report = execute(plan, setup(objects=replace(OBJECTS, shapes="cuboid")), tmp_path)
    assert report.success
    assert max(move.placement_error_mm or 0.0 for move in report.moves) < 3.0


@needs_vulkan
def test_a_film_is_made_where_vulkan_is(tmp_path: Path):
    view = replace(preset("view/corner"), width_px=160, height_px=120, frames_per_s=2.0, playback_speed=4.0)
    report = execute(plan_of(scene=Scene(LAYOUT, (3,), 2)), setup(view=view, film=True), tmp_path)
    assert report.success
    assert report.video == VIDEO_NAME
    assert sorted(file.name for file in tmp_path.iterdir()) == [REPORT_NAME, VIDEO_NAME, "target.png"]
    assert (tmp_path / VIDEO_NAME).stat().st_size > 1000
