"""A tick of the native library asks for no memory: a servo loop cannot wait for an allocator."""

import shutil
import subprocess
from pathlib import Path

import pytest

from stepblocks.simulators.export import export_scenes

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
# glibc lets a program replace its allocator, for shared libraries too
DRIVER = r"""
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include "stepblocks.h"

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
static long asked;
void *malloc(size_t size) { ++asked; return __libc_malloc(size); }
void *calloc(size_t count, size_t size) { ++asked; return __libc_calloc(count, size); }
void *realloc(void *old, size_t size) { ++asked; return __libc_realloc(old, size); }
void *aligned_alloc(size_t to, size_t size) { ++asked; return __libc_memalign(to, size); }

int main(int argc, char **argv)
{
    sb_world *world = sb_create();
    sb_output out;
    long before, ticks = 0, releases = 0, faults = 0, late = 0, limited = 0;
    if (argc < 2 || sb_load(world, argv[1]) < 0) return 2;
    printf("%ld ", asked); /* what loading asked for */
    before = asked;
    for (int block = 0; block < sb_count(world); ++block) {
        sb_prediction formula;
        double step, hand[3] = {0.0, 0.0, 0.0}, velocity[3] = {0.0, 0.0, 0.0};
        sb_choose(world, block);
        sb_configure(world, SB_FORCE_LIMIT, block % 2 ? 3.0 : 0.0);
        sb_predict(world, block, 1, &formula);
        hand[0] = formula.position - 3e-5;
        hand[2] = sb_path_height(world, block, hand[0]) - sb_get(world, block, SB_LOAD) / 9810.0;
        step = 5e-4 * formula.force / 9810.0;
        for (int i = 0; i < 4000; ++i, ++ticks) {
            sb_tick(world, hand, velocity, i == 3900 ? 1.0 : 1e-4, &out);
            hand[0] += step;
            hand[2] += (out.load - sb_get(world, block, SB_LOAD)) / 9810.0;
            if (i == 3800) hand[0] = NAN;
            if (i == 3810) hand[0] = formula.position + 1e-3;
        }
        releases += out.events;
        faults += out.faults;
        late += out.late;
        limited += out.limited;
        sb_set(world, block, SB_FRICTION, 0.2);
        sb_set(world, block, SB_LOAD, 0.5);
        for (int i = 0; i < 1000; ++i, ++ticks)
            sb_tick_loaded(world, formula.position + 1e-7 * i, 1e-3, 1e-4, &out);
    }
    before = asked - before;
    printf("%ld %ld %ld %ld %ld %ld\n", before, ticks, releases, faults, late, limited);
    sb_destroy(world);
    return 0;
}
"""


@pytest.mark.long
def test_no_tick_of_the_native_library_allocates(tmp_path):
    """Ten blocks dragged over, with limit, faults, a late tick, and a load that changes."""
    cmake, compiler = shutil.which("cmake"), shutil.which("cc") or shutil.which("gcc")
    if not (cmake and compiler):
        pytest.skip("no cmake or no C compiler")
    export_scenes(str(SET), "native", tmp_path)
    folder = tmp_path / "paper-ten" / "native-blocks"
    for words in (["-S", folder, "-B", folder / "build"], ["--build", folder / "build"]):
        subprocess.run([cmake, *words], check=True, capture_output=True)
    (tmp_path / "count.c").write_text(DRIVER)
    program, library = tmp_path / "count", folder / "build"
    words = [tmp_path / "count.c", f"-I{folder}", f"-L{library}", f"-Wl,-rpath,{library}"]
    built = subprocess.run(
        [compiler, "-std=gnu99", "-O1", *words, "-lstepblocks", "-lm", "-o", program],
        capture_output=True,
        text=True,
        check=False,
    )
    if "__libc_malloc" in built.stderr:
        pytest.skip("no glibc")
    assert built.returncode == 0, built.stderr
    done = subprocess.run(
        [program, folder / "blocks.txt"], capture_output=True, text=True, check=True
    ).stdout
    loading, ticking, ticks, releases, faults, late, limited = map(int, done.split())
    assert loading > 10  # the counter counts
    assert ticks == 50_000
    assert releases >= 9
    assert faults >= 90
    assert late == 10
    assert limited > 0
    assert ticking == 0
