"""The keys of the TensorDicts that pass between environment, agents and buffer, each with its meaning.

B denotes the batch, G the cells, W the words of a board, T the boards an episode remembers.
"""

from __future__ import annotations

from tensordict.utils import NestedKey

Key = tuple[str, ...]

BOARD = "board"
"""Int64[B, W]: the obstacles."""
TARGET = "target"
"""Int64[B]: the target's cell."""
VISITED = "visited"
"""Int64[B, T, W]: the episode's boards so far, the present one included; unused places repeat the first."""
FAILURE = "failure"
"""Int64[B]: a `dore.world.rules.Failure` code."""
LEGAL_PICK: Key = ("pick", "legal")
"""Bool[B, G]: legal picks, of the environment."""
PICKABLE: Key = ("pick", "accessible")
"""Bool[B, G]: m_p (eqs. 11-12), of the environment: obstacles that the hand can get to, whether or not they can be
placed somewhere."""
PICK_MASK: Key = ("pick", "mask")
"""Bool[B, G]: what the pick head may choose; written by the policy, and by `Agent.decode` for the loss."""
PICK: Key = ("pick", "action")
"""Int64[B]: the cell whose obstacle is picked."""
PICK_VALUE: Key = ("pick", "action_value")
"""Float[B, G]: Q_p or Q_1."""
PICK_REWARD: Key = ("pick", "reward")
"""Float[B, 1]: the pick network's reward (section 5.2)."""
PLACE_MASK: Key = ("place", "mask")
"""Bool[B, G]: what the place head may choose; written as PICK_MASK is. The environment has no mask of places, because
none is right before the pick is known."""
PLACE: Key = ("place", "action")
"""Int64[B]: the cell on which it is placed."""
PLACE_VALUE: Key = ("place", "action_value")
"""Float[B, G]: Q_l or Q_2."""
PLACE_REWARD: Key = ("place", "reward")
"""Float[B, 1]: the reward of the whole move."""
TERMINATED = "terminated"
"""Bool[B, 1]: solved, failed, or no legal move left."""
TRUNCATED = "truncated"
"""Bool[B, 1]: the step limit is reached."""
DONE = "done"
"""Bool[B, 1]: either."""
OBSERVATION = "observation"
"""Float[B, C, G]: what a network sees; stands under "pick" and "place"."""
SLOT: Key = ("pick", "slot")
"""Int64[B]: the obstacle's place in the ascending list O of section 5.1 (single DQN)."""
SLOT_MASK: Key = ("pick", "slot_mask")
"""Bool[B, Z]: slots that may be chosen."""
SLOT_VALUE: Key = ("pick", "slot_value")
"""Float[B, Z]: Q_1."""

STEPS = "steps"
"""UInt8[B]: how many moves lie between a stored board and the next one, where returns are of several."""
INDEX = "index"
"""Int64[B]: the place of a drawn transition in a buffer that has priorities."""
WEIGHT = "priority_weight"
"""Float[B]: the weight of a drawn transition in the loss, since draws were not uniform."""
ERROR = "td_error"
"""Float[B, 1]: the squared error of a transition, summed over both heads: its priority from now on."""
PICKED = "picked"
"""Bool[B]: the pick did not fail, so something was placed; of a decoded batch, as the next."""
LIFTED = "lifted"
"""The pick head's observation, mask and `terminated` after the lift: its next state in the literal chain."""


def below(group: str, *names: NestedKey) -> list[NestedKey]:
    """Those keys inside a nested TensorDict."""
    return [(group, name) if isinstance(name, str) else (group, *name) for name in names]
