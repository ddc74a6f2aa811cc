"""Q-value maps: what is framed is what the greedy policy does, on boards of the wanted optimum."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dore.app.front_door import plan
from dore.errors import InputError
from dore.learn.checkpoint import Q_NETWORK, SHIPPED
from scripts import q_maps
from scripts.program import composed, run
from scripts.q_maps import BOARDS, FIG_1, Options, Wanted, main, maps_of
from tests.worlds import make_agent

SMALL = Wanted("3x6", 4, 2, "a small one")


def test_the_choices_are_the_policys_first_move():
    pick, place = maps_of(SMALL, Q_NETWORK)
    learned, exact = (plan(pick.scene, planner, reach="wide_hand", model=Q_NETWORK) for planner in ("learned", "exact"))
    assert (pick.choice, place.choice) == (learned.moves[0].pick, learned.moves[0].place)
    assert len(exact.moves) == SMALL.optimum
    assert set(place.scene.obstacles) == set(pick.scene.obstacles) - {pick.choice}
    assert set(pick.legal.nonzero().squeeze(-1).tolist()) <= set(pick.scene.obstacles)
    assert not set(place.legal.nonzero().squeeze(-1).tolist()) & {*place.scene.obstacles, place.scene.target}


@pytest.mark.parametrize("right", [True, False])
def test_a_first_move_is_right_where_the_end_comes_nearer(right):
    pick, place = maps_of(Wanted("3x6", 9, 6, "", "paper_fit", right), SHIPPED, probabilities=True)
    assert (pick.right and place.right) == right
    for one in (pick, place):
        assert float(one.values[one.legal].sum()) == pytest.approx(100, abs=0.1)
    left = {*place.scene.obstacles, place.choice}
    after = replace(place.scene, obstacles=tuple(sorted(left)))
    assert (len(plan(after, "exact", reach="paper_fit").moves) == 5) == right


def test_a_picture_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(q_maps, "BOARDS", (SMALL, Wanted("5x5", 5, 1, "another")))
    out = tmp_path / "new" / "q.png"
    assert run(main, Options, [f"out={out}"]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert out.stat().st_size > 20_000


def test_the_boards_of_the_page_compose():
    for wanted in (*BOARDS, *FIG_1):
        rows, cols = wanted.layout.split("x")
        cfg = composed("evaluate", f"layout={wanted.layout}", "reach=wide_hand")
        assert (cfg.layout.rows, cfg.layout.cols) == (int(rows), int(cols))


def test_what_cannot_be_drawn_is_one_line(tmp_path, capsys):
    assert run(main, Options, [f"model={tmp_path / 'none'}", f"out={tmp_path / 'q.png'}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "no such file" in line
    with pytest.raises(InputError, match="none of 400 boards needs 9 moves"):
        maps_of(Wanted("3x6", 3, 9, ""), Q_NETWORK)


def test_only_a_sequential_agent_has_both(monkeypatch):
    monkeypatch.setattr(
        "dore.planners.learned.Learned.copy_of_agent", lambda planner: make_agent("single", False, planner.reach)
    )
    with pytest.raises(InputError, match="want one of agent=sequential"):
        maps_of(SMALL, Q_NETWORK)
