"""The commands: what they leave, and one clear line with exit code 2 for what a user gets wrong."""

from __future__ import annotations

import csv
import json

import pytest

from dore.world.files import read_plan
from tests.commands import TINY, complaints, run


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A tiny trained model's run folder."""
    folder = tmp_path_factory.mktemp("model") / "run"
    assert run("train", [*TINY, f"run_dir={folder}"]) == 0
    return folder


def said(capsys) -> str:
    """The one line on stderr."""
    lines = [line for line in capsys.readouterr().err.splitlines() if "|" not in line and line.strip()]
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["agent=foo"], "Available options in 'agent': sequential single"),
        (["agnt=single"], "agnt: no such key (did you mean agent?); train has: layout, reach"),
        (["agent.gama=1"], "agent.gama: no such key (did you mean gamma?); agent has: encoding"),
        (["++agent.foo=1"], "agent: got an unexpected keyword argument 'foo'"),
        (["agent.gamma=["], "no viable alternative"),
        (["agent.gamma=abc"], "agent.gamma: got 'abc', want a finite number"),
        (["layout.rows=0"], "layout.rows: got 0, want a whole number of 1 or more"),
        (["layout.cols=2.5"], "layout.cols: got 2.5"),
        (["layout.cell_m=.nan"], "layout.cell_m: got"),
        (["layout.rows=100"], "layout.rows: 100 rows of 0.12 m reach behind the base"),
        (["reach.clearance_m=0"], "reach.clearance_m: got 0"),
        (["instances.max_obstacles=18"], "18 obstacles and a target do not fit on 18 cells"),
        (["instances.min_obstacles=8"], "instances.min_obstacles: 8 is above max_obstacles 7"),
        (["instances.validation_size=1000000", "layout=5x5", "layout.rows=2"], "asked for 1000000 different ones"),
        (["network=conv", "network.blocks=0"], "network.blocks: got 0"),
        (["optimizer.lr=-1"], "optimizer.lr: got -1, want a finite number above 0 and at most 10"),
        (["buffer.storage.max_size=0"], "buffer.storage.max_size: got 0"),
        (["device=cuda:99"], "device: 'cuda:99' is not on this machine"),
        (["device=gpu9"], "device: got 'gpu9'"),
        (["threads=0"], "threads: got 0"),
        (["ipt.batch_size=6000"], "ipt.batch_size: 6000 instances from a validation split of 5000"),
        (["resume=/nowhere"], "resume: /nowhere is no run folder"),
        (["agent.gama=1", "agent.foo=2"], "agent.gama: no such key"),
        (["agent.double=abc"], "agent.double: got 'abc', want true or false"),
        (["agent.symmetry=maybe"], "agent.symmetry: got 'maybe'"),
        (["agent=single", "agent.n_slots=2"], "agent.n_slots: 2 is below the 7 obstacles that instances may"),
        (["agent=single", "instances=dense"], "agent.n_slots: not given, and there is no instances.max_obstacles"),
        (["agent=single", "instances=dense", "agent.n_slots=9"], "agent.n_slots: 9 is below the 10 obstacles"),
        (["network.widths=5"], "network.widths: got 5, want a list"),
        (["buffer.storage.max_size=1000"], "learning_starts: 2000 is more than buffer.storage.max_size 1000 holds"),
        (["log_every=0"], "log_every: got 0"),
        (["existing=maybe"], "existing: got 'maybe', want refuse or continue"),
        (["buffer.storage.max_size=1000000000000"], "buffer.storage.max_size: 1000000000000 takes more memory"),
        (["env.num_envs=1000000000000"], "env.num_envs: got 1000000000000, want 100000 at most"),
        (["checkpoint_minutes=-1"], "checkpoint_minutes: got -1"),
        (["seed=100000000000000000000"], "seed: got 100000000000000000000, want 4294967295 at most"),
        (["ipt.seed=abc"], "ipt.seed: got 'abc'"),
        (["device=null"], "device: got None"),
        (["layout.rows=100", "layout.cols=100"], "want 1024 at most"),
        (["reach.n_sectors=100000"], "reach.n_sectors: got 100000, want 720 at most"),
    ],
)
def test_bad_training_config(tmp_path, capsys, overrides, says):
    assert run("train", [*overrides, f"run_dir={tmp_path / 'run'}"]) == 2
    assert says in said(capsys)
    assert not (tmp_path / "run").exists(), "nothing half-written"


def test_a_run_folder_is_not_written_over(model, capsys):
    before = (model / "metrics.csv").read_bytes()
    assert run("train", [*TINY, f"run_dir={model}"]) == 2
    assert f"run_dir: {model} exists already" in said(capsys)
    assert (model / "metrics.csv").read_bytes() == before


def test_resume_refuses_other_changes_and_damaged_checkpoints(model, tmp_path, capsys):
    assert run("train", [f"resume={model}", "agent=single"]) == 2
    assert "agent=single cannot be changed" in said(capsys)
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("config.yaml", "checkpoint.pt"):
        data = (model / name).read_bytes()
        (copy / name).write_bytes(data if name == "config.yaml" else data[: len(data) // 2])
    assert run("train", [f"resume={copy}"]) == 2
    assert "checkpoint.pt: cut off or damaged" in said(capsys)


def test_a_checkpoint_of_another_layout(model, tmp_path, capsys):
    other = tmp_path / "other"
    assert run("train", [*TINY, "layout.cols=4", f"run_dir={other}"]) == 0
    capsys.readouterr()
    (other / "checkpoint.pt").write_bytes((model / "checkpoint.pt").read_bytes())
    assert run("train", [f"resume={other}", "training.max_episodes=300"]) == 2
    assert "checkpoint.pt was started with layout.cols=3, not 4" in said(capsys)


@pytest.mark.parametrize("text", ["a: [", "", "seed: 1", "\x00"])
def test_a_damaged_config(tmp_path, capsys, text):
    (tmp_path / "config.yaml").write_text(text)
    assert run("train", [f"resume={tmp_path}"]) == 2
    assert "config.yaml: damaged" in said(capsys)


def test_a_damaged_model(model, tmp_path, capsys):
    data = (model / "model.safetensors").read_bytes()
    for old, new in ((b'\\"agent\\"', b'\\"agenx\\"'), (b'\\"layout\\"', b'\\\\layout\\"')):
        assert old in data
        (tmp_path / "m.safetensors").write_bytes(data.replace(old, new, 1))
        assert run("evaluate", [f"model={tmp_path / 'm.safetensors'}", f"run_dir={tmp_path / 'e'}"]) == 2
        said(capsys)


def test_a_run_that_cannot_start_leaves_its_name_free(tmp_path, capsys):
    assert run("train", [*TINY, "logger=wandb", f"run_dir={tmp_path / 'run'}"]) == 2
    said(capsys)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("command", "overrides", "says"),
    [
        ("train", ["run_dir=null"], "run_dir: got None, want a path"),
        ("plan", ["out=null"], "out: got None, want a path"),
        ("plan", ["scene=null"], "scene: got None, want a path"),
        ("plan", ["model=5"], "model: got 5, want a path"),
        ("plan", ["scene=fig7", "seed=5"], "seed=5: has no effect on scene=fig7, want scene=random"),
        ("plan", ["scene=fig7", "layout=6x6"], "layout=6x6: has no effect on scene=fig7, want scene=random"),
        ("execute", ["scene=random", "model={}"], "model: got {}, want a path"),
        ("execute", ["plan=5"], "plan: got 5, want a path"),
        ("execute", ["plan=fig7", "seed=5000000000"], "seed: got 5000000000"),
        ("execute", ["plan=/no/plan.json"], "/no/plan.json: no such file"),
        ("execute", ["plan=fig7", "video=on"], "video: got 'on', want auto or off"),
    ],
)
def test_missing_values(model, capsys, command, overrides, says):
    more = [f"model={model}"] if command == "plan" and not overrides[0].startswith("model=") else []
    assert run(command, [*(TINY if command == "train" else ()), *more, *overrides]) == 2
    assert says in said(capsys)


def test_a_disk_that_refuses(model, capsys):
    assert run("plan", [f"model={model}", "out=/proc/plan.json"]) == 2
    assert "/proc" in said(capsys)


def test_a_full_disk(model, tmp_path, capsys, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    assert run("plan", [f"model={model}", f"out={tmp_path / 'plan.json'}"]) == 2
    assert "plan.json: No space left on device" in said(capsys)
    assert list(tmp_path.iterdir()) == []


def test_evaluate_writes_rows_and_prints_a_table(model, tmp_path, capsys):
    assert run("evaluate", [f"model={model}", f"run_dir={tmp_path / 'e'}"]) == 0
    printed = capsys.readouterr().out
    with open(tmp_path / "e" / "rows.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["planner"] for row in rows} == {"learned", "straight_line"}
    assert len(rows) == 40
    for word in ("learned", "straight_line", "p99 ms", "rows.csv is in"):
        assert word in printed


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["planner=nobody"], "Could not find 'planner/nobody'"),
        (["planner=[exact,nobody]"], "planner: got nobody, want one of its options: backtracking, beam, exact"),
        (["split=train"], "split: got 'train', want test or validation"),
        (["timing=x"], "timing: got 'x', want one of single, batched"),
        (["limit=0"], "limit: got 0"),
        (["limit=21"], "limit: got 21, want 20 at most"),
        (["layout=6x6"], "this one is {'rows': 6, 'cols': 6"),
        (["planner.learned.max_moves=0"], "no such key"),
        (["planners.learned.max_moves=0"], "max_moves: got 0"),
    ],
)
def test_bad_evaluate_config(model, tmp_path, capsys, overrides, says):
    assert run("evaluate", [f"model={model}", f"run_dir={tmp_path / 'e'}", *overrides]) == 2
    assert says in said(capsys)
    assert not (tmp_path / "e").exists()


def test_evaluate_without_a_model_takes_the_one_in_the_package(tmp_path, capsys):
    small = ["limit=10"]
    assert run("evaluate", [*small, f"run_dir={tmp_path / 'e'}"]) == 0
    world = ["layout=3x6", "reach=wide_hand", "instances=z3-5"]
    assert run("evaluate", [*world, *small, "planner=straight_line", f"run_dir={tmp_path / 'f'}"]) == 0


def test_plan_writes_a_plan_that_replays(model, tmp_path, capsys):
    out = tmp_path / "plan.json"
    code = run("plan", [f"model={model}", f"out={out}", "seed=3"])
    assert code in (0, 4)
    file = read_plan(out)
    assert (code == 0) == (file.plan.status == "solved")
    assert out.with_suffix(".png").exists()
    assert str(file.plan.status) in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"obstacles": [2, 2]}, "two objects on cell 2"),
        ({"obstacles": [2, 99]}, "scene.obstacles: id 99, want 1 to 9"),
        ({"target": 2}, "cell 2 holds an obstacle"),
        ({"layout": {"rows": 0, "cols": 3, "cell_m": 0.12}}, "layout.rows: got 0"),
        ({"format": "x"}, "format 'x', want dore-scene/1"),
    ],
)
def test_bad_scenes(model, tmp_path, capsys, change, says):
    scene = {
        "format": "dore-scene/1",
        "layout": {"rows": 3, "cols": 3, "cell_m": 0.12},
        "obstacles": [2, 5],
        "target": 8,
    }
    (tmp_path / "scene.json").write_text(json.dumps(scene | change))
    assert run("plan", [f"model={model}", f"scene={tmp_path / 'scene.json'}", f"out={tmp_path / 'plan.json'}"]) == 2
    assert says in said(capsys)
    assert not (tmp_path / "plan.json").exists()


def test_a_group_of_another_command_is_refused_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("train", ["planner=exact"]) == 2
    assert complaints(capsys) == ["dore-train: planner: dore-train has no such key"]
