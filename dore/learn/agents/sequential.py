"""The sequentially separated DQN (paper, section 5.2): one network picks, one places after the lift."""

from __future__ import annotations

from typing import Any, Literal

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor

from dore.errors import InputError, one_of
from dore.learn import keys
from dore.learn.agents.common import Agent, Greedy, Hyperparameters, never_empty
from dore.learn.features import mirrored_by_chance, n_planes
from dore.learn.losses import Chain, SequentialLoss
from dore.learn.networks import HeadOf, NetworkFactory
from dore.learn.q_loss import FailedPick
from dore.world.reach import Reach
from dore.world.rules import accessibility, going_back, lift

Trunk = Literal["separate", "shared"]
HEADS = ("pick", "place")
_SEEN_PICK, _SEEN_PLACE = ("pick", keys.OBSERVATION), ("place", keys.OBSERVATION)


class Sequential(Agent):
    """Q_p on [s, m_p] chooses the obstacle; it is lifted; Q_l on [s', m_l] chooses its new cell.

    The lift is part of the policy, so that one environment step is one pick-and-place. `mask_mode=legal` also rules out
    going back to a visited board.

    Args:
        network: makes the pick and the place network, or the one that both share.
        trunk: `separate`: a network each, as in the paper; `shared`: one network with two heads, whose input also
            says which of them is wanted.
        chain, failed_pick: see `dore.learn.losses.SequentialLoss`.
        reach, hyperparameters: see `Agent` and `Hyperparameters`.

    Raises:
        InputError: a hyperparameter outside its domain, or symmetry on a layout without a mirror.
    """

    def __init__(
        self,
        reach: Reach,
        network: NetworkFactory,
        chain: Chain,
        failed_pick: FailedPick = "skip",  # Model files of version 0.1 do not name it,
        trunk: Trunk = "separate",  # nor those up to 0.2 this.
        **hyperparameters: Any,
    ) -> None:
        shared = Hyperparameters(**hyperparameters)
        super().__init__(reach, shared)
        one_of("agent.chain", chain, Chain)
        one_of("agent.failed_pick", failed_pick, FailedPick)
        one_of("agent.trunk", trunk, Trunk)
        if shared.n_steps > 1 and chain == "literal":
            raise InputError(f"agent.n_steps: got {shared.n_steps}, want 1 with agent.chain=literal")
        self.chain, self.trunk = chain, trunk
        planes, cells = n_planes(self.encoding, with_mask=True), reach.n_cells
        if trunk == "shared":
            made = {"both": network(reach=reach, n_planes=planes + 1, n_outputs=(cells, cells))}
        else:
            made = {head: network(reach=reach, n_planes=planes, n_outputs=(cells,)) for head in HEADS}
        self.networks = torch.nn.ModuleDict(made).to(reach.device)
        modules = self._q_modules()
        self.loss = SequentialLoss(
            **modules,
            gamma=shared.gamma,
            double=shared.double,
            mask_mode=self.mask_mode,
            chain=chain,
            failed_pick=failed_pick,
            loss_function=shared.loss_function,
        )
        self._make_policy(modules)
        rewards = (keys.PLACE_REWARD,) if chain == "natural" else (keys.PLACE_REWARD, keys.PICK_REWARD)
        following = keys.below("next", keys.BOARD, keys.TERMINATED, *rewards)
        self.stored = (keys.BOARD, keys.TARGET, keys.PICK, keys.PLACE, *following)

    def _head(self, name: str) -> torch.nn.Module:
        """Q_p or Q_l: Float[B, C, G] -> (Float[B, G],)."""
        return self.networks[name] if self.trunk == "separate" else HeadOf(self.networks["both"], HEADS.index(name))

    def _q_modules(self) -> dict[str, TensorDictModule]:
        """Q_p and Q_l over TensorDicts."""
        return {
            "pick": TensorDictModule(self._head("pick"), in_keys=[_SEEN_PICK], out_keys=[keys.PICK_VALUE]),
            "place": TensorDictModule(self._head("place"), in_keys=[_SEEN_PLACE], out_keys=[keys.PLACE_VALUE]),
        }

    def _make_policy(self, modules: dict[str, TensorDictModule]) -> None:
        """Pick, lift, place on this reach's cells."""
        cells, mode, device = self.reach.n_cells, self.mask_mode, self.reach.device
        before_pick = TensorDictModule(
            self._see_pick,
            in_keys=[keys.BOARD, keys.TARGET, keys.PICKABLE, keys.LEGAL_PICK],
            out_keys=[_SEEN_PICK, keys.PICK_MASK],
        )
        before_place = TensorDictModule(
            self._see_place,
            in_keys=[keys.BOARD, keys.TARGET, keys.VISITED, keys.PICK],
            out_keys=[_SEEN_PLACE, keys.PLACE_MASK],
        )
        pick = Greedy(keys.PICK, keys.PICK_VALUE, keys.PICK_MASK, cells, mode, device)
        place = Greedy(keys.PLACE, keys.PLACE_VALUE, keys.PLACE_MASK, cells, mode, device)
        self._set_policy(before_pick, modules["pick"], pick, before_place, modules["place"], place)

    def pick_observation(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, C, G]: what Q_p sees of Int64[N, W] boards: [s, m_p]."""
        return self._observe(board, target, accessibility(self.reach, board, target).pick)

    def place_observation(self, lifted: Tensor, target: Tensor) -> Tensor:
        """Float[N, C, G]: what Q_l sees of Int64[N, W] boards without the lifted obstacle: [s', m_l]."""
        return self._observe(lifted, target, accessibility(self.reach, lifted, target).place)

    def pick_values(self, board: Tensor, target: Tensor) -> Tensor:
        """Float[N, G]: Q_p of each cell on Int64[N, W] boards; of one that cannot be picked it means nothing."""
        values: Tensor = self._head("pick")(self.pick_observation(board, target))[0]
        return values

    def move_values(self, board: Tensor, target: Tensor, pick: Tensor) -> Tensor:
        """Float[N, G]: Q_l of each cell for the obstacle on Int64[N] cells of Int64[N, W] boards, once it is lifted."""
        values: Tensor = self._head("place")(self.place_observation(lift(board, pick), target))[0]
        return values

    def decode(self, batch: TensorDictBase) -> TensorDict:
        """Stored transitions, with observations and masks of the pick, the lift, the place and what follows."""
        board, target, following = batch[keys.BOARD], batch[keys.TARGET], batch["next", keys.BOARD]
        pick, place = batch[keys.PICK], batch[keys.PLACE]
        if self.symmetry:
            (board, following), (target, pick, place), _ = mirrored_by_chance(
                self.reach, [board, following], [target, pick, place]
            )
        lifted = lift(board, pick)
        literal = self.chain == "literal"
        decoded = self._entry(board, target, "pick")
        picked = decoded[keys.PICK_MASK].gather(-1, pick[:, None]).squeeze(-1)
        on_lifted = self._entry(lifted, target, *(("pick", "place") if literal else ("place",)))
        after = self._entry(following, target, "place" if literal else "pick")
        after.update(batch["next"].select(keys.TERMINATED, keys.PLACE_REWARD, keys.PICK_REWARD, strict=False))
        after.update(batch.select(keys.STEPS, strict=False))
        decoded.update(
            {"place": on_lifted["place"], keys.PICK: pick, keys.PLACE: place, keys.PICKED: picked, "next": after}
        )
        if literal:
            ends = on_lifted["opened"] | ~picked
            decoded[keys.LIFTED] = on_lifted.select("pick").update({keys.TERMINATED: ends[:, None]})
        return decoded

    def _entry(self, board: Tensor, target: Tensor, *heads: str) -> TensorDict:
        """The observations and masks of these heads on a board, and whether its target is accessible."""
        found = accessibility(self.reach, board, target)
        masks = {"pick": found.pick, "place": found.place}
        entries: dict[str, Any] = {
            head: {keys.OBSERVATION: self._observe(board, target, masks[head]), "mask": masks[head]} for head in heads
        }
        return TensorDict({**entries, "opened": found.target}, batch_size=board.shape[:1])

    def _see_pick(self, board: Tensor, target: Tensor, pickable: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        """The pick network's observation [s, m_p], and what it may choose."""
        mask = legal if self.mask_mode == "legal" else pickable
        return self._observe(board, target, pickable), never_empty(mask)

    def _see_place(self, board: Tensor, target: Tensor, visited: Tensor, pick: Tensor) -> tuple[Tensor, Tensor]:
        """The place network's observation [s', m_l] after the lift, and what it may choose."""
        lifted = lift(board, pick)
        mask = accessibility(self.reach, lifted, target).place
        seen = self._observe(lifted, target, mask)
        if self.mask_mode == "legal":
            mask = mask & ~going_back(lifted, visited, self.reach.n_cells)
        return seen, never_empty(mask)
