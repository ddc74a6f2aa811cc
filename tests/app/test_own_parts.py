"""Own folders of configs: found by jobs and by messages, and never left out without a word."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hydra._internal.core_plugins import file_config_source
from hydra._internal.sources_registry import SourcesRegistry

from dore.app import own_parts, sweep
from tests.commands import TINY, complaints, run

SCENE = ("layout=3x6", "reach=wide_hand", "instances=z3-5")


def write(folder: Path, **files: str) -> None:
    for name, text in files.items():
        path = folder / f"{name.replace('__', '/')}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


@pytest.fixture(autouse=True)
def own(tmp_path, monkeypatch):
    """Two folders of options, in a current folder with a module."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    write(
        tmp_path / "it's one",
        network__small="_target_: dore.learn.networks.MLP\n_partial_: true\nwidths: [8]\n",
        planner__headless="_target_: dore.planners.simple.Lookahead\nmax_moves: 9\n",
        planner__headed="# @package planners.headed\n_target_: nowhere.Planner\n",
    )
    write(tmp_path / "two", network__smaller="_target_: dore.learn.networks.MLP\n_partial_: true\nwidths: [4]\n")
    return ["--config-dir", "it's one", "hydra.searchpath=[file://two]"]


def test_a_sweep_of_options_from_two_folders(tmp_path, own):
    tiny = [one for one in TINY if not one.startswith("network.")]
    arguments = [
        "-m",
        *own,
        *tiny,
        "network=small,smaller",
        "hydra/launcher=basic",
        f"hydra.sweep.dir={tmp_path / 's'}",
    ]
    assert run("train", arguments) == 0
    assert len(sweep.results(tmp_path / "s")) == 2
    assert len(list((tmp_path / "s").glob("*/done.json"))) == 2


def test_messages_know_the_own_options(own, capsys):
    for wrong, says in (
        ("layuot=3x6", "layuot: no such key (did you mean layout?); train has:"),
        ("network=smal", "Available options in 'network': cells conv dueling mlp relations small smaller"),
        ("network=3", "network: got 3, want one of its options: cells, conv, dueling, mlp, relations, small"),
        ("network.width=[3]", "network.width: no such key (did you mean widths?)"),
    ):
        more = ["network=small"] if not wrong.startswith("network=") else []
        assert run("train", [*own, *more, wrong]) == 2
        (line,) = complaints(capsys)
        assert says in line


def test_a_file_that_is_no_yaml_is_one_line(own, tmp_path, capsys):
    write(tmp_path / "two", network__broken="widths: [8\nlr: 0\n")
    assert run("train", [*own, *TINY, "network=broken", f"run_dir={tmp_path / 'run'}"]) == 2
    (line,) = complaints(capsys)
    assert "broken.yaml" in line
    assert "line 2" in line
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("planner", ["headless", "[exact,headless]"])
def test_a_planner_without_a_package(own, tmp_path, planner):
    out = tmp_path / "rows"
    assert run("evaluate", [*own, *SCENE, f"planner={planner}", "limit=2", f"run_dir={out}"]) == 0
    assert "headless,2," in (out / "rows.csv").read_text(encoding="utf-8")


def test_planners_without_a_package_in_a_sweep_have_keys_of_their_own(own, tmp_path):
    write(tmp_path / "two", planner__bold="_target_: dore.planners.simple.Lookahead\nmax_moves: 1\n")
    folder = f"hydra.sweep.dir={tmp_path / 's'}"
    arguments = ["-m", *own, *SCENE, "planner=headless,bold", "limit=2", "hydra/launcher=basic", folder]
    assert run("evaluate", arguments) == 0
    assert len(list((tmp_path / "s").glob("*/rows.csv"))) == 2


def test_a_launchers_worker_can_register_hydras_own_files_again():
    own_parts.files_without_package()
    SourcesRegistry.instance().register(file_config_source.FileConfigSource)  # Refused under another name.
    assert SourcesRegistry.instance().types["file"] is own_parts.FileConfigSource


def test_a_planner_whose_keys_go_elsewhere_is_not_left_out(own, tmp_path, capsys):
    write(tmp_path / "two", planner__lost="# @package planner.lost\n_target_: dore.planners.simple.Lookahead\n")
    assert run("evaluate", [*own, *SCENE, "planner=[exact,lost]"]) == 2
    assert "dore-evaluate: planner: got exact, lost, of which 1 can be used; want" in capsys.readouterr().err


def test_a_typo_beside_a_list_of_planners_names_that_planners_keys(own, capsys):
    assert run("evaluate", [*own, *SCENE, "planner=[exact,headless]", "planners.exact.max_second=1"]) == 2
    assert "planners.exact.max_second: no such key (did you mean max_seconds?)" in capsys.readouterr().err


def test_a_class_that_is_not_found(own, tmp_path, capsys):
    (tmp_path / "half.py").write_text("import nowhere_to_be_found\n", encoding="utf-8")
    wanted = "; want a class of a module that is installed, in the current folder, or on PYTHONPATH\n"
    for target, why in (
        ("nowhere.Planner", "No module named 'nowhere'"),
        ("half.Planner", "No module named 'nowhere_to_be_found'"),
        ("dore.planners.exact.Exakt", "dore.planners.exact has no Exakt"),
    ):
        assert run("evaluate", [*own, *SCENE, "planner=headed", f"planners.headed._target_={target}"]) == 2
        assert capsys.readouterr().err == f"dore-evaluate: planners.headed._target_: {target}: {why}{wanted}"


def test_a_name_that_the_package_has_too_is_refused(own, tmp_path, capsys):
    write(tmp_path / "two", layout__3x6="rows: 4\n")
    assert run("plan", [*own, *SCENE]) == 2
    assert "two/layout/3x6.yaml: the package has layout/3x6 too, which comes first; want" in capsys.readouterr().err


def test_an_own_networks_arguments_are_named_as_its_own(own, capsys):
    assert run("train", [*TINY, "+network.depth=3"]) == 2
    assert complaints(capsys) == ["dore-train: network: got an unexpected keyword argument 'depth'"]


def test_an_arm_moves_no_cells_that_are_given(tmp_path, own, capsys):
    cells = "[[0.56,0.06],[0.56,-0.06],[0.68,0.06],[0.68,-0.06],[0.8,0.06],[0.8,-0.06]]"
    write(tmp_path / "two", layout__six=f"_target_: dore.world.layout.Layout\ncell_m: 0.12\ncells: {cells}\n")
    arguments = [*own, "layout=six", "reach=panda_slim", "instances=z3-5", "planner=exact"]
    assert run("plan", [*arguments, "instances.min_obstacles=1", "instances.max_obstacles=3", "out=plan.json"]) == 0
    assert "0.56" in (tmp_path / "plan.json").read_text(encoding="utf-8")
    assert run("plan", [*arguments, "layout.front_m=0.6"]) == 2
    assert "layout.front_m: got 0.6, want none: layout.cells say" in capsys.readouterr().err
