"""How a motion, a move or a whole execution ended."""

from __future__ import annotations

from enum import StrEnum


class Outcome(StrEnum):
    """Named ends. The first is the only good one; the next two are refusals, by the rehearsal of what comes next."""

    DONE = "done"
    OUT_OF_REACH = "out_of_reach"
    """Refused: the arm cannot take a pose of a lane, on its branch and within its limits."""
    BLOCKED = "blocked"
    """Refused: the arm, or what it carries, would touch something."""
    WORLD_CHANGED = "world_changed"
    """Before a move, an object does not stand in the cell where the plan has it."""
    MISSED_GRASP = "missed_grasp"
    """The fingers closed and lifted, and the object is not between them."""
    DROPPED = "dropped"
    """The object was held and is no longer."""
    SLIPPED = "slipped"
    """The object is still held, but no longer where it was grasped."""
    TOPPLED = "toppled"
    """An object no longer stands upright."""
    PUSHED = "pushed"
    """An object that was not moved on purpose stands further from its place than allowed."""
    MISPLACED = "misplaced"
    """The moved object stands outside its cell."""
    INCOMPLETE = "incomplete"
    """Every motion ended well, and yet the task's own conditions are not all met."""
