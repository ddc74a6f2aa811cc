"""The ablations: the page's figures by hand, what does not belong, and the script on tiny runs."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path

import hydra
import pytest
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from dore.app.session import trainer_of
from dore.errors import InputError
from dore.files import conf_dir
from scripts.ablation_page import COLUMNS, EPISODES, GAIN, main, metrics_of
from scripts.ablation_runs import Variant, _changed, read_variants
from scripts.learning_curves import Ipt
from tests.commands import TINY, run

ROOT = Path(__file__).parents[2]


def variant(change: str, *tests: list[Ipt], structure: str = "single") -> Variant:
    cfg = OmegaConf.create({"seed": 0, "training": {"max_minutes": 1}})
    return Variant("improved", structure, change, [cfg], [], list(tests), [])


def test_figures_by_hand():
    unchanged = variant("none", [Ipt(10, 1.0, 0.96)], [Ipt(10, 1.0, 0.5), Ipt(30, 4.0, 1.0)])
    heads = variant("heads", [Ipt(10, 1.0, 0.5)], [Ipt(10, 1.0, 0.7)])
    (metric,) = metrics_of([unchanged, heads])
    cells = {(entry.row, entry.column): entry for entry in metric.entries}
    first, second = cells["single: unchanged", COLUMNS[0]], cells["single: heads", COLUMNS[0]]
    assert (first.n, first.value.value, first.value.low, first.value.high) == (2, 98, 96, 100)
    assert second.value.value == pytest.approx(60)
    assert cells["single: heads", GAIN].value.value == pytest.approx(-38)
    assert cells["single: unchanged", EPISODES].value.value == 20
    assert cells["single: heads", EPISODES].n == 0
    assert ("single: unchanged", GAIN) not in cells


def test_what_does_not_belong_is_one_line(tmp_path, capsys):
    report = [str(tmp_path / "runs"), str(tmp_path / "report" / "a")]
    assert main(report) == 2
    assert "no run has ended" in capsys.readouterr().err
    folder = tmp_path / "runs" / "improved_single_heads_seed0"
    assert run("train", [*TINY, "agent=single", f"run_dir={folder}"]) == 0
    capsys.readouterr()
    assert main(report) == 2
    assert "there is no improved_single_none to set it against" in capsys.readouterr().err
    folder.rename(folder.with_name("mine"))
    with pytest.raises(InputError, match="want a folder called BASE_STRUCTURE_CHANGE_seedN"):
        read_variants(tmp_path / "runs")
    assert not (tmp_path / "report").exists()


@pytest.mark.slow
def test_the_script_ends_and_does_nothing_twice(tmp_path):
    small = [one for one in TINY if not one.startswith(("layout.", "instances.m", "ipt.every", "logger"))]
    environment = os.environ | {
        "OUT": str(tmp_path / "out"),
        "REPORT": str(tmp_path / "ablation"),
        "ONLY": "none heads",
        "TRAIN": " ".join([*small, "ipt.every_episodes=50", "instances.train_size=50", "training.fill=0"]),
    }
    script = [str(ROOT / "scripts" / "ablation.sh")]
    first = subprocess.run(script, env=environment, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stderr
    assert first.stdout.count("2 jobs done (0 of them before), 0 broken") == 6
    again = subprocess.run(script, env=environment, capture_output=True, text=True, check=True)
    assert again.stdout.count("2 jobs done (2 of them before), 0 broken") == 6
    page = (tmp_path / "ablation.md").read_text(encoding="utf-8")
    for word in ("- improved, single, heads: `agent.heads: independent -> mean`\n", "| sequential: unchanged |"):
        assert word in page, word
    assert (tmp_path / "ablation.png").stat().st_size > 10_000


def calls() -> list[tuple[str, str, str, list[str]]]:
    """What the script calls `ablate` with; its loop over structures is played."""
    text = (ROOT / "scripts" / "ablation.sh").read_text(encoding="utf-8")
    lines = [shlex.split(line) for line in text.splitlines() if line.strip().startswith("ablate ")]
    found = []
    for base, structure, change, *overrides in (line[1:] for line in lines):
        for one in ("sequential", "single") if "$" in structure else (structure,):
            found.append((base, one, change, overrides))
    return found


def composed(base: str, structure: str, overrides: list[str]):
    GlobalHydra.instance().clear()
    small = ["instances.train_size=20", "instances.validation_size=20", "ipt.batch_size=20", "env.num_envs=4"]
    small += ["training.learning_starts=1", "training.fill=0"]
    group = "agent" if base == "improved" else "paper"
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return hydra.compose("train", [f"experiment=ablation/{base}", f"{group}={structure}", *overrides, *small])


@pytest.mark.parametrize(("base", "structure", "change", "overrides"), calls())
def test_every_change_of_the_script_learns_and_changes_what_it_says(base, structure, change, overrides):
    cfg = composed(base, structure, overrides)
    trainer = trainer_of(cfg)
    while not trainer.progress.updates:
        trainer.iterate()
    changed = {one.split(":")[0] for one in _changed(composed(base, structure, []), cfg)}
    keys = {override.split("=")[0] for override in overrides}
    assert all(any(one == key or one.startswith(f"{key}.") for key in keys) for one in changed), changed
    assert bool(changed) == (change != "none")


def test_every_key_of_the_issue_is_there():
    wanted = {"none", "mask", "chain", "heads", "target-update", "learning-rate", "symmetry", "step-cost", "double"}
    ours = {"encoding", "network", "averaging", "precision"}
    for base, more in (("improved", ours), ("literal", set())):
        assert {change for one, _, change, _ in calls() if one == base} == wanted | more
