"""The failures that are left: the first losing moves are losing, and the page's words follow the numbers."""

from __future__ import annotations

import subprocess
import sys

import hydra
import pytest
import torch
from omegaconf import OmegaConf

from dore.app import build
from dore.errors import InputError
from dore.files import conf_dir
from dore.learn.agents.common import agent_from_config
from dore.learn.checkpoint import save_model
from dore.report import results
from dore.report.measurements import write_measurements
from dore.world.labeller import Labeller
from dore.world.problem import Batch
from scripts.failures import MOST, Options, boards_of, drawn_of, main
from scripts.program import run
from tests.report import fakes


@pytest.fixture(scope="module")
def untrained(tmp_path_factory):
    """A model file that has learned nothing, and so fails often."""
    overrides = ["agent=sequential", "agent.encoding=lanes", "agent.symmetry=false", "network=cells"]
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        cfg = hydra.compose("train", overrides)
    torch.manual_seed(0)
    agent = agent_from_config(cfg, build.reach_of(cfg, "cpu"))
    path = tmp_path_factory.mktemp("model") / "untrained.safetensors"
    plain = OmegaConf.to_container(cfg, resolve=True)
    save_model(path, agent.networks.state_dict(), {name: plain[name] for name in build.MODEL})
    return path


def test_a_mistake_is_the_first_move_that_brings_no_end_nearer(untrained):
    boards = boards_of("3x6_wide_hand", untrained, 40)
    assert [board.row["instance"] for board in boards] == list(range(1, 41))
    failed = [board for board in boards if board.row["stop_reason"]]
    assert failed
    for row, mistake, best in failed:
        assert mistake is not None
        assert best is not None
        assert row["before"] == row["optimum"] - (row["mistake"] - 1)
        assert row["after"] is None or row["after"] >= row["before"]
        assert best.problem == mistake.problem
        assert (best.move.pick, best.move.place) != (mistake.move.pick, mistake.move.place)
        assert mistake.move.pick in mistake.scene.obstacles
        labeller = Labeller(mistake.problem.reach, 100_000, 30)
        optimal = labeller.label(Batch.of(mistake.problem)).wasted[0, mistake.move.pick] == 0
        assert row["choice"] == ("place" if optimal.any() else "pick")
        assert row["nearer"] + row["level"] + row["farther"] <= row["made"]
        assert row["nearest"] <= row["before"]
    assert all(board.mistake is None and board.row["made"] is None for board in boards if not board.row["stop_reason"])


def rows(above: tuple[int, int], below: tuple[int, int]) -> list[dict[str, object]]:
    """(solved, failed) boards of eight moves, whose cost is four lower or the same; and a short one that is solved."""
    lost = {"made": 10, "nearest": 2, "nearer": 5, "level": 3, "farther": 2}
    lost |= {"mistake": 5, "before": 2, "after": 2, "choice": "place"}
    found = []
    for now, (solved, failed) in ((4, above), (8, below)):
        board = {"world": "8x8_paper_fit", "instance": 1, "obstacles": 30, "optimum": 8, "now": now}
        found += [board | {"stop_reason": None} | dict.fromkeys(lost)] * solved
        found += [board | {"stop_reason": "move budget"} | lost] * failed
    return [*found, found[0] | {"optimum": 2, "stop_reason": None} | dict.fromkeys(lost)]


def page_of(folder, *of: tuple[int, int]) -> str:
    write_measurements(folder / "measured", rows(*of), weights="w", proof_s=10.0)
    return results.write_page(fakes.study("failures"), "failures", folder, folder / "pages").read_text(encoding="utf-8")


def test_the_words_follow_the_numbers(tmp_path):
    more = page_of(tmp_path, (17, 83), (84, 16))
    assert "201 boards, each with a proved plan; the network fails on 49.3 [" in more
    assert "of those of seven moves and more on 49.5 [" in more
    assert "| 8 x 8, paper_fit | 201 | 99 | 0.0 | 49.5 |" in more
    assert "where the costs promise progress that is not there" in more
    assert "| 7-8 | 200 | 99 | 49.5 [" in more
    assert "| 0 or less | 100 | 16 | 16.0 [" in more
    assert "| all | 990.0 | 50.0 | 30.0 | 20.0 |" in more
    for line in (
        "| step limit | 99 | 100.0 |",
        "| move 4 or later | 99 |",
        "| it costs a move: the distance stays | 99 |",
    ):
        assert line in more, line
    assert "do not differ by more than chance" in page_of(tmp_path, (50, 50), (52, 48))
    assert "in vain does not explain" in page_of(tmp_path, (100, 0), (50, 50))
    some = page_of(tmp_path, (0, 0), (10, 3))
    assert "promise" not in some
    assert "nan" not in some
    none = page_of(tmp_path, (0, 0), (10, 0))
    assert "It fails on none." in none
    assert "How they go wrong" not in none


def test_rows_and_a_picture(untrained, tmp_path, capsys):
    out, picture = tmp_path / "measured", tmp_path / "new" / "failures.png"
    words = [f"out={out}", f"model={untrained}", "boards=12", f"picture={picture}"]
    assert run(main, Options, [*words, "worlds=[3x6_wide_hand,5x5_paper_fit]"]) == 0
    assert len((out / "rows.csv").read_text(encoding="utf-8").splitlines()) == 25
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run(main, Options, [*words, "worlds=[3x6]"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("failures: worlds: got '3x6', want LAYOUT_REACH")
    ended = subprocess.run([sys.executable, "-m", "scripts.failures", f"out={out}", "boards=0"], capture_output=True)
    assert (ended.returncode, ended.stderr[:23]) == (2, b"failures: boards: got 0")
    with pytest.raises(InputError, match="got no rows"):
        write_measurements(out, [])


def test_worlds_take_turns(untrained):
    worlds = [boards_of(name, untrained, 20) for name in ("3x6_wide_hand", "5x5_wide_hand")]
    assert [board.row["world"] for board in drawn_of(worlds)] == ["3x6_wide_hand", "5x5_wide_hand"] * 3
    assert len(drawn_of(worlds[:1])) == MOST
    assert drawn_of([]) == []
