/* Drag a virtual hand over every block of a file, in both directions, and print each peak force
 * beside the formula: drag blocks.txt [--time]. With --time also how long a tick takes. Exit
 * status 1 where a peak is off by more than 1 %. */
#ifdef _WIN32
#include <windows.h>
#else
#define _POSIX_C_SOURCE 199309L
#include <time.h>
#endif
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stepblocks.h"

#define RATE 10e3 /* ticks per second */
#define APPROACH 30e-6 /* before the notch, unmagnified [m] */

static int drag(sb_world *world, int block, int direction)
{
    static const char *const STATUS[] = {"releases", "locked", "too high", "no catch", "beyond"};
    const double scale = sb_get(world, block, SB_SCALE), load = sb_get(world, block, SB_LOAD);
    const double stiffness = sb_get(world, block, SB_STIFFNESS) / scale;
    const double velocity[3] = {0.0, 0.0, 0.0};
    double hand[3] = {0.0, 0.0, 0.0}, peak = 0.0, target, step;
    sb_prediction formula;
    sb_output out;
    sb_predict(world, block, direction, &formula);
    target = isfinite(formula.force) ? formula.force : 3.0 * load;
    step = 5e-4 * target / stiffness;
    sb_choose(world, block);
    hand[0] = formula.position - direction * APPROACH * scale;
    hand[2] = sb_path_height(world, block, hand[0]) - load / stiffness;
    memset(&out, 0, sizeof out);
    for (double way = 0.0; way < APPROACH * scale + 1.1 * target / stiffness; way += step) {
        sb_tick(world, hand, velocity, 1.0 / RATE, &out);
        if (direction * out.pull > peak) peak = direction * out.pull;
        hand[0] += direction * step;
        hand[2] += (out.load - load) / stiffness; /* the hand keeps its load */
    }
    printf("%s %s: peak %.6g N, ", sb_name(world, block), direction > 0 ? "+x" : "-x", peak);
    if (isfinite(formula.force)) printf("formula %.6g N, ", formula.force);
    printf("%s, releases %u\n", STATUS[formula.status], (unsigned)out.events);
    return formula.status != SB_RELEASES || fabs(peak / formula.force - 1.0) < 0.01;
}

static int ascending(const void *a, const void *b)
{
    const double one = *(const double *)a, two = *(const double *)b;
    return (one > two) - (one < two);
}

/* Time on a clock that only goes forwards [us]. */
static double read_clock(void)
{
#ifdef _WIN32
    LARGE_INTEGER ticks, rate;
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&rate);
    return 1e6 * (double)ticks.QuadPart / (double)rate.QuadPart;
#else
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e6 * (double)now.tv_sec + 1e-3 * (double)now.tv_nsec;
#endif
}

static void time_ticks(sb_world *world)
{
    enum { COUNT = 200000 };
    double *took = malloc(COUNT * sizeof *took);
    const double velocity[3] = {0.0, 0.0, 0.0};
    sb_output out;
    if (!took) return;
    sb_choose(world, 0);
    for (int i = 0; i < COUNT; ++i) {
        double before;
        const double phase = 6.283 * i / 2000.0;
        const double hand[3] = {3e-4 * sin(phase), 0.0, sb_path_height(world, 0, 0.0) - 1e-4};
        before = read_clock();
        sb_tick(world, hand, velocity, 1.0 / RATE, &out);
        took[i] = read_clock() - before;
    }
    qsort(took, COUNT, sizeof *took, ascending);
    printf("a tick takes %.2f us in the median, %.2f us at 99.9 %%\n", took[COUNT / 2],
           took[COUNT - COUNT / 1000]);
    free(took);
}

int main(int argc, char **argv)
{
    sb_world *world = sb_create();
    int good = 1;
    if (argc < 2 || !world || sb_load(world, argv[1]) < 0) {
        fprintf(stderr, "%s\n", argc < 2 ? "drag blocks.txt [--time]" : sb_message(world));
        return 2;
    }
    for (int block = 0; block < sb_count(world); ++block)
        for (int direction = 1; direction >= -1; direction -= 2)
            good = drag(world, block, direction) && good;
    if (argc > 2 && strcmp(argv[2], "--time") == 0) time_ticks(world);
    sb_destroy(world);
    return good ? 0 : 1;
}
