"""The benchmark: its file, its strata, and how it is made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dore.configure import make
from dore.errors import InputError
from dore.world import strata
from dore.world.benchmark import STRATA, UNSOLVABLE, Benchmark, Setting, digest, read, stratum_of, unpacked
from dore.world.generator import SPLITS, split_share
from dore.world.problem import Batch
from dore.world.rules import has_move, retrievable
from tests.app.test_conf import compose

SHIPPED: Benchmark = make(compose("evaluate", ["instances=benchmark"]).instances, "instances")


def part(**keys: object) -> Benchmark:
    return replace(SHIPPED, **keys)  # type: ignore[arg-type]


def test_the_file_in_the_package_is_the_one_that_the_config_names() -> None:
    assert len(SHIPPED.rows) == 40
    assert sum(map(len, SHIPPED.rows.values())) == 69_165
    with pytest.raises(InputError, match=r"instances.sha256: got \w{64} of .*benchmark.npz, want 00"):
        _ = part(sha256="00").rows


@pytest.mark.parametrize("setting", SHIPPED.settings, ids=str)
def test_boards_are_different_instances_of_the_test_split(setting: Setting) -> None:
    rows, reach = SHIPPED.rows[str(setting)], SHIPPED.reach_of(setting.layout, setting.reach)
    board, target = unpacked(rows, reach)
    assert (split_share(board, reach) >= SPLITS["test"][0]).all()
    assert not retrievable(reach, board, target).any()
    assert has_move(reach, board, target).all()
    n_obstacles = np.unpackbits(rows[:, 2:], axis=1).sum(1)
    assert set(n_obstacles) == {round(setting.density * reach.n_cells / 100 + 1e-9)}
    seen: set[bytes] = set()
    assert len(strata._fresh(reach, Batch(board, target), seen).target) == len(rows), "two are the same, or mirrored"
    assert np.bincount(stratum_of(rows[:, 1])).max() <= SHIPPED.per_stratum


@pytest.mark.parametrize("layout", ["3x6", "10x10"])
def test_optima_are_those_that_exact_search_proves(layout: str) -> None:
    for one in part(layouts=[layout]).sets(2, "cpu"):
        found = strata.searched(one.instances.reach, one.instances.batch(), 2000)
        wanted = [UNSOLVABLE if about["optimum"] is None else about["optimum"] for about in one.about]
        assert found.optimum.tolist() == wanted


def test_a_setting_is_made_again_to_the_last_byte() -> None:
    setting = Setting("3x6", "paper_fit", 50)
    made = strata.make_setting(SHIPPED, setting)
    assert np.array_equal(made.rows(), SHIPPED.rows[str(setting)])
    assert [len(stratum) for stratum in made.strata] == [300] * 7
    assert made.left_out_short == 0


def test_settings_do_not_depend_on_each_other_and_differ_by_the_seed() -> None:
    small = part(per_stratum=2, max_candidates=4096)
    setting = Setting("6x6", "wide_hand", 30)
    rows = strata.make_setting(replace(small, layouts=["6x6"]), setting).rows()
    assert np.array_equal(rows, strata.make_setting(small, setting).rows())
    assert not np.array_equal(rows, strata.make_setting(replace(small, seed=1), setting).rows())


def test_strata() -> None:
    names = [STRATA[place] for place in stratum_of(np.array([1, 2, 3, 4, 5, 6, 7, 40, UNSOLVABLE], np.uint8))]
    assert names == ["1", "2", "3", "4", "5-6", "5-6", "7+", "7+", "unsolvable"]


def test_a_limit_takes_the_first_of_each_stratum() -> None:
    (one,) = part(layouts=["3x6"], reaches=["paper_fit"], densities=[40, 50]).sets(3, "cpu")
    counts = {(about["density"], about["stratum"]) for about in one.about}
    assert len(one.instances) == len(one.about) == 3 * len(counts) == 42
    (more,) = part(layouts=["3x6"], reaches=["paper_fit"], densities=[40, 50]).sets(4, "cpu")
    assert torch.equal(one.instances.board[:3], more.instances.board[:3])


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"layouts": []}, "instances.layouts: got none"),
        ({"layouts": ["4x4"]}, "instances.layouts: got '4x4', want some of 3x6, 6x6"),
        ({"reaches": ["none"]}, "instances.reaches: got 'none'"),
        ({"densities": [0]}, "instances.densities: got 0"),
        ({"per_stratum": 0}, "instances.per_stratum: got 0"),
        ({"seed": -1}, "instances.seed: got -1"),
    ],
)
def test_a_bad_key(keys: dict[str, object], why: str) -> None:
    with pytest.raises(InputError, match=why):
        part(**keys)


def test_a_bad_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.npz"
    mine = part(path=str(file), sha256=None, layouts=["3x6"])
    with pytest.raises(InputError, match="no such file"):
        _ = mine.rows
    file.write_bytes(b"PK")
    with pytest.raises(InputError, match="damaged"):
        _ = mine.rows
    np.savez(file, **{"3x6 wide_hand 10": np.zeros((1, 5), np.uint8)})
    with pytest.raises(InputError, match="no boards of 3x6 wide_hand 20"):
        _ = mine.rows
    np.savez(file, one=np.zeros(3))
    with pytest.raises(InputError, match="one: got float64"):
        read(file)


def test_the_digest_is_of_the_contents() -> None:
    one = {"a": np.zeros((2, 3), np.uint8), "b": np.ones((1, 3), np.uint8)}
    assert digest(one) == digest(dict(reversed(one.items())))
    assert digest(one) != digest({**one, "a": np.zeros((3, 2), np.uint8)})
