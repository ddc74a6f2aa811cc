"""--help, --version and the command `dore`: answered from the config files, before anything slow is loaded."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import dore
from dore.app import usage
from dore.files import conf_dir


def said(*words: str, cwd: Path | None = None) -> tuple[int, str, str]:
    done = subprocess.run([sys.executable, "-m", "dore", *words], cwd=cwd, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("command", usage.COMMANDS)
def test_a_manual_has_every_key_with_its_comment_and_the_exit_codes(command):
    text = usage.manual(command)
    assert text.startswith(f"dore-{command}: ")
    assert f"  dore-{command} " in text, "an example"
    assert "Exit codes: 0" in text
    body = (conf_dir() / f"{command}.yaml").read_text(encoding="utf-8").split("_self_\n")[-1]
    for line in (one for one in body.splitlines() if one and not one.startswith("  - ")):
        assert f"  {line}" in text


def test_a_manual_lists_its_own_groups_only():
    text = usage.manual("plan")
    (line,) = [line for line in text.splitlines() if line.startswith("  planner ")]
    assert {"exact,", "learned,", "mcts,", "[exact]"} <= set(line.split())
    assert "optimizer" not in text
    assert "experiment     " in usage.manual("train")
    assert "paper/single" in usage.manual("train")


def test_the_commands_of_dore():
    assert said("--version") == (0, f"dore {dore.__version__}\n", "")
    assert said("plan", "--version") == (0, f"dore {dore.__version__}\n", "")
    code, text, _ = said()
    assert code == 0
    assert all(f"dore {command}" in text for command in usage.COMMANDS)
    code, _, error = said("plans")
    assert (code, error.count("\n")) == (2, 1)
    assert "dore: plans: no such command (did you mean plan?)" in error


def test_help_and_bad_input_are_answered_before_torch_is_loaded(tmp_path):
    ask = "try: cli.{}()\nfinally: print('torch' in sys.modules)"
    code = "import sys\nfrom dore.app import cli\nsys.argv = ['dore-x', *{}]\n" + ask
    for folder, config in (("full", ""), ("kept", "limit: 20\nplanners: {exact: {}}\n")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "config.yaml").write_text(config or "- 1\n")
    for command, words, answer in (
        ("train", ["--help"], None),
        ("plan", ["scene=no.json"], "no.json: no such file"),
        ("plan", ["scene=fgi1"], "fgi1: no such file (did you mean fig1?)"),
        ("execute", ["plan=no.json"], "no.json: no such file"),
        ("execute", [], "plan, scene: want one of them: a plan file, or a scene file or random"),
        ("train", ["existing=maybe"], "existing: got 'maybe', want refuse or continue"),
        ("train", ["run_dir=full"], "run_dir: full exists already, want a new one (or resume=full)"),
        ("execute", ["plan=fig7", "run_dir=full"], "run_dir: full exists already, want a new one"),
        ("train", ["resume=none"], "resume: none is no run folder, it has no config.yaml"),
        ("evaluate", ["resume=full"], "full/config.yaml: damaged or cut off, it has no keys"),
        ("evaluate", ["resume=kept", "limit=3"], "resume: limit=3 cannot be changed in kept, where it is 20"),
        (
            *("evaluate", ["resume=kept", "planner=guided"]),
            "resume: planner=guided cannot be changed in kept, where it has exact",
        ),
    ):
        done = subprocess.run(
            [sys.executable, "-c", code.format(words, command)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.stdout.endswith("False\n")
        assert done.stderr == ("" if answer is None else f"dore-{command}: {answer}\n")


def test_shipped_scenes_have_names(tmp_path):
    code, text, _ = said("plan", "scene=fig1", "out=plan.json", cwd=tmp_path)
    assert code == 0
    assert "solved by exact" in text
    assert "7 moves" in text
    assert (tmp_path / "plan.json").is_file()
    (tmp_path / "fig7").write_text("{}", encoding="utf-8")
    code, _, error = said("plan", "scene=fig7", cwd=tmp_path)
    assert code == 2, "a file of the user's comes first"
    assert error.startswith("dore-plan: fig7: format")
