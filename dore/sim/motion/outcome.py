"""How a motion, a move or a whole execution ended, and the refusal of one."""

from __future__ import annotations

from enum import StrEnum


class Outcome(StrEnum):
    """Named outcomes. The first is the only success."""

    DONE = "done"
    OUT_OF_REACH = "out_of_reach"
    """Refused: the arm cannot follow an approach corridor on its joint branch and within its limits."""
    BLOCKED = "blocked"
    """Refused: the arm, or what it carries, would touch something."""
    OTHER_REACH = "other_reach"
    """Refused: the plan was made for another reach than this arm's."""
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
    NOT_UNDERSTOOD = "not_understood"
    """The camera does not see a board with one target: two objects in a cell, one off the board, none green ..."""
    MISSING = "missing"
    """The camera sees fewer objects than before: one has left the table."""
    NO_PLAN = "no_plan"
    """The planner proves that what is seen cannot be solved, or gives up."""
    GAVE_UP = "gave_up"
    """A closed loop has reached its limit of moves or faults."""
    UNCONFIRMED = "unconfirmed"
    """A closed loop's last motion ended well, but camera and fingers do not confirm that the target is out."""
    INCOMPLETE = "incomplete"
    """Every motion ended well, and yet the task's own conditions are not all met."""


class Refused(Exception):
    """A task that the arm cannot carry out. `outcome`: why, `where`: which move, `reason`: in words; the
    message has both."""

    def __init__(self, outcome: Outcome, where: str, reason: str) -> None:
        super().__init__(f"{where}: {reason}")
        self.outcome, self.where, self.reason = outcome, where, reason
