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
    boards = boards_of("3x6_z3-7", untrained, 60)
    assert [board.row["instance"] for board in boards] == list(range(1, 61))
    failed = [board for board in boards if board.row["stop_reason"]]
    assert failed
    for board in failed:
        mistake = board.mistake
        assert mistake is not None
        assert mistake.before == board.row["optimum"] - (mistake.number - 1)
        assert mistake.after is None or mistake.after >= mistake.before
        assert (mistake.best.pick, mistake.best.place) != (mistake.panel.move.pick, mistake.panel.move.place)
        assert mistake.panel.move.pick in mistake.panel.problem.scene.obstacles
        if mistake.number == 1:
            assert mistake.now == board.row["now"]
    assert all(board.mistake is None for board in boards if not board.row["stop_reason"])


def rows(above: tuple[int, int], below: tuple[int, int]) -> list[dict[str, object]]:
    """(solved, failed) boards whose optimum is above `now`, and others; one that has no plan, one that is undecided."""
    lost = {"mistake": 5, "mistake_now": 1, "before": 2, "after": 2}
    found = []
    for now, (solved, failed) in ((1, above), (2, below)):
        board = {"column": "8x8_z3-13", "instance": 1, "status": "solved", "optimum": 2, "now": now}
        found += [board | {"stop_reason": None} | dict.fromkeys(lost)] * solved
        found += [board | {"stop_reason": "move budget"} | lost] * failed
    none = found[0] | {"optimum": None, "stop_reason": None} | dict.fromkeys(lost)
    return [*found, none | {"status": "unsolvable"}, none | {"status": "gave_up"}]


def page_of(folder, *of: tuple[int, int]) -> str:
    write_measurements(folder / "measured", rows(*of), weights="w", proof_s=10.0)
    return results.write_page(fakes.study("failures"), "failures", folder, folder / "pages").read_text(encoding="utf-8")


def test_the_words_follow_the_numbers(tmp_path):
    most = page_of(tmp_path, (17, 83), (4784, 16))
    assert "4902 boards, 4900 can be solved, 1 are undecided. The network fails on 99 of" in most
    assert "on 83 of 99 failures (83.8 [" in most
    assert "on 100 of all 4900 boards (2.0 [" in most
    assert "249 times as often" in most
    assert "most failures are" in most
    assert "| 1 | 100 | 2.0 | 83 | 83.8 | 83.0 [74.5, 89.1] |" in most
    assert most.index("| 0 | 4800 |") < most.index("| 1 | 100 |")
    for line in ("| step limit | 99 | 100.0 |", "| move 4 or later | 99 |", "| a move: the distance stays | 99 |"):
        assert line in most, line
    assert "though not most" in page_of(tmp_path, (60, 40), (4700, 100))
    assert "do not explain" in page_of(tmp_path, (100, 0), (4800, 50))
    none = page_of(tmp_path, (0, 0), (10, 3))
    assert "on 0 of all 13 boards" in none
    assert "fails on - of such boards" in none
    assert "nan" not in none
    assert "The optimum is above" not in page_of(tmp_path, (2, 0), (10, 0))


def test_rows_and_a_picture(untrained, tmp_path, capsys):
    out, picture = tmp_path / "measured", tmp_path / "new" / "failures.png"
    words = [f"out={out}", f"model={untrained}", "boards=40", f"picture={picture}"]
    assert run(main, Options, [*words, "columns=[3x6_z3-7,5x5_z3-8]"]) == 0
    assert len((out / "rows.csv").read_text(encoding="utf-8").splitlines()) == 81
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run(main, Options, [*words, "columns=[3x6]"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("failures: columns: got '3x6', want LAYOUT_INSTANCES")
    ended = subprocess.run([sys.executable, "-m", "scripts.failures", f"out={out}", "boards=0"], capture_output=True)
    assert (ended.returncode, ended.stderr[:23]) == (2, b"failures: boards: got 0")
    with pytest.raises(InputError, match="got no rows"):
        write_measurements(out, [])


def test_columns_take_turns(untrained):
    columns = [boards_of(name, untrained, 40) for name in ("3x6_z3-7", "5x5_z3-8")]
    assert [board.row["column"] for board in drawn_of(columns)] == ["3x6_z3-7"] * 3 + ["5x5_z3-8"] * 3
    assert len(drawn_of(columns[:1])) == MOST
    assert drawn_of([]) == []
