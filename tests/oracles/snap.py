"""When a tip snaps over an edge at all: the stability of a spring against a force that falls with
position.
"""

import math


def snap_load(angle, friction, stiffness, radius_sum):
    """Load [N] above which a slow tip snaps; below it, it climbs over without a release.

    On the arc the holding force falls with ``dF/dx = -N / ((R + r) cos a cos^2(a + atan mu))``; it
    snaps where that is steeper than -k. 0.48 N for 25 um, mu 0.15, R 125 um and 9.81 N/mm.
    """
    return stiffness * radius_sum * math.cos(angle) * math.cos(angle + math.atan(friction)) ** 2
