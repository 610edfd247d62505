"""CHAI3D: meshes in millimetres, a program, and the decaying ring that CHAI3D lacks."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepblocks.artefacts.meshes.write import write_obj, write_stl
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template

_NEVER = 1e9  # pull over load that no hand reaches [1]


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write a program for one block."""
    # without normals the reader of CHAI3D 3.3 looks for "/" behind the end of what it copied
    write_obj(folder / "block.obj", scene.whole, include_normals=True)
    write_stl(folder / "block.stl", scene.whole)
    _write_program(folder, scene.stimulus.id, {"block.obj": scene})


def _write_set(folder: Path, scenes: Sequence[Scene], name: str) -> None:
    """Write a program that switches the blocks of a set."""
    files = {}
    for scene in scenes:
        if scene.stimulus.ball:  # a tip drags over a step of its own
            return
        files[f"../{scene.stimulus.id}/{name}/block.obj"] = scene
    _write_program(folder, folder.parent.name, files)


def _write_program(folder: Path, program_name: str, scenes: Mapping[str, Scene]) -> None:
    """Write a program that takes a device, or drags by a virtual hand; scenes by their meshes."""
    blocks = []
    for file, scene in scenes.items():
        blocks.append(
            {
                "file": file,
                "pull": _choose_virtual_hand_pull(scene),
                "height": _compute_equivalent_height(scene),
                "scene": scene,
            }
        )
    for file in ("CMakeLists.txt", "ReleaseRing.h", "SessionLog.h", "StepBlock.h", "blocks.cpp"):
        write_from_template(
            folder / file, name=program_name, blocks=blocks, lean=_compute_pull_ratio
        )


def _compute_pull_ratio(event: VibrationEvent, point: OperatingPoint) -> float:
    """Find the ratio of pull to load at which a notch gives way, tan(a + atan mu) [1]."""
    if event.status is Status.NO_CATCH:
        return point.friction
    if math.isfinite(event.critical_force):
        return event.critical_force / point.normal_load
    return _NEVER


def _choose_virtual_hand_pull(scene: Scene) -> float:
    """Choose the pull of the virtual hand where the formula knows no release [N]."""
    if scene.events[0].status is Status.NO_CATCH:
        return 0.5 * scene.point.normal_load
    return 10.0 * scene.point.normal_load


def _compute_equivalent_height(scene: Scene) -> float:
    """Find the height of a step, or of the step that has the same critical angle [m]."""
    face = scene.surface.counterface()
    if isinstance(face, Step):
        return face.height
    rises = [1.0 - math.cos(event.critical_angle) for event in scene.events]
    return scene.point.ball_radius * max(rises)


CHAI3D = SceneFormat(
    name="chai3d",
    title="CHAI3D 3.3",
    unit="millimetres",
    write=_write_scene,
    write_set=_write_set,
    run=(
        "Build `blocks.cpp` against your CHAI3D (its head says how); `echo 1 | "
        "build/blocks --blocks .` lets a virtual hand drag the proxy over the edge and prints the "
        "peak beside the formula, `--device 0` takes a device, `--device demo` shows the program "
        "without one. `--log NAME` writes every drag into a new session folder that `stepblocks "
        "compare`, `measure` and `loop` read. In a program of your own "
        'load `block.obj` into a `cMultiMesh`, `#include "StepBlock.h"` and call '
        "`stepblock::prepare(object, tool)` once: it sets the contact and attaches the ring. "
        "`-blocks` beside the blocks of a set is the same program: keys switch the blocks."
    ),
    settings=(
        "millimetres, and a proxy epsilon of 1e-6: in metres with its default the proxy is wrong "
        "by up to 75 %",
        "one workspace unit must be one millimetre: set the tool's workspace scale factor "
        "accordingly",
        "every face is wound outwards and every index positive: other faces load and give no force",
        "`block.obj` has normals: an OBJ without them makes the reader of CHAI3D 3.3 crash now and "
        "then, by what happens to lie on its stack",
        "on a device the program limits the force on the hand to `kLimit` of `StepBlock.h`: 3 N "
        "(the weakest listed device bears 3.3 N at its peak), or the peak force of the device that "
        "the export named, and less where the driver says less; a block that needs more "
        "says so, `--limit` raises it; in a program of your own pass the force through "
        "`cForceGuard`",
        "the log is HDF5 where CMake finds the C library of HDF5, CSV with the same columns "
        "elsewhere, at the real size; the virtual hand has gauges with a noise of 1 mN (`--noise`) "
        "and slides at 5 mm/s (`--speed`); a device is read at 4 kHz (`--rate`), and a tick that "
        "comes late is a gap in the record",
        "`cFrictionProxy` of `ReleaseRing.h` takes the place of the tool's finger proxy: that of "
        "CHAI3D drops friction where it comes near a second face and where it leaves an edge",
        "the proxy has no mass: above a load of k R (1.23 N for the paper's tool) it snaps, below "
        "it climbs down behind the edge as slowly as the hand goes while the ring sounds already; "
        "`measure` calls that climb-down or rubbing, finds the peak and takes the ring for too "
        "small: `compare` reads it from `ring_n`, and a session for `loop` is dragged above k R",
        "`ticks/` of a session on a device has every tick, in the air too, in files of ten seconds",
        "its own vibration effect is a steady sine; `ReleaseRing.h` is a decaying one, fired when "
        "the proxy leaves the notch",
    ),
    verified=(
        "OBJ and STL are read back and measured by the test suite; `blocks.cpp` was compiled "
        "against CHAI3D 3.3 and run by the virtual hand and the demonstration, and its sessions "
        "measured; not run on a device."
    ),
)
