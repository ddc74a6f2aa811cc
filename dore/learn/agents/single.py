"""The single DQN (paper, section 5.1): one network, one head for what to pick, one for where to place."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor

from dore.errors import one_of, whole
from dore.learn import keys
from dore.learn.agents.common import Agent, Greedy, Hyperparameters, never_empty
from dore.learn.features import mirrored_by_chance, n_planes, slot_of, slots
from dore.learn.losses import Heads, SingleLoss
from dore.learn.networks import NetworkFactory
from dore.world import board as boards
from dore.world.reach import Reach
from dore.world.rules import accessibility, legal_moves, legal_places

_SEEN = ("pick", keys.OBSERVATION)
_SLOT_CELLS = ("pick", "slot_cells")


class Single(Agent):
    """Q1 on the Z slots of obstacles, ascending by cell, and Q2 on the G cells, of one trunk (eqs. 8-9).

    A slot that holds no obstacle is ruled out, or, in the literal form, a pick fail. `mask_mode=legal`: only legal
    slots and, given the slot, legal places are chosen; `literal`: the plain argmax of eqs. 8-9, failures and all. All
    encodings but the paper's `state` also show m_p, which the paper gives only to the separated networks.

    Args:
        network: makes the network.
        n_slots: Z, the most obstacles that the pick head can distinguish.
        heads: see `dore.learn.losses.SingleLoss`.
        reach, hyperparameters: see `Agent` and `Hyperparameters`.

    Raises:
        InputError: a hyperparameter outside its domain, or symmetry on a layout without a mirror.
    """

    def __init__(
        self, reach: Reach, network: NetworkFactory, n_slots: int, heads: Heads, **hyperparameters: Any
    ) -> None:
        shared = Hyperparameters(**hyperparameters)
        super().__init__(reach, shared)
        one_of("agent.heads", heads, Heads)
        self.n_slots = whole("agent.n_slots", n_slots, 1)
        planes = n_planes(self.encoding, with_mask=self.encoding != "state")
        made = network(reach=reach, n_planes=planes, n_outputs=(n_slots, reach.n_cells))
        self.networks = torch.nn.ModuleDict({"pick_place": made}).to(reach.device)
        modules = self._q_modules()
        self._make_policy(modules)
        self.loss = SingleLoss(
            modules["network"], shared.gamma, shared.double, self.mask_mode, heads, shared.loss_function
        )
        following = keys.below("next", keys.BOARD, keys.TERMINATED, keys.PLACE_REWARD)
        self.stored = (keys.BOARD, keys.TARGET, keys.SLOT, keys.PLACE, *following)

    def _q_modules(self) -> dict[str, TensorDictModule]:
        """Q1 and Q2 over TensorDicts."""
        network, values = self.networks["pick_place"], [keys.SLOT_VALUE, keys.PLACE_VALUE]
        return {"network": TensorDictModule(network, in_keys=[_SEEN], out_keys=values)}

    def _make_policy(self, modules: dict[str, TensorDictModule]) -> None:
        """Choose a slot, then the cell for its obstacle."""
        mode, device = self.mask_mode, self.reach.device
        before_pick = TensorDictModule(
            self._see_slots,
            in_keys=[keys.BOARD, keys.TARGET, keys.PICKABLE, keys.LEGAL_PICK],
            out_keys=[_SEEN, _SLOT_CELLS, keys.SLOT_MASK],
        )
        before_place = TensorDictModule(
            self._take_slot,
            in_keys=[keys.BOARD, keys.TARGET, keys.VISITED, _SLOT_CELLS, keys.SLOT],
            out_keys=[keys.PICK, keys.PLACE_MASK],
        )
        pick = Greedy(keys.SLOT, keys.SLOT_VALUE, keys.SLOT_MASK, self.n_slots, mode, device)
        place = Greedy(keys.PLACE, keys.PLACE_VALUE, keys.PLACE_MASK, self.reach.n_cells, mode, device)
        self._set_policy(before_pick, modules["network"], pick, before_place, place)

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]: Q1 of the obstacle on each cell; one past the last slot is valued as the last one."""
        seen = self._observe(board, target, accessibility(self.reach, board, target).pick)
        lower = boards.unpack(board, self.reach.n_cells).long().cumsum(-1) - 1
        values: Tensor = self.networks["pick_place"](seen)[0].gather(1, lower.clamp(0, self.n_slots - 1))
        return values

    def move_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: the mean of Q1 of an obstacle and Q2 of each cell, for Int64[N] picks on Int64[N, W] boards.

        An obstacle past the last slot is valued as the last one."""
        slot = slot_of(board, pick, self.reach.n_cells).clamp_max(self.n_slots - 1)
        seen = self._observe(board, target, accessibility(self.reach, board, target).pick)
        of_slot, of_place = self.networks["pick_place"](seen)
        values: Tensor = (of_slot.gather(1, slot[:, None]) + of_place) / 2
        return values

    def decode(self, batch: TensorDictBase) -> TensorDict:
        """Stored transitions, with observations and masks of this board and the next."""
        board, target, following = batch[keys.BOARD], batch[keys.TARGET], batch["next", keys.BOARD]
        slot, place = batch[keys.SLOT], batch[keys.PLACE]
        if self.symmetry:
            board, following, target, slot, place = self._mirror(board, following, target, slot, place)
        decoded = self._entry(board, target)
        after = self._entry(following, target)
        after.update(batch["next"].select(keys.TERMINATED, keys.PLACE_REWARD))
        after.update(batch.select(keys.STEPS, strict=False))
        return decoded.update({keys.SLOT: slot, keys.PLACE: place, "next": after})

    def _mirror(
        self, board: Tensor, following: Tensor, target: Tensor, slot: Tensor, place: Tensor
    ) -> tuple[Tensor, ...]:
        """Half of the rows mirrored; a mirrored obstacle has another slot."""
        cells, there = slots(board, self.n_slots, self.reach.n_cells)
        pick, held = (of_slot.gather(1, slot[:, None]).squeeze(1) for of_slot in (cells, there))
        (board, following), (target, pick, place), _ = mirrored_by_chance(
            self.reach, [board, following], [target, pick, place]
        )
        mirrored_slot = slot_of(board, pick, self.reach.n_cells).clamp_max(self.n_slots - 1)
        return board, following, target, torch.where(held, mirrored_slot, slot), place

    def _entry(self, board: Tensor, target: Tensor) -> TensorDict:
        """What the network sees of a board, and the masks of its two heads."""
        legal = legal_moves(self.reach, board, target, board[:, None])
        seen = self._observe(board, target, legal.pickable)
        _, slot_mask = self._slots(board, target, legal.pick)
        # Which pick a place goes with is not known here: a place counts that is open whatever is lifted.
        place_mask = legal.place if self.mask_mode == "legal" else torch.ones_like(legal.place)
        return TensorDict(
            {"pick": {keys.OBSERVATION: seen, "slot_mask": slot_mask}, "place": {"mask": place_mask}},
            batch_size=board.shape[:1],
        )

    def _see_slots(
        self, board: Tensor, target: Tensor, pickable: Tensor, legal: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """The observation, the cell of each slot, and which slots may be chosen: at least one in every row."""
        cells, slot_mask = self._slots(board, target, legal)
        return self._observe(board, target, pickable), cells, never_empty(slot_mask)

    def _observe(self, board: Tensor, target: Tensor, mask: Tensor | None) -> Tensor:
        """Float[B, C, G]: the board, and m_p unless the encoding is the paper's."""
        return super()._observe(board, target, None if self.encoding == "state" else mask)

    def _slots(self, board: Tensor, target: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        """Int64[B, Z]: the cell of each slot, and Bool[B, Z]: which slots may be chosen."""
        cells, there = slots(board, self.n_slots, self.reach.n_cells)
        # No obstacle ever stands on the target's cell, so an absent slot is a pick that fails.
        cells = torch.where(there, cells, target[:, None])
        return cells, legal.gather(1, cells) if self.mask_mode == "legal" else torch.ones_like(there)

    def _take_slot(
        self, board: Tensor, target: Tensor, visited: Tensor, cells: Tensor, slot: Tensor
    ) -> tuple[Tensor, Tensor]:
        """The cell of the chosen slot, and where its obstacle may go."""
        pick = cells.gather(1, slot[:, None]).squeeze(1)
        if self.mask_mode == "literal":
            return pick, torch.ones(len(pick), self.reach.n_cells, dtype=torch.bool, device=pick.device)
        return pick, never_empty(legal_places(self.reach, board, target, visited, pick))
