"""A native library with a C ABI for any engine, and the blocks of a set as a file that it loads."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template


def _write_native_renderer_and_blocks(folder: Path, scenes: Sequence[Scene]) -> None:
    """Write the sources of the native renderer, and the blocks that it loads."""
    sources = files("stepblocks.simulators").joinpath("native")
    for source in sorted(sources.iterdir(), key=lambda source: source.name):
        (folder / source.name.removesuffix(".j2")).write_bytes(source.read_bytes())
    write_from_template(folder / "blocks.txt", scenes=scenes)


NATIVE = SceneFormat(
    name="native",
    title="C, C++, Python, Unity, Unreal: libstepblocks",
    unit="metres",
    write=lambda folder, scene: _write_native_renderer_and_blocks(folder, [scene]),
    write_tooth=lambda folder, _, stations: _write_native_renderer_and_blocks(folder, stations),
    write_set=lambda folder, scenes, _: _write_native_renderer_and_blocks(folder, scenes),
    shares_probe=False,
    run=(
        "`cmake -B build && cmake --build build`, then `build/drag blocks.txt` drags a virtual "
        "hand over every block in both directions and prints each peak force beside the formula; "
        "`build/drag blocks.txt --time` also says how long a tick takes. `-blocks` beside the "
        "blocks of a set is the same with all of them."
    ),
    settings=(
        "`stepblocks.h` is the whole interface, for C99 and C++: load, friction, tip, spring and "
        "ring of each block can be changed while it runs",
        "`sb_tick` allocates nothing; it limits the force on a hand (`SB_FORCE_LIMIT`) to 3 N (the "
        "weakest listed device bears 3.3 N; a release that needs more is clipped), or to the peak "
        "force of the device that the export named, lets it grow slowly at the start (`SB_RISE`, "
        "0.1 s, which the components set to 1 s), and switches it off after a late tick or a jump "
        "of the hand until it has let go (`SB_WATCHDOG`, 50 ms; `SB_JUMP`, 10 m/s); an input that "
        "is not a number gives the last good force, ramped to zero, and is counted; `stepblocks.h` "
        "has the table of all states",
        "`sb_tick_loaded` is for inputs without a height: mouse, gamepad, linear stage",
        "`stepblocks_native.py` is the same from Python by ctypes, with the standard library alone",
        "`StepBlocks.cs` is a component for Unity (its head shows the script that joins it to a "
        "device), `StepBlocksComponent.h` and `.cpp` one for "
        "Unreal",
        "the law has no speed of its own: the hand goes straight from tick to tick, and a release "
        "is found on that way; speed acts through the hand's position and `damping_n_s_per_m` "
        "alone",
        "the option `-DSTEPBLOCKS_DEMO=OFF` leaves the demonstration `drag.c` out",
    ),
    verified=(
        "built without a warning and held to the Python renderer to 1e-9 by the test suite; the "
        "component for Unity is run by mono beside a stub of the engine, with the forces of that "
        "renderer, and that for Unreal is compiled against one; neither was run in its engine."
    ),
)
