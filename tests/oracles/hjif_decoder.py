"""MPEG haptics (ISO/IEC 23090-31) played as the standard's decoder plays it: the first channel of
an interchange file.
"""

import math

import numpy as np


def decode_hjif(document, rate):
    """Force of the first channel [N], sampled at a rate [Hz]; amplitude and frequency go straight
    from keyframe to keyframe.
    """
    channel = document["perceptions"][0]["channels"][0]
    scale = float(document["timescale"])
    effects = [effect for band in channel["bands"] for effect in band["effects"]]
    end = (
        max(effect["position"] + effect["keyframes"][-1]["relative_position"] for effect in effects)
        / scale
    )
    total = np.zeros(math.floor(end * rate) + 1)
    time = np.arange(len(total)) / rate
    for effect in effects:
        local = time - effect["position"] / scale
        frequency = np.interp(local, *_track(effect, "frequency_modulation", scale))
        turned = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1])) / rate])
        phase = effect["phase"] + math.tau * turned
        phase -= np.interp(0.0, local, phase) - effect["phase"]
        inside = (local >= 0.0) & (local <= effect["keyframes"][-1]["relative_position"] / scale)
        level = np.interp(local, *_track(effect, "amplitude_modulation", scale))
        total += np.where(inside, level * np.sin(phase), 0.0)
    return channel["gain"] * total


def _track(effect, name, scale):
    frames = [frame for frame in effect["keyframes"] if name in frame]
    return [frame["relative_position"] / scale for frame in frames], [
        frame[name] for frame in frames
    ]
