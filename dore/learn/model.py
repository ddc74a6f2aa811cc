"""An agent as its config says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dore.configure import make
from dore.learn.agents.common import Agent
from dore.world.reach import Reach


def agent_of(config: Mapping[str, Any], reach: Reach) -> Agent:
    """The agent, with fresh weights."""
    network = make(config.get("network"), "network")
    agent: Agent = make(config.get("agent"), "agent", reach=reach, network=network)
    return agent
