"""From a joint path to joint commands in time, within the joints' speed and acceleration limits. NumPy only."""

from __future__ import annotations

import math

import numpy as np

from dore.sim.motion.frames import Array

_PEAK_SPEED = 1.875
"""Peak of the derivative of the quintic that rises from 0 to 1 in unit time, at rest at both ends."""


def timed(
    path: Array, length_m: float, dt: float, hand_speed: float, joint_speed: Array, joint_acceleration: Array
) -> Array:
    """Joint commands Float64[T, D], every `dt` seconds, at rest at both ends; the last one is the path's end.

    Args:
        path: Float64[N, D], radians; N >= 2, the first row is where the arm is.
        length_m: what the hand travels, metres.
        hand_speed: its highest speed, m/s.
        joint_speed, joint_acceleration: Float64[D], limits in rad/s and rad/s^2.
    """
    seconds = max(_PEAK_SPEED * length_m / hand_speed, 2 * dt)
    while True:
        commands = _sample(path, seconds, dt)
        velocity = np.diff(commands, axis=0, prepend=path[:1]) / dt
        acceleration = np.diff(velocity, axis=0, prepend=np.zeros_like(path[:1])) / dt
        too_fast = max(
            float((np.abs(velocity) / joint_speed).max()),
            math.sqrt(float((np.abs(acceleration) / joint_acceleration).max())),
        )
        if too_fast <= 1.0:
            return commands
        seconds *= max(too_fast, 1.02)


def _sample(path: Array, seconds: float, dt: float) -> Array:
    """The path under a quintic time law, every `dt`."""
    steps = max(1, math.ceil(seconds / dt))
    t = np.arange(1, steps + 1) / steps
    along = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    knots = np.linspace(0.0, 1.0, len(path))
    return np.column_stack([np.interp(along, knots, joint) for joint in path.T])
