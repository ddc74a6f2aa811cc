"""The presets of the paper's Table 5 say what the paper says."""

from __future__ import annotations

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra

from dore.files import conf_dir

COLUMNS = ("6x6_z3-5", "6x6_z3-8", "7x7_z3-5", "7x7_z3-10", "8x8_z3-5", "8x8_z3-13")


def composed(*overrides: str):
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("train", list(overrides), return_hydra_config=True)


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize(
    ("paper", "e_r", "widths", "failed"),
    [("single", 595000, [600, 500, 400, 300], -3), ("sequential", 70000, [400, 300, 300], -3)],
)
def test_every_number_of_table_5(column, paper, e_r, widths, failed):
    cfg = composed(f"experiment=paper/{paper}", f"column={column}")
    size, obstacles = column.split("_z")
    assert f"{cfg.layout.rows}x{cfg.layout.cols}" == size
    assert f"{cfg.instances.min_obstacles}-{cfg.instances.max_obstacles}" == obstacles
    assert cfg.agent._target_.endswith({"single": ".Single", "sequential": ".Sequential"}[paper])
    assert cfg.instances.train_size == e_r
    assert cfg.training.max_episodes == 15 * e_r
    assert (cfg.instances.train_size + cfg.instances.validation_size) * 7 == cfg.instances.train_size * 10, (
        "70 and 30 %"
    )
    assert cfg.training.fill == min(5 * e_r, cfg.buffer.storage.max_size)
    assert (cfg.training.update_after, cfg.training.updates, cfg.training.keep) == ("episode", 1, "last")
    assert (cfg.ipt.target_success, cfg.ipt.batch_size, cfg.ipt.every_episodes, cfg.ipt.n_batches) == (
        0.95,
        1000,
        1000,
        5,
    )
    assert (cfg.training.batch_size, cfg.buffer.storage.max_size) == (32, 1000000)
    assert cfg.target_update.value_network_update_interval + 1 == 10000
    assert (cfg.agent.gamma, cfg.optimizer.lr) == (0.99, 0.0025)
    assert (cfg.exploration.start, cfg.exploration.end) == (1.0, 0.1)
    assert list(cfg.network.widths) == widths
    assert (cfg.env.rewards.solved, cfg.env.rewards.unfinished, cfg.env.rewards.failed) == (10, 0, failed)
    # What the paper leaves open, in its literal form: docs/paper.md.
    literal = {"mask_mode": "literal", "double": False, "loss_function": "l2", "symmetry": False, "encoding": "state"}
    literal |= {"heads": "independent"} if paper == "single" else {"chain": "literal", "failed_pick": "skip"}
    assert {key: cfg.agent[key] for key in literal} == literal
    assert cfg.training.min_episodes == 0


def test_the_first_column_of_table_5():
    cfg = composed("experiment=paper/single_3x6")
    assert (cfg.layout.rows, cfg.instances.train_size, cfg.training.max_episodes) == (3, 119000, 1785000)
    assert (cfg.training.fill, cfg.env.rewards.failed, list(cfg.network.widths)) == (
        595000,
        -1,
        [400, 300, 300],
    )


def test_the_sweep_is_the_whole_table():
    params = composed("experiment=table4").hydra.sweeper.params
    assert list(params) == ["column", "seed"]
    assert params.column.split(",") == list(COLUMNS)
