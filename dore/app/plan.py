"""What dore-plan does with a composed config: one scene, planned and drawn."""

from __future__ import annotations

from omegaconf import DictConfig

from dore.app import build, run_folder, scenes
from dore.app.run_folder import folder_of
from dore.errors import ExitCode, InputError, seed_of
from dore.files import check_outputs
from dore.world.files import write_plan
from dore.world.plan import Plan, PlanFile, Status
from dore.world.problem import Problem, cell_id

EXIT_CODES = {
    Status.SOLVED: ExitCode.OK,
    Status.UNSOLVABLE: ExitCode.UNSOLVABLE,
    Status.GAVE_UP: ExitCode.GAVE_UP,
}


def plan_command(cfg: DictConfig) -> int:
    """Plan one scene; write the plan, draw it, and print it; the exit code."""
    build.use_threads(cfg.threads)
    out = folder_of(cfg, "out")
    picture = out.parent / f"{out.stem}.png" if cfg.picture is None else folder_of(cfg, "picture")
    check_outputs(out=out, picture=picture)
    problem = _random(cfg) if cfg.scene == "random" else _given(cfg)
    found = build.planner_of(cfg, problem.reach).plan_one(problem)
    write_plan(out, PlanFile(problem, found))
    _print_plan(found, cell_id(problem.scene.target))
    print(f"plan: {out}", flush=True)
    from dore.draw.boards import draw_plan  # Half of a cold start; the plan does not wait for it.

    draw_plan(problem, found, picture)
    print(f"picture: {picture}")
    return EXIT_CODES[found.status]


def _random(cfg: DictConfig) -> Problem:
    """An instance of the test split."""
    from dore.world.by_optimum import OptimumSplits  # These load torch, which a given scene may not need.
    from dore.world.instances import InstanceSplits, problems_of

    scenes.check_random(cfg)
    world = build.world_of(cfg, build.model_config(cfg))
    reach = build.reach_of(world, cfg.device)
    splits = build.splits_of(world, reach)
    if not isinstance(splits, InstanceSplits | OptimumSplits):
        raise InputError("scene: random draws new instances, these are given ones; want scene=PATH instance=N")
    (problem,) = problems_of(reach, splits.new(reach, "test", seed_of("seed", cfg.seed)).draw(1))
    return problem


def _given(cfg: DictConfig) -> Problem:
    """A scene of the user's, or a row of an evaluation, whose reach is that of the evaluation."""
    for key, change in run_folder.changed_keys().items():
        if key in ("layout", "instances", "seed"):
            raise InputError(f"{change}: has no effect on scene={cfg.scene}, want scene=random")
    scene, evaluation = scenes.given(cfg)
    world = build.world_of(cfg, build.model_config(cfg, ("layout", "reach")) if evaluation is None else evaluation)
    return Problem(scene, build.reach_of(world, cfg.device, scene.layout))


def _print_plan(found: Plan, target_id: int) -> None:
    why = f" ({found.reason})" if found.reason else ""
    moves = f"{len(found.moves)} move{'' if len(found.moves) == 1 else 's'}"
    print(f"{found.status}{why} by {found.planner} in {1000 * found.planning_s:.1f} ms, {moves}")
    for number, move in enumerate(found.moves, 1):
        print(
            f"  {number}. {cell_id(move.pick):>3} to {cell_id(move.place):<3}"
            f"  pick from {move.pick_direction_deg:+.1f} deg, place from {move.place_direction_deg:+.1f} deg"
        )
    if found.target_direction_deg is not None:
        print(f"  then the target on {target_id}, from {found.target_direction_deg:+.1f} deg")
