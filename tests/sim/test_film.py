"""Frames are put together right, and films and stills appear whole or not at all; how they look is not tested."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio.v2 as imageio
import numpy as np
import pytest
import torch

from dore.draw.boards import Panel
from dore.sim.config import preset
from dore.sim.run.film import READING_S, Film
from dore.sim.run.film_frame import FilmFrame
from dore.sim.scene.agent import render_backend
from dore.sim.scene.scene_builder import OBSTACLE_PAINTS, TARGET_PAINT
from dore.sim.scene.task import DoreTabletopEnv
from dore.world.layout import Layout
from dore.world.plan import Move
from dore.world.problem import Problem, Scene
from dore.world.reach import Reach
from tests.rendering import needs_vulkan

LAYOUT = Layout.grid(3, 6, 0.12, 0.50)
REACH = Reach(LAYOUT, clearance_m=0.10, half_fan_deg=30.0, n_sectors=61)
SCENE = Scene(LAYOUT, obstacles=(2, 8), target=14)
MOVE = Panel(Problem(SCENE, REACH), Move(2, 11, 0.0, 0.0))
STEP_S, RATE = 0.05, 10.0
VIEW = replace(preset("view/corner"), width_px=160, height_px=120, frames_per_s=RATE, playback_speed=1.0)


class FakeEnv:
    """An environment that needs no simulator: three objects in their cells, and a picture that grows lighter."""

    def __init__(self) -> None:
        at = torch.zeros(1, 3, 3)
        at[0, :, :2] = LAYOUT.centres[[14, 2, 8]]
        self.unwrapped = SimpleNamespace(view=VIEW, positions=lambda: at)
        self.looks = 0

    def render(self) -> torch.Tensor:
        self.looks += 1
        return torch.full((1, VIEW.height_px, VIEW.width_px, 3), min(255, 4 * self.looks), dtype=torch.uint8)


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def ink(region: np.ndarray) -> int:
    """How many pixels are not white."""
    return int((region < 128).any(-1).sum())


def test_a_frame_holds_the_picture_the_board_and_a_line():
    page = FilmFrame(640, 480)
    picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    empty = page.frame(picture, "", "")
    assert empty.shape == (page.size[1], page.size[0], 3) == (528, 1024, 3)
    assert (empty[:480, :640] == picture).all()
    assert ink(empty[:, 640:]) == ink(empty[480:]) == 0
    page.show_board(MOVE, {})
    frame = page.frame(picture, "move 1 of 2: 3 to 12", "simulated 1.0 s")
    assert (frame[:480, :640] == picture).all()
    assert ink(frame[:480, 640:]) > 1000
    assert ink(frame[480:, :640]) > 200
    assert ink(empty) < ink(frame)  # frames share no memory


def test_only_what_is_new_is_drawn_again():
    page, picture = FilmFrame(640, 480), np.zeros((480, 640, 3), np.uint8)
    page.show_board(MOVE, {})
    first, second = (page.frame(picture, "move 1", f"simulated {s} s") for s in (1, 2))
    assert (first[:480] == second[:480]).all()
    assert (first[480:] != second[480:]).any()
    assert (page.frame(picture, "move 1", "simulated 1 s") == first).all()
    page.show_board(Panel(Problem(SCENE, REACH)), {})
    assert (page.frame(picture, "move 1", "simulated 1 s")[:480, 640:] != first[:480, 640:]).any()


@pytest.mark.parametrize("size", [(16, 16), (1280, 16), (16, 1280), (161, 123), (640, 480)])
def test_every_size_of_view_has_a_frame(size):
    page = FilmFrame(*size)
    page.show_board(MOVE, {})
    page.add_line("the camera sees 7 objects", "0.0 s")
    frame = page.frame(np.zeros((size[1], size[0], 3), np.uint8), "the camera sees 7 objects", "simulated 0.0 s")
    assert all(length % 8 == 0 for length in frame.shape[:2])


def test_a_long_caption_stays_off_the_clock():
    page, picture = FilmFrame(640, 480), np.zeros((480, 640, 3), np.uint8)
    clock = page.frame(picture, "", "simulated 12.4 s")[480:]
    starts = int(np.flatnonzero((clock < 200).any((0, 2)))[0])
    long = "stopped: target (15): approach: the left finger would touch the object on cell 3. " * 3
    frame = page.frame(picture, long, "simulated 12.4 s")[480:]
    assert (frame[:, starts - 8 :] == clock[:, starts - 8 :]).all()
    assert ink(frame[:, :640]) > 500


def test_what_has_happened_stays_and_the_newest_wins():
    page, picture = FilmFrame(640, 480), np.zeros((480, 640, 3), np.uint8)
    page.show_board(MOVE, {})
    amounts = []
    for number in range(40):
        page.add_line(f"look {number}: the target on 15, obstacles on 1, 3, 7, 9, 13 and 16", f"{number}.0 s")
        amounts.append(page.frame(picture, "", ""))
    assert ink(amounts[0]) < ink(amounts[1]) < ink(amounts[2])
    assert (amounts[-1] != amounts[-2]).any()
    assert (amounts[-1][480:] == 255).all()


def film(path: Path, moves: int, on: bool = True, fails: BaseException | None = None) -> FakeEnv:
    """A film of moves of twenty steps each, and a still of each."""
    env = FakeEnv()
    with Film(env, path, STEP_S, on) as video:
        for number in range(1, moves + 1):
            video.caption(f"move {number}", replace(MOVE, number=number))
            for _ in range(20):
                video.after_step()
            if fails is not None:
                raise fails
            video.pause(f"move {number}: done", still=f"move_{number}")
    assert video.written is on
    assert video.stills == [f"move_{number}.png" for number in range(1, moves + 1) if on]
    return env


def test_a_film_stands_still_to_be_read(tmp_path):
    film(tmp_path / "execution.mp4", moves=2)
    assert names(tmp_path) == ["execution.mp4", "move_1.png", "move_2.png"]
    with imageio.get_reader(tmp_path / "execution.mp4") as reader:
        assert reader.get_meta_data()["size"] == FilmFrame(160, 120).size
        assert reader.count_frames() == 2 * (20 * STEP_S * RATE + READING_S * RATE)
    still = imageio.imread(tmp_path / "move_1.png")
    assert still.shape[:2] == FilmFrame(160, 120).size[::-1]
    assert (still[:120, :160] == 4 * 11).all()  # the eleventh look: as the move ends, not the film's last frame of it


@pytest.mark.parametrize("fails", [RuntimeError("a fault"), KeyboardInterrupt()])
def test_a_film_that_is_cut_off_leaves_nothing(tmp_path, fails):
    with pytest.raises(type(fails)):
        film(tmp_path / "execution.mp4", moves=1, fails=fails)
    assert names(tmp_path) == []


def test_an_old_film_stays_where_the_new_one_is_cut_off(tmp_path):
    (tmp_path / "execution.mp4").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        film(tmp_path / "execution.mp4", moves=1, fails=KeyboardInterrupt())
    assert (tmp_path / "execution.mp4").read_text() == "old"


def test_nothing_is_made_where_nothing_can_render(tmp_path):
    assert film(tmp_path / "execution.mp4", moves=2, on=False).looks == 0
    assert names(tmp_path) == []


def test_a_film_of_no_frame_is_no_film(tmp_path):
    with Film(FakeEnv(), tmp_path / "execution.mp4", STEP_S, on=True) as video:
        pass
    assert not video.written
    assert names(tmp_path) == []


def test_a_still_that_cannot_be_written_ends_the_film(tmp_path):
    (tmp_path / "move_1.png").mkdir()
    with pytest.raises(OSError, match="move_1"):
        film(tmp_path / "execution.mp4", moves=1)
    assert names(tmp_path) == ["move_1.png"]


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    def full(frame: np.ndarray) -> None:
        raise OSError("Broken pipe\n\nFFMPEG COMMAND:\n...")

    writer = SimpleNamespace(append_data=full, close=lambda: None)
    monkeypatch.setattr("dore.sim.run.film.imageio.get_writer", lambda *args, **kwargs: writer)
    with pytest.raises(OSError, match="is the disk full") as caught:
        film(tmp_path / "execution.mp4", moves=1)
    assert caught.value.filename == str(tmp_path / "execution.mp4")


def test_the_board_has_the_objects_colours(tmp_path):
    video = Film(FakeEnv(), tmp_path / "execution.mp4", STEP_S, on=True)
    assert video._colours(SCENE) == {14: TARGET_PAINT, 2: OBSTACLE_PAINTS[1], 8: OBSTACLE_PAINTS[2]}


@pytest.mark.slow
@pytest.mark.sim
@needs_vulkan
def test_the_arm_is_filmed_where_vulkan_is(tmp_path):
    settings: dict[str, Any] = {"obs_mode": "none", "reward_mode": "none", "sim_backend": "physx_cpu"}
    env = DoreTabletopEnv(
        layout=LAYOUT, bodies=preset("objects/mixed").draw(3, np.random.default_rng(0)),
        view=VIEW, render_mode="rgb_array", render_backend=render_backend(), **settings,
    )  # fmt: skip
    env.reset(seed=0, options={"cells": [14, 2, 8]})
    with Film(env, tmp_path / "execution.mp4", STEP_S, on=True) as video:
        assert set(video._colours(SCENE)) == {2, 8, 14}
        video.pause("the camera sees 3 objects", Panel(Problem(SCENE, REACH)), still="look")
    env.close()
    still = imageio.imread(tmp_path / "look.png")
    assert still[:120, :160].std() > 10  # a picture, not a blank
    assert names(tmp_path) == ["execution.mp4", "look.png"]
