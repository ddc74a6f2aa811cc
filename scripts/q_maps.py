"""What a network makes of each obstacle, and, once the one that it would pick is lifted, of each cell to place it on.

python -m scripts.q_maps [model=FILE] [out=docs/results/q_values.png]
python -m scripts.q_maps probabilities=true [model=FILE] [out=FILE]
The first draws Q-values on sparse boards; the second the probabilities of a network that was taught by exact search, on
ten objects on 3 x 6 as in the paper's Fig. 1: a first move that is optimal, and two that are not.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from dore.app.front_door import load_model
from dore.draw.style import INK, save_figure
from dore.draw.value_map import ValueMap, draw_map, map_legend, ring
from dore.errors import InputError
from dore.learn.agents.sequential import Sequential
from dore.learn.checkpoint import Q_NETWORK, SHIPPED
from dore.report.panels import panels
from dore.world.generator import Difficulty
from dore.world.instances import InstanceSet, problems_of
from dore.world.labeller import Labeller
from dore.world.problem import Batch, cell_id
from dore.world.rules import legal_moves, legal_places
from scripts.program import run

AMONG = 400
"""Instances among which a board with the wanted optimum is looked for."""
MAX_NODES, MAX_MOVES = 100_000, 30
"""Of the search for the optimum."""


@dataclass(frozen=True)
class Options:
    """model: a run directory or a model file. probabilities: see above. out: the picture."""

    model: Path | None = None
    out: Path | None = None
    probabilities: bool = False


@dataclass(frozen=True)
class Wanted:
    """Which board to draw: the first of the validation split's that needs so many moves.

    about: in the title. right: whether the network's first move is that of a shortest plan; None: either.
    """

    layout: str
    obstacles: int
    optimum: int
    about: str
    reach: str = "wide_hand"
    right: bool | None = None


BOARDS = (
    Wanted("6x6", 7, 1, "an easy one"),
    Wanted("8x8", 13, 3, "a hard one"),
    Wanted("9x9", 16, 2, "a size never seen"),
)


FIG_1 = (
    Wanted("3x6", 10, 8, "right", right=True),
    Wanted("3x6", 10, 8, "wrong", right=False),
    Wanted("3x6", 10, 11, "wrong", right=False),
)


def main(options: Options) -> None:
    """Write the PNG."""
    name, boards = ("probabilities", FIG_1) if options.probabilities else ("q_values", BOARDS)
    model = options.model or (SHIPPED if options.probabilities else Q_NETWORK)
    drawn = [(wanted, maps_of(wanted, model, options.probabilities)) for wanted in boards]
    out = options.out or Path(f"docs/results/{name}.png")
    out.parent.mkdir(parents=True, exist_ok=True)
    draw(out, drawn)
    print(out)


@torch.no_grad()
def maps_of(wanted: Wanted, model: Path, probabilities: bool = False) -> tuple[ValueMap, ValueMap]:
    """The pick network's map, and the place network's after the lift.

    Raises:
        InputError: no such model, one without a pick and a place network, or no such board.
    """
    agent = load_model(model, layout=wanted.layout, reach=wanted.reach)
    if not isinstance(agent, Sequential):
        raise InputError(f"model: {model} has no pick and place network, want one of agent=sequential")
    reach, difficulty = agent.reach, Difficulty(wanted.obstacles, wanted.obstacles)
    instances = InstanceSet.generate(reach, AMONG, difficulty, "validation", seed=0)
    labeller = Labeller(reach, MAX_NODES, MAX_MOVES)
    fewest = labeller.fewest(instances.batch())
    for row in (fewest == wanted.optimum).nonzero().squeeze(-1).tolist():
        maps = _maps(agent, labeller, instances.batch(slice(row, row + 1)), probabilities)
        if wanted.right in (None, all(one.right for one in maps)):
            return maps
    such = "" if wanted.right is None else f", with a first move that is {'right' if wanted.right else 'wrong'}"
    raise InputError(f"{wanted.layout}: none of {AMONG} boards needs {wanted.optimum} moves{such}")


def _maps(agent: Sequential, labeller: Labeller, start: Batch, probabilities: bool) -> tuple[ValueMap, ValueMap]:
    """Both maps of a board."""
    reach, (board, target) = agent.reach, start
    visited, scene = board[:, None], problems_of(reach, start)[0].scene
    best = labeller.label(start).wasted[0] == 0
    shown = _probabilities if probabilities else lambda values, legal: values
    legal = legal_moves(reach, board, target, visited).pick[0]
    pick = ValueMap(scene, shown(agent.pick_values(board, target)[0], legal), legal, best.any(-1), probabilities)
    cell = torch.tensor([pick.choice])
    left = replace(scene, obstacles=tuple(one for one in scene.obstacles if one != pick.choice))
    legal = legal_places(reach, board, target, visited, cell)[0]
    return pick, ValueMap(
        left, shown(agent.move_values(board, target, cell)[0], legal), legal, best[pick.choice], probabilities
    )


def _probabilities(values: Tensor, legal: Tensor) -> Tensor:
    """Float[G]: per cent, of what is legal."""
    return 100 * values.masked_fill(~legal, -torch.inf).softmax(-1)


def draw(path: Path, drawn: Sequence[tuple[Wanted, tuple[ValueMap, ValueMap]]]) -> None:
    """Write the PNG: a column a board, its picks above its places."""
    flat = all(maps[0].scene.layout.n_cells <= 18 for _, maps in drawn)
    figure, places = panels(2 * len(drawn), len(drawn), 4.0, 2.7 if flat else 4.2)
    for column, (wanted, maps) in enumerate(drawn):
        pair = places[column :: len(drawn)]
        size, (pick, place) = wanted.layout.replace("x", " x "), (cell_id(one.choice) for one in maps)
        above = f"{size}, {wanted.about}: optimum {wanted.optimum}\npick {pick}", f"place {pick} on {place}"
        for one, axes, title in zip(maps, pair, above, strict=True):
            axes.set_title(title, fontsize=9, color=INK, pad=4)
            bar = figure.colorbar(draw_map(axes, one), ax=axes, shrink=0.5, pad=0.02, aspect=18)
            bar.ax.tick_params(labelsize=6.5, colors=INK, pad=2)
        pair[1].add_patch(ring(maps[0].scene, maps[0].choice))
    look = {"ncols": 6, "fontsize": 8.5, "frameon": False, "labelcolor": INK}
    figure.legend(handles=map_legend(), loc="outside lower center", **look)
    save_figure(figure, path, dpi=160)


if __name__ == "__main__":
    sys.exit(run(main, Options))
