"""The published planner of this line of work: a shortest path over objects, and the place that blocks fewest."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dore.planners.policy import Policy
from dore.world.board import unpack
from dore.world.episode import Episodes
from dore.world.reach import Reach
from dore.world.rules import legal_places


class RelocationGraph(Policy):
    """Relocates what stands on a shortest path over the graph of mutually reachable objects.

    Source: C. Nam, J. Lee and others, "Fast and resilient manipulation planning for target retrieval in clutter", ICRA
    2020, for what to relocate, and S. Cheong and others, "Where to relocate? Object rearrangement inside cluttered and
    confined environments for robotic manipulation", ICRA 2020, for where. Written from their descriptions, in the
    terms of this world:

    - An object leads to another one (or to the target) if it stands on an approach corridor of that one with no
      other object between them. The robot leads to each object that is accessible and can be put somewhere.
    - The objects on a path of fewest objects from the robot to the target are to be relocated; the first of them goes
      now, and the graph is built again, as the papers do when a scene changes.
    - It goes to the legal place that blocks fewest others: on whose best approach corridors it would stand; of
      equal ones the nearest.

    Args:
        max_moves: gives up after this many.
    """

    name = "relocation_graph"

    def __init__(self, reach: Reach, max_moves: int) -> None:
        super().__init__(reach, max_moves, max_moves, 1e7)
        centres = reach.layout.centres.double()
        self._distance = torch.cdist(centres, centres).numpy()
        table = reach.table
        words = torch.from_numpy(table.corridors.view(np.int64))
        self._corridors = unpack(words, reach.n_cells).numpy()
        self._n_corridors = table.n_corridors

    def choose(self, episodes: Episodes, number: int) -> tuple[Tensor, Tensor]:
        """The first object on the path of each episode, and its place; a legal one where there is no path."""
        board = unpack(episodes.board, self.reach.n_cells).numpy()
        legal, targets = episodes.legal.pick.numpy(), episodes.target.tolist()
        picks = [self.next_object(*one) for one in zip(board, targets, legal, strict=True)]
        pick = torch.tensor(picks, dtype=torch.int64)
        places = legal_places(self.reach, episodes.board, episodes.target, episodes.visited, pick).numpy()
        chosen = [self.place(*one) for one in zip(board, targets, picks, places, strict=True)]
        return pick, torch.tensor(chosen, dtype=torch.int64)

    def next_object(self, board: np.ndarray, target: int, legal: np.ndarray) -> int:
        """The first object on a path of fewest objects; where no path reaches the robot, the first legal pick.

        board, legal: Bool[G], the obstacles, and those of them that can be picked and put somewhere.
        """
        seen, layer = {target}, [target]
        while layer:
            before = [one for cell in layer for one in self._leading_to(cell, board)]
            if ready := [one for one in before if legal[one]]:
                return ready[0]
            layer = [one for one in dict.fromkeys(before) if one not in seen]
            seen.update(layer)
        return int(legal.argmax())

    def _leading_to(self, cell: int, board: np.ndarray) -> list[int]:
        """The objects from which the hand gets to a cell: the nearest one on each of its corridors."""
        found: dict[int, None] = {}
        for corridor in self._corridors[cell, : self._n_corridors[cell]]:
            blocking = np.flatnonzero(corridor & board)
            if len(blocking):
                found[int(blocking[self._distance[cell, blocking].argmin()])] = None
        return list(found)

    def place(self, board: np.ndarray, target: int, pick: int, places: np.ndarray) -> int:
        """The place that blocks fewest others, of Bool[G] legal places."""
        lifted = board.copy()
        lifted[pick] = False
        worse = np.zeros(len(board), np.int64)
        for cell in [target, *np.flatnonzero(lifted)]:
            corridors = self._corridors[cell, : self._n_corridors[cell]]
            if len(corridors):
                blocking = (corridors & lifted).sum(-1)
                worse += corridors[blocking == blocking.min()].all(0)  # It stands on all of the best ones.
        cost = worse + self._distance[pick] / (1 + self._distance.max())
        return int(np.where(places, cost, np.inf).argmin())
