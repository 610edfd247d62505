"""The channels of a trial: their places in a table of trials, and their names in words."""

from stepblocks.rig.state import CHANNELS

# places in `CHANNELS`, which is the order of the channels in every table of a session
ENERGY = CHANNELS.index("ln_energy")
PEAK_FORCE = CHANNELS.index("ln_peak_force")
FRICTION = CHANNELS.index("sliding_friction")
RING_FREQUENCY = CHANNELS.index("ln_ring_frequency")
DECAY_TIME = CHANNELS.index("ln_decay_time")
JUDGED = slice(ENERGY, PEAK_FORCE + 1)  # energy and peak force, by which a session is judged

CHANNELS_IN_WORDS = {
    "ln_energy": "vibration energy",
    "ln_peak_force": "peak force",
    "sliding_friction": "friction before the edge",
    "spring_constant": "stiffness of the ramp",
    "ln_ring_frequency": "pitch of the ring",
    "ln_decay_time": "decay of the ring",
    "normal_load_ratio": "normal force over set load",
}


def is_logarithm(channel: str) -> bool:
    """Tell whether a channel is the logarithm of what was measured."""
    return channel.startswith("ln_")
