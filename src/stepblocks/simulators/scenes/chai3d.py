"""CHAI3D: meshes in millimetres, a program, and the decaying ring that CHAI3D lacks."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from stepblocks.artefacts.meshes.write import write_obj, write_stl
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template


def _write(folder: Path, scene: Scene) -> None:
    # without normals the reader of CHAI3D 3.3 looks for "/" behind the end of what it copied
    write_obj(folder / "block.obj", scene.whole, normals=True)
    write_stl(folder / "block.stl", scene.whole)
    _write_program(folder, scene.stimulus.id, {"block.obj": scene})


def _write_set(folder: Path, scenes: Sequence[Scene], name: str) -> None:
    # Write a program that switches the blocks of a set
    if not any(scene.stimulus.ball for scene in scenes):  # a tip drags over a step of its own
        _write_program(
            folder,
            folder.parent.name,
            {f"../{scene.stimulus.id}/{name}/block.obj": scene for scene in scenes},
        )


def _write_program(folder: Path, name: str, scenes: Mapping[str, Scene]) -> None:
    # Write a program that takes a device, or drags by a virtual hand
    blocks = [
        {
            "file": file,
            # of the virtual hand where the formula knows no release [N]
            "pull": (0.5 if one.events[0].status is Status.NO_CATCH else 10.0)
            * one.point.normal_load,
            "height": _find_height(one),
            "scene": one,
        }
        for file, one in scenes.items()
    ]
    for file in ("CMakeLists.txt", "ReleaseRing.h", "SessionLog.h", "StepBlock.h", "blocks.cpp"):
        write_from_template(folder / file, name=name, blocks=blocks)


def _find_height(scene: Scene) -> float:
    # Of a step, or of the step that has the same critical angle [m]
    face = scene.surface.counterface()
    if isinstance(face, Step):
        return face.height
    return scene.point.ball_radius * max(1.0 - math.cos(e.critical_angle) for e in scene.events)


CHAI3D = SceneFormat(
    name="chai3d",
    title="CHAI3D 3.3",
    unit="millimetres",
    write=_write,
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
        "on a device the program limits the force on the hand to 3 N (the weakest listed device "
        "bears 3.3 N at its peak), or less where the device bears less; a block that needs more "
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
