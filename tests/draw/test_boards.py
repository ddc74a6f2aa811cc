"""Pictures are written whole, of every kind of plan and layout; what they look like, only eyes can tell."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from dore.draw.board_art import CELL_INCH, OBSTACLE_COLOUR
from dore.draw.boards import Panel, draw_plan, panel_pixels, panels_of
from dore.draw.curves import draw_learning_curve
from dore.draw.style import DPI
from dore.errors import InputError
from dore.planners.base import RawPlan, checked_plans
from dore.world.layout import Layout
from dore.world.plan import Move, PlanError, Status
from dore.world.problem import Batch, Problem, Scene
from dore.world.reach import Reach
from tests.drawings import scene_of

DRAWING = """
    . . T .
    . o o .
    . . . .
"""


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of a PNG, pixels."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert data[-8:-4] == b"IEND"
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def draw(path: Path, scene: Scene, moves: list[tuple[int, int]], status: Status) -> tuple[int, int]:
    reach = Reach(scene.layout, clearance_m=0.1, half_fan_deg=15.0, n_sectors=30)
    start = Batch.of(Problem(scene, reach))
    (plan,) = checked_plans(reach, start, [RawPlan(moves, status, 0.0)], "test")
    draw_plan(Problem(scene, reach), plan, path)
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    return size_of(path)


def test_one_panel_a_move_and_one_for_the_retrieval(tmp_path: Path) -> None:
    path = tmp_path / "plan.png"
    scene = scene_of(DRAWING)
    near, behind = scene.obstacles[1], scene.obstacles[0]
    widths = [
        draw(path, scene, [], Status.GAVE_UP)[0],
        draw(path, scene, [(near, 0), (behind, 1)], Status.SOLVED)[0],
        draw(path, scene, [(near, 0), (behind, 1), (1, 3)], Status.SOLVED)[0],
    ]
    panel = 4 * CELL_INCH * DPI
    assert widths[1] > 3 * panel
    assert widths[2] > widths[1] + panel
    assert widths[0] < 3 * panel


def test_an_irregular_layout_draws(tmp_path: Path) -> None:
    layout = Layout(((0.5, 0.1), (0.5, -0.1), (0.68, 0.02), (0.8, -0.2)), 0.12)
    draw(tmp_path / "plan.png", Scene(layout, (0, 1), 2), [(0, 3)], Status.GAVE_UP)


def test_a_plan_that_does_not_replay_is_not_drawn(tmp_path: Path) -> None:
    scene = scene_of(DRAWING)
    reach = Reach(scene.layout, clearance_m=0.1, half_fan_deg=15.0, n_sectors=30)
    start = Batch.of(Problem(scene, reach))
    (plan,) = checked_plans(reach, start, [RawPlan([(scene.obstacles[1], 0)], Status.GAVE_UP, 0.0)], "test")
    elsewhere = Scene(scene.layout, (scene.obstacles[0],), scene.target)
    with pytest.raises(PlanError, match="move 1"):
        draw_plan(Problem(elsewhere, reach), plan, tmp_path / "plan.png")
    assert list(tmp_path.iterdir()) == []


def test_panels_follow_the_boards_of_a_plan() -> None:
    scene = scene_of(DRAWING)
    reach = Reach(scene.layout, clearance_m=0.1, half_fan_deg=15.0, n_sectors=30)
    near, behind = scene.obstacles[1], scene.obstacles[0]
    start = Batch.of(Problem(scene, reach))
    (plan,) = checked_plans(reach, start, [RawPlan([(near, 0), (behind, 1)], Status.SOLVED, 0.0)], "test")
    panels = panels_of(Problem(scene, reach), plan)
    assert [panel.scene.obstacles for panel in panels] == [
        tuple(sorted(board)) for board in ((near, behind), (0, behind), (0, 1))
    ]
    assert [panel.number for panel in panels] == [1, 2, 3]
    target = scene.target + 1
    assert [panel.words for panel in panels] == [f"{near + 1} to 1", f"{behind + 1} to 2", f"retrieve {target}"]
    assert Panel(Problem(scene, reach)).words == f"no way found to {target}"


@pytest.mark.parametrize("layout", [Layout.grid(3, 6, 0.12), Layout.grid(10, 10, 0.12), Layout(((0.5, 0.1),), 0.12)])
def test_a_panel_is_as_wide_as_asked_and_no_taller(layout: Layout) -> None:
    reach = Reach(layout, clearance_m=0.1, half_fan_deg=15.0, n_sectors=30)
    panel = Panel(Problem(Scene(layout, (), 0), reach))
    pixels = panel_pixels(panel, 384, 400, {})
    assert pixels.dtype == np.uint8
    assert pixels.shape[1:] == (384, 3)
    assert pixels.shape[0] <= 400
    assert (pixels[:, [0, -1]] == 255).all()  # nothing is cut off at the sides


def has(pixels: np.ndarray, colour: object) -> bool:
    """Whether a colour is there, edges aside."""
    return bool((np.abs(pixels - 255 * np.array(to_rgb(colour))) <= 1).all(-1).sum() > 50)


def test_a_panel_shows_its_objects_in_the_colours_given() -> None:
    scene = scene_of(DRAWING)
    reach = Reach(scene.layout, clearance_m=0.1, half_fan_deg=15.0, n_sectors=30)
    panel = Panel(Problem(scene, reach), Move(scene.obstacles[1], 0, 0.0, 0.0))
    usual, blue = (panel_pixels(panel, 384, 400, colours) for colours in ({}, dict.fromkeys(scene.obstacles, "blue")))
    assert has(usual, OBSTACLE_COLOUR)
    assert not has(usual, "blue")
    assert has(blue, "blue")
    assert not has(blue, OBSTACLE_COLOUR)


HEADER = "env_steps,episodes,seconds,epsilon,loss,success,target_success\n"


def test_learning_curve_with_gaps(tmp_path: Path) -> None:
    metrics = tmp_path / "metrics.csv"
    metrics.write_text(HEADER + "0,0,0.1,1.0,,,0.95\n100,10,0.5,0.9,1.5,0.2,0.95\n200,20,0.9,0.8,1.2,,0.95\n")
    draw_learning_curve(metrics, tmp_path / "curve.png")
    assert size_of(tmp_path / "curve.png") == (1400, 1120)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (None, "cannot be read"),
        (HEADER, "no rows"),
        (HEADER.replace("loss,", ""), "no column loss"),
        (HEADER + "0,0,0,1,x,0.5,0.95\n", "could not convert"),
        (HEADER + "0,0,0\n", "no rows"),
    ],
)
def test_a_bad_metrics_file_is_one_line(tmp_path: Path, text: str | None, why: str) -> None:
    metrics = tmp_path / "metrics.csv"
    if text is not None:
        metrics.write_text(text)
    with pytest.raises(InputError, match=f"^[^\n]*{why}[^\n]*$"):
        draw_learning_curve(metrics, tmp_path / "curve.png")
    assert not (tmp_path / "curve.png").exists()
