"""CHAI3D: meshes in millimetres, a program, and the decaying ring that CHAI3D lacks."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from stepblocks.artefacts.meshes.write import write_obj, write_stl
from stepblocks.contact.energy import Status
from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template


def _write(folder: Path, scene: Scene) -> None:
    # without normals the reader of CHAI3D 3.3 looks for "/" behind the end of what it copied
    write_obj(folder / "block.obj", scene.whole, normals=True)
    write_stl(folder / "block.stl", scene.whole)
    _write_program(folder, scene.stimulus.id, {"block.obj": scene})


def _write_set(folder: Path, scenes: Sequence[Scene], beside: str) -> None:
    # Write a program that switches the blocks of a set
    if not any(scene.stimulus.ball for scene in scenes):  # a tip drags over a step of its own
        files = {f"../{scene.stimulus.id}/{beside}/block.obj": scene for scene in scenes}
        _write_program(folder, folder.parent.name, files)


def _write_program(folder: Path, name: str, scenes: Mapping[str, Scene]) -> None:
    # Write a program that takes a device, or drags by a virtual hand
    blocks = [
        {
            "file": file,
            # of the virtual hand where the formula knows no release [N]
            "pull": (0.5 if one.events[0].status is Status.NO_CATCH else 10.0)
            * one.point.normal_load,
            "scene": one,
        }
        for file, one in scenes.items()
    ]
    for file in ("CMakeLists.txt", "ReleaseRing.h", "StepBlock.h", "blocks.cpp"):
        write_from_template(folder / file, name=name, blocks=blocks)


CHAI3D = SceneFormat(
    name="chai3d",
    title="CHAI3D 3.3",
    unit="millimetres",
    write=_write,
    write_set=_write_set,
    run=(
        "Build `blocks.cpp` against your CHAI3D (its second line says how); `echo 1 | "
        "build/blocks --blocks .` lets a virtual hand drag the proxy over the edge and prints the "
        "peak beside the formula, `--device 0` takes a device. In a program of your own "
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
        "its own vibration effect is a steady sine; `ReleaseRing.h` is a decaying one, fired when "
        "the proxy leaves the notch",
    ),
    verified=(
        "OBJ and STL are read back and measured by the test suite; `blocks.cpp` was compiled "
        "against CHAI3D 3.3 and run without device "
        "or display for the table of docs/explanation/simulators.md; not run on a device."
    ),
)
