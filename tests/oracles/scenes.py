"""Scenes of single stimuli, and paths over single profiles.

As tests and benchmarks ask for them.
"""

from stepblocks.contact.path.centre import build_envelope_path, build_outline
from stepblocks.simulators.assemble import build_scene, resolve_contact


def assemble_scene(stimulus, point, *, device=None, scale=None, **options):
    """The scene of one stimulus, at a scale or at that of its own plan for a device."""
    return build_scene(resolve_contact(stimulus, point, **options), device, scale)


def corner_path(points, ball_radius):
    """The path of a ball's centre over a profile of shape (n, 2) [m]."""
    return build_envelope_path(*build_outline(points), ball_radius)
