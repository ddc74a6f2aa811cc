"""Whatever planner conf/planner names, whatever scene it gets: a plan that replays, or an honest refusal."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omegaconf import DictConfig, OmegaConf

from dore.app.build import reach_of
from dore.configure import make
from dore.errors import InputError
from dore.learn.agents.common import agent_from_config
from dore.learn.checkpoint import save_model
from dore.planners.base import Planner
from dore.planners.exact import Exact
from dore.planners.graph_search import GraphSearch
from dore.world.board import pack
from dore.world.instances import problems_of
from dore.world.layout import Layout
from dore.world.plan import Plan, Status, replay
from dore.world.problem import Batch
from dore.world.reach import Reach
from dore.world.rules import retrievable
from tests.app.test_conf import compose, options
from tests.commands import TINY, run

PLANNERS = options("planner")
REACHES = ("wide_hand", "published", "panda_slim")
MODELS = (None, "single", "sequential")
"""The one in the package, and untrained ones, which fail more."""
SMALL = {"max_nodes": 1000, "max_episodes": 1}
"""Budgets that do not depend on the clock, so that the same scene ends the same."""
EXAMPLES, BOARDS = 25, 24
"""Per planner; six planners get 3,600 boards."""


@cache
def config_of(command: str, *overrides: str) -> DictConfig:
    return compose(command, list(overrides))


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    """A function that writes an untrained model of a layout."""
    path = tmp_path_factory.mktemp("models") / "model.safetensors"

    def write(reach: Reach, kind: str) -> str:
        cfg = config_of("train", f"agent={kind}", "network.widths=[16]")
        config: dict[str, Any] = OmegaConf.to_container(cfg, resolve=True)  # type: ignore[assignment]
        config["layout"] = {"_target_": "dore.world.layout.Layout.from_dict", "data": reach.layout.to_dict()}
        config["agent"] |= {"symmetry": reach.mirror is not None}
        config["agent"] |= {"n_slots": reach.n_cells} if kind == "single" else {}
        agent = agent_from_config(config, reach)
        kept = {name: config[name] for name in ("layout", "reach", "instances", "agent", "network")}
        save_model(path, agent.networks.state_dict(), kept)
        return str(path)

    return write


def planner_of(name: str, reach: Reach, model: str | None) -> Planner:
    """A planner from its own file, with small budgets."""
    cfg = config_of("evaluate", f"planner={name}").copy()
    cfg.model = model
    node = cfg.planners[name]
    for key in SMALL.keys() & node.keys():
        node[key] = min(node[key], SMALL[key])
    made: Planner = make(node, f"planner {name}", reach=reach)
    return made


@st.composite
def layouts(draw: st.DrawFn, front_m: float | None) -> Layout:
    """1 x 1 to 6 x 6; one in four irregular: some cells of a rectangle are missing, the others not quite in line."""
    rows, cols = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    regular = Layout.grid(rows, cols, 0.12, front_m)
    if draw(st.integers(0, 3)):
        return regular
    there = draw(st.lists(st.booleans(), min_size=rows * cols, max_size=rows * cols))
    shifts = draw(st.lists(st.floats(-0.02, 0.02), min_size=rows * cols, max_size=rows * cols))
    cells = zip(regular.cells, there, shifts, strict=True)
    moved = tuple((x + shift, y - shift) for (x, y), kept, shift in cells if kept)
    return Layout(moved or regular.cells[:1], 0.12)


@st.composite
def worlds(draw: st.DrawFn) -> tuple[Reach, Batch]:
    """A reach and `BOARDS` scenes: from none to all cells occupied."""
    cfg = config_of("evaluate", f"reach={draw(st.sampled_from(REACHES))}")
    layout = draw(layouts((cfg.get("layout") or {}).get("front_m")))
    reach = reach_of(cfg, "cpu", layout)
    generator = torch.Generator().manual_seed(draw(st.integers(0, 2**32 - 1)))
    target = torch.randint(reach.n_cells, (BOARDS,), generator=generator)
    share = torch.rand(BOARDS, 1, generator=generator)
    occupied = torch.rand(BOARDS, reach.n_cells, generator=generator) < share
    occupied[0], occupied[1] = False, True
    return reach, Batch(pack(occupied.scatter(1, target[:, None], False)), target)


def check(planner: Planner, reach: Reach, batch: Batch, plans: list[Plan]) -> None:
    """Every plan replays and says what it is; refusals are true."""
    accessible = retrievable(reach, *batch).tolist()
    refused = [row for row, plan in enumerate(plans) if plan.status is Status.UNSOLVABLE]
    for problem, plan, is_open in zip(problems_of(reach, batch), plans, accessible, strict=True):
        boards = replay(problem, plan)
        assert plan.planner == planner.name
        assert len(boards) == len(plan.moves) + 1
        if is_open:
            assert (plan.status, plan.moves) == (Status.SOLVED, ())
        if plan.status is not Status.SOLVED:
            assert plan.reason, "a refusal says why"
    # Not by the one that refused; only the smallest boards are few enough for the plain search.
    judge: Planner = Exact(reach, 1_000_000, 20.0, 256.0)
    if planner.name == judge.name:
        judge = GraphSearch(reach, 3_000, 20.0)
    for judged in judge.plan(Batch(batch.board[refused], batch.target[refused])):
        assert judged.status is not Status.SOLVED
        assert judged.status is Status.UNSOLVABLE or judge.name == "graph_search"


@pytest.mark.parametrize("name", PLANNERS)
def test_any_scene(name: str, model_file, monkeypatch) -> None:
    monkeypatch.setattr("dore.planners.transfer.NUM_ENVS", 16)
    ended: dict[Status, int] = dict.fromkeys(Status, 0)

    # The scenes are the same each time: where two Q-values are all but equal, a batch may choose otherwise than a
    # row of its own, by rounding, and that is no fault.
    @settings(max_examples=EXAMPLES, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(worlds(), st.sampled_from(MODELS))
    def throw(world: tuple[Reach, Batch], kind: str | None) -> None:
        reach, batch = world
        planner = planner_of(name, reach, kind and model_file(reach, kind))
        plans = planner.plan(batch)
        check(planner, reach, batch, plans)
        for row in range(0, BOARDS, 5):
            (alone,) = planner.plan(Batch(batch.board[row, None], batch.target[row, None]))
            assert (alone.status, len(alone.moves)) == (plans[row].status, len(plans[row].moves))
        for plan in plans:
            ended[plan.status] += 1

    throw()
    assert sum(ended.values()) >= EXAMPLES * BOARDS
    assert ended[Status.SOLVED] > EXAMPLES


BUDGETS = [
    (name, key)
    for name in PLANNERS
    for key in config_of("evaluate", f"planner={name}").planners[name]
    if key.startswith("max_")
]


@pytest.mark.parametrize("value", [0, -1])
@pytest.mark.parametrize(("name", "key"), BUDGETS)
def test_a_budget_of_zero_or_below(name: str, key: str, value: int) -> None:
    cfg = config_of("evaluate", f"planner={name}").copy()
    cfg.planners[name][key] = value
    reach = Reach(Layout.grid(2, 2, 0.12), 0.142, 15.0, 30)
    with pytest.raises(InputError, match=rf"{key}: got {value}, want [^\n]*$"):
        make(cfg.planners[name], f"planner {name}", reach=reach)


def said(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line on stderr."""
    (line,) = capsys.readouterr().err.splitlines()
    return line


def scene_file(folder, rows: int, cols: int, obstacles: list[int], target: int) -> str:
    layout = {"rows": rows, "cols": cols, "cell_m": 0.12}
    scene = {"format": "dore-scene/1", "layout": layout, "obstacles": obstacles, "target": target}
    (folder / "scene.json").write_text(json.dumps(scene))
    return f"scene={folder / 'scene.json'}"


FIG7 = (3, 6, [16, 3, 9, 7, 13, 1], 15)
FULL = (3, 3, [1, 2, 3, 4, 5, 6, 7, 9], 8)


@pytest.mark.parametrize("name", PLANNERS)
def test_a_bad_budget_is_one_line(name: str, tmp_path, capsys) -> None:
    keys = [key for planner, key in BUDGETS if planner == name]
    overrides = [f"planner={name}", f"planners.{name}.{keys[0]}=-1", "reach=wide_hand", f"out={tmp_path / 'plan.json'}"]
    assert run("plan", [*overrides, scene_file(tmp_path, *FIG7)]) == 2
    assert f"{keys[0]}: got -1" in said(capsys)
    assert not (tmp_path / "plan.json").exists()


def test_an_unknown_planner(tmp_path, capsys) -> None:
    assert run("plan", ["planner=nobody", "reach=wide_hand", scene_file(tmp_path, *FIG7)]) == 2
    assert "Could not find 'planner/nobody'" in said(capsys)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A tiny trained model of 3 x 3."""
    folder = tmp_path_factory.mktemp("model") / "run"
    assert run("train", [*TINY, "training.max_episodes=30", f"run_dir={folder}"]) == 0
    return folder


@pytest.mark.parametrize(
    "name", [name for name in PLANNERS if "model" in config_of("evaluate", f"planner={name}").planners[name]]
)
def test_a_model_of_another_layout(name: str, model, tmp_path, capsys) -> None:
    capsys.readouterr()
    overrides = [f"planner={name}", f"model={model}", f"out={tmp_path / 'plan.json'}"]
    assert run("plan", [*overrides, scene_file(tmp_path, *FIG7)]) == 2
    line = said(capsys)
    assert line.startswith("dore-plan: model: ")
    assert "'cols': 3" in line
    assert "'cols': 6" in line


def test_what_has_no_solution(tmp_path, capsys) -> None:
    out = tmp_path / "plan.json"
    assert run("plan", ["planner=exact", "reach=wide_hand", f"out={out}", scene_file(tmp_path, *FULL)]) == 3
    assert "unsolvable (all 1 boards that can be reached are exhausted) by exact" in capsys.readouterr().out
    assert json.loads(out.read_text())["status"] == "unsolvable"


def test_what_is_given_up(tmp_path, capsys) -> None:
    overrides = ["planner=exact", "planners.exact.max_nodes=1", "reach=wide_hand", f"out={tmp_path / 'plan.json'}"]
    assert run("plan", [*overrides, scene_file(tmp_path, *FIG7)]) == 4
    assert "gave_up (node budget) by exact" in capsys.readouterr().out
