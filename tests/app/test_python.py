"""`import dore`, and the examples of docs/python.md, which a reader copies as they are."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import dore
from dore.errors import InputError
from dore.world.plan import Status
from dore.world.problem import Scene
from tests.drawings import scene_of

ROOT = Path(__file__).parents[2]
EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python.md").read_text(encoding="utf-8"), re.DOTALL)
FIG_7 = ROOT / "conf" / "scenes" / "fig7.json"


def printed(example: str) -> str:
    done = subprocess.run([sys.executable, "-c", example], cwd=ROOT, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_four_functions():
    said = printed(EXAMPLES[0])
    assert said.startswith("solved [(")
    assert "planning_s" in said
    assert "batch_size=torch.Size([64, 8])" in said


@pytest.mark.parametrize(
    "example", [pytest.param(1, id="dqn_loss"), pytest.param(2, id="maskable_ppo", marks=pytest.mark.slow)]
)
def test_stock_learners_reach_95_percent(example):
    if example == 2:
        pytest.importorskip("sb3_contrib")
    before, after = (
        float(re.search(rf"{when}: ([\d.]+)", said)[1])
        for said in [printed(EXAMPLES[example])]
        for when in ("before", "after")
    )
    assert before < 0.9
    assert after >= 0.95


def test_importing_dore_imports_no_torch():
    said = printed(
        "import sys, dore; print('torch' in sys.modules, dir(dore)[-1], dore.plan.__name__, 'torch' in sys.modules)"
    )
    assert said == "False plan plan True\n"


def test_a_scene_is_a_path_its_content_or_a_scene():
    by_path = dore.plan(FIG_7)
    content = json.loads(FIG_7.read_text(encoding="utf-8"))
    assert dore.plan(content).moves == dore.plan(str(FIG_7)).moves == by_path.moves
    scene: Scene = scene_of("""
        . T .
        . o .
    """)
    assert dore.plan(scene, "exact").status is Status.SOLVED


def test_numbers_of_numpy_and_torch_are_taken():
    assert dore.make_env(num_envs=np.int64(4), max_moves=torch.tensor(3)).batch_size == torch.Size([4])
    content = json.loads(FIG_7.read_text(encoding="utf-8"))
    content["obstacles"], content["target"] = np.array(content["obstacles"]), np.int64(content["target"])
    assert dore.plan(content, max_nodes=np.int64(10_000)).moves == dore.plan(FIG_7).moves
    assert len(dore.evaluate("exact", layout="3x6", limit=np.int64(2))) == 2


def test_a_model_acts_on_the_layout_that_is_asked_for():
    env, agent = dore.make_env("5x5", num_envs=32, split="test", seed=1), dore.load_model(layout="5x5")
    after = env.rollout(12, agent.policy, break_when_any_done=False)["next"]
    assert (after["place", "reward"] > 0).any(1).double().mean() > 0.9


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: dore.plan("no.json"), "no.json: no such file"),
        (lambda: dore.plan(FIG_7, "exakt"), "Could not find 'planner/exakt' Available options"),
        (lambda: dore.plan(FIG_7, max_node=3), r"planners.exact.max_node: no such key \(did you mean max_nodes\?\)"),
        (lambda: dore.plan(FIG_7, max_nodes=-3), "planners.exact.max_nodes: got -3"),
        (lambda: dore.plan({"format": "dore-scene/1"}), "layout: not given"),
        (lambda: dore.make_env((3, 6)), r"layout: got \(3, 6\), want one of its options, by name"),
        (lambda: dore.make_env(None), "layout: got None, want one of its options"),
        (lambda: dore.plan(FIG_7, reach={"clearance_m": 0.1}), "reach: got {'clearance_m': 0.1}, want one of"),
        (lambda: dore.plan(FIG_7, ["exact"]), "planner: got .*exact"),
        (lambda: dore.plan(FIG_7, max_nodes=1j), "planners.exact.max_nodes: got 1j, want a plain value"),
        (lambda: dore.evaluate(3), "planner: got 3, want one of its options, by name"),
        (lambda: dore.evaluate([]), "planner: got .., want one of its options, by name"),
        (lambda: dore.evaluate(["exact", "exact"]), "planner: got .*, want each name once"),
        (lambda: dore.evaluate("exact", model=3), "model: got 3, want a path"),
        (lambda: dore.evaluate("exact", seed=3), "seed: no such key; want split, timing"),
        (lambda: dore.evaluate("exact", reach="${oc.env:HOME}"), "reach: got .*, want one of its options, by name"),
        (lambda: dore.make_env("3x7"), "Could not find 'layout/3x7'"),
        (lambda: dore.make_env(num_envs=0), "env.num_envs: got 0"),
        (lambda: dore.make_env(split="exam"), "split: got 'exam', want one of train, validation, test"),
        (lambda: dore.evaluate(splitt="test"), r"splitt: no such key \(did you mean split\?\)"),
        (lambda: dore.load_model("nowhere"), "nowhere: no such file"),
    ],
)
def test_what_is_wrong_is_one_line(call, says):
    with pytest.raises(InputError, match=says) as refused:
        call()
    assert "\n" not in str(refused.value)
    with pytest.raises(AttributeError, match="no attribute 'plane'"):
        dore.plane  # noqa: B018
