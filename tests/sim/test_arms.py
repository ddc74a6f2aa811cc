"""Every arm of conf/arm, by its config alone: its reach, what it follows, and a plan that it carries out."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch

from dore.errors import InputError
from dore.files import conf_dir
from dore.sim.config import ArmConfig, ObjectConfig, preset
from dore.sim.kinematics import LARGEST_STEP_RAD, ArmKinematics
from dore.sim.motion.arm_reach import arm_reach, cells_out_of_reach, corridor_differences, follow_corridor
from dore.sim.run.execution import run_loop
from dore.sim.run.open_loop import OpenLoop
from dore.sim.run.setup import Setup
from dore.sim.scene.jaco import jaco
from dore.sim.urdf import arm_files
from dore.world.layout import Layout
from dore.world.plan import Move, Plan, PlanFile, Status, replay
from dore.world.problem import Problem, Scene
from scripts.measure_reach import Surveyor
from tests.app.test_conf import compose
from tests.jaco_urdf import jaco_urdf

pytestmark = pytest.mark.sim


@dataclass(frozen=True)
class Place:
    """An arm with the objects and the layout that it is for."""

    arm: ArmConfig
    objects: ObjectConfig
    layout: Layout


@pytest.fixture(scope="module")
def urdf(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("kinova") / "j2n6s300.urdf"
    path.write_text(jaco_urdf())
    return str(path)


KINOVA = pytest.param(
    "jaco", marks=pytest.mark.skipif(not importlib.util.find_spec("dm_control"), reason="no extra [jaco]: no meshes")
)


@pytest.fixture(scope="module")
def places() -> dict[str, Place]:
    mixed, cans = preset("objects/mixed"), preset("objects/cans")
    return {
        "panda_slim": Place(preset("arm/panda_slim"), mixed, Layout.grid(3, 6, 0.12, 0.50)),
        "panda": Place(preset("arm/panda"), mixed, Layout.grid(3, 4, 0.16, 0.40)),
        "jaco": Place(preset("arm/jaco"), cans, Layout.grid(3, 6, 0.12, 0.45)),
    }


ARMS = sorted(path.stem for path in (Path(conf_dir()) / "arm").glob("*.yaml"))
ARMS = [KINOVA if name == "jaco" else name for name in ARMS]


@pytest.fixture(params=ARMS)
def place(request, places) -> Place:
    return places[request.param]


def test_the_presets_hold_the_arms_numbers(place):
    written = compose("plan", [f"reach={place.arm.name}"])
    numbers = {key: value for key, value in written.reach.items() if key != "_target_"}
    assert numbers == arm_reach(place.arm, place.objects, place.layout).to_dict()
    assert dict(written.layout).items() <= place.layout.to_dict().items()


def test_a_sample_of_allowed_corridors_is_followed_and_touches_nothing(place):
    surveyor = Surveyor(place.arm, place.objects, place.layout)
    allowed = surveyor.reach.allowed_sectors.nonzero().tolist()
    sample = [[cell, sector] for cell, sector in allowed if sector % 15 == cell % 5]
    found = surveyor.survey(sample)
    assert found.corridors.why_not.tolist() == [""] * len(sample)
    assert found.faults.empty


def test_all_cells_are_within_reach_and_another_arms_plan_is_not(place, places):
    kinematics = ArmKinematics(arm_files(visuals=False, arm=place.arm), place.arm)
    reach = arm_reach(place.arm, place.objects, place.layout, kinematics)
    assert cells_out_of_reach(place.layout, reach, kinematics) == ()
    slim = arm_reach(places["panda_slim"].arm, places["panda_slim"].objects, place.layout)
    assert (corridor_differences(slim, reach) is None) == (place.arm.name == "panda_slim")


def test_the_joints_change_little_along_a_corridor(place):
    kinematics = ArmKinematics(arm_files(visuals=False, arm=place.arm), place.arm)
    ready = kinematics.ready(place.layout.front_m - place.arm.staging_m)
    for cell in (0, place.layout.n_cells - 1):
        along, into, out = follow_corridor(kinematics, ready, place.layout.cells[cell], 0.0)
        path = np.vstack([along, into, out])
        assert np.abs(np.diff(path, axis=0)).max() < LARGEST_STEP_RAD
        assert np.abs(path[-1] - path[0]).max() < 0.4  # back where it began, but for the height: no turn is left over


PLANS = {
    "panda": (Scene(Layout.grid(3, 4, 0.16, 0.40), (1, 5), 9), (Move(1, 3, 0.0, 0.0), Move(5, 4, 0.0, 0.0))),
    "jaco": (Scene(Layout.grid(3, 6, 0.12, 0.45), (2, 8), 14), (Move(2, 5, 0.0, 0.0), Move(8, 6, 0.0, 0.0))),
}


@pytest.mark.parametrize("name", sorted(PLANS))
def test_a_short_plan_is_carried_out(name, places, tmp_path):
    (scene, moves), place = PLANS[name], places[name]
    reach, plan = arm_reach(place.arm, place.objects, scene.layout), Plan(Status.SOLVED, moves, 0.0, "test", 0.0)
    replay(Problem(scene, reach), plan)
    setup = Setup(place.arm, place.objects, preset("view/corner"), preset("camera/kinect"), seed=0, film=False)
    report = run_loop(OpenLoop(PlanFile(Problem(scene, reach), plan)), setup, tmp_path)
    assert report.success, report.message
    for move in report.moves:
        assert move.others_moved_mm < 1.0
        assert move.tilt_deg < 8.0  # a can hangs a little askew between three fingers
        assert (move.placement_error_mm or 0.0) < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PLANS))
def test_allowed_corridors_are_exactly_those_that_the_arm_follows_and_touch_nothing(name, places):
    place = places[name]
    surveyor = Surveyor(place.arm, place.objects, place.layout)
    every = torch.cartesian_prod(*map(torch.arange, surveyor.reach.allowed_sectors.shape)).tolist()
    found = surveyor.survey(every)
    assert found.corridors.followed.equals(found.corridors.allowed)
    assert found.faults.empty


def test_the_gripper_opens_at_1_and_closes_at_minus_1(place):
    env = gym.make(
        "DoreTabletop-v1", arm=place.arm, layout=place.layout, bodies=place.objects.draw(1, np.random.default_rng(0)),
        obs_mode="none", control_mode="pd_joint_pos", render_backend="none",
    )  # fmt: skip
    env.reset(options={"cells": [0]})
    agent = env.unwrapped.agent
    assert agent.uid == place.arm.name
    for command, opening in ((-1.0, 0.0), (1.0, 1.0)):
        for _ in range(30):
            env.step(torch.cat([agent.arm_joints()[0], torch.tensor([command])]))
        assert float(agent.opening()[0]) == pytest.approx(opening, abs=0.05)
    env.close()


def test_only_an_arm_whose_description_is_there_is_made(urdf, tmp_path, monkeypatch):
    other, torn, list_of = (tmp_path / name for name in ("other.urdf", "torn.urdf", "list.urdf"))
    other.write_text(arm_files(visuals=False).read_text())
    torn.write_text(jaco_urdf()[:500])
    list_of.write_text("<robots/>")
    wrong = {
        str(tmp_path / "none.urdf"): "No such file",
        str(tmp_path): "Is a directory",
        str(torn): "no XML",
        str(list_of): "begins with <robots>",
        str(other): "no joint or link j2n6s300_joint_1, j2n6s300_joint_2 and",
        "": "want a path",
    }
    for path, words in wrong.items():
        with pytest.raises(InputError, match=words) as caught:
            arm_files(visuals=False, arm=preset("arm/jaco", urdf=path))
        message = str(caught.value)
        assert message.startswith("arm.urdf: ")
        assert "\n" not in message
        assert path in message
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"^arm=jaco: .* pip install '\.\[jaco\]'; .*"):
        arm_files(visuals=False, arm=preset("arm/jaco"))
    with pytest.raises(InputError, match=r"arm\.urdf: .* want null"):
        arm_files(visuals=False, arm=replace(preset("arm/panda"), urdf=urdf))


def test_kinovas_meshes_are_found_and_its_endless_joints_bounded(tmp_path):
    """As ROS lays them out: the URDF and the meshes in one package."""
    package = tmp_path / "kinova_description"
    (package / "urdf").mkdir(parents=True)
    text = jaco_urdf().replace(
        '<cylinder radius="0.045" length="0.157"/>',
        '<mesh filename="package://kinova_description/meshes/base.dae"/>',
    )
    path = package / "urdf" / "j2n6s300.urdf"
    path.write_text(text.replace("</robot>", '<gazebo/><transmission name="t"/></robot>'))
    with pytest.raises(InputError, match=r"no mesh package://kinova_description/meshes/base\.dae"):
        jaco().describe(str(path))
    (package / "meshes").mkdir()
    (package / "meshes" / "base.dae").write_text("")
    urdf = jaco().describe(str(path)).urdf
    assert f'filename="{package.resolve().as_posix()}/meshes/base.dae"' in urdf
    assert "gazebo" not in urdf
    assert "transmission" not in urdf
    assert "continuous" not in urdf
