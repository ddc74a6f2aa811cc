"""The failures that are left: the first losing moves are losing, and the words follow the numbers."""

from __future__ import annotations

import hydra
import pytest
import torch
from omegaconf import OmegaConf

from dore.app import build
from dore.files import conf_dir
from dore.learn.checkpoint import save_model
from dore.learn.model import agent_of
from scripts.failures import main
from scripts.failures_figure import MOST, drawn_of
from scripts.failures_found import Board, column_of
from scripts.failures_page import explanation


@pytest.fixture(scope="module")
def untrained(tmp_path_factory):
    """A model file that has learned nothing, and so fails often."""
    overrides = ["agent=sequential", "agent.encoding=lanes", "agent.symmetry=false", "network=cells"]
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        cfg = hydra.compose("train", overrides)
    torch.manual_seed(0)
    agent = agent_of(cfg, build.reach_of(cfg, "cpu"))
    path = tmp_path_factory.mktemp("model") / "untrained.safetensors"
    plain = OmegaConf.to_container(cfg, resolve=True)
    save_model(path, agent.networks.state_dict(), {name: plain[name] for name in build.MODEL})
    return path


def test_a_mistake_is_the_first_move_that_brings_no_end_nearer(untrained):
    column = column_of("3x6_z3-7", untrained, 60)
    assert len(column.boards) + column.undecided <= column.drawn == 60
    assert column.failed
    for board in column.failed:
        mistake = board.mistake
        assert mistake is not None
        assert mistake.optimum == board.optimum - (mistake.number - 1)
        assert mistake.after is None or mistake.after >= mistake.optimum
        assert (mistake.best.pick, mistake.best.place) != (mistake.move.pick, mistake.move.place)
        assert mistake.move.pick in mistake.problem.scene.obstacles
        if mistake.number == 1:
            assert mistake.now == board.now
    assert all(board.mistake is None for board in column.boards if not board.ending)


def boards(above: tuple[int, int], below: tuple[int, int]) -> list[Board]:
    """(solved, failed) boards whose optimum is above `now`, and others."""
    found = []
    for now, (solved, failed) in ((1, above), (2, below)):
        found += [Board(0, 2, now, "")] * solved + [Board(0, 2, now, "move budget")] * failed
    return found


def test_the_explanation_follows_the_numbers():
    most = explanation(boards(above=(17, 83), below=(4784, 16)))
    assert "on 83 of 99 failures (83.8 [" in most
    assert "on 100 of all 4900 boards (2.0 [" in most
    assert "249 times as often" in most
    assert "most failures are" in most
    assert "though not most" in explanation(boards(above=(60, 40), below=(4700, 100)))
    assert "do not explain" in explanation(boards(above=(100, 0), below=(4800, 50)))
    none = explanation(boards(above=(0, 0), below=(10, 3)))
    assert "on 0 of all 13 boards" in none
    assert "fails on - %" in none


def test_a_page_and_a_picture(untrained, tmp_path, capsys):
    report = tmp_path / "new" / "failures"
    words = ["--model", str(untrained), "--boards", "40", "--report", str(report)]
    assert main([*words, "--columns", "3x6_z3-7", "5x5_z3-8"]) == 0
    page = report.with_suffix(".md").read_text(encoding="utf-8")
    for part in ("## 3 x 6, 3-7 obstacles", "## 5 x 5, 3-8 obstacles", "(failures.png)", "| how they end |"):
        assert part in page, part
    assert "nan" not in page
    assert report.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert main([*words, "--columns", "3x6"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("failures: --columns: got '3x6', want LAYOUT_INSTANCES")


def test_columns_take_turns(untrained):
    columns = [column_of(name, untrained, 40) for name in ("3x6_z3-7", "5x5_z3-8")]
    drawn = drawn_of(columns)
    assert len(drawn) == MOST
    assert [column.name for column, _, _ in drawn] == ["3x6_z3-7"] * 3 + ["5x5_z3-8"] * 3
    assert drawn_of([]) == []
