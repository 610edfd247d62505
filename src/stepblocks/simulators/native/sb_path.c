/* The path of the ball's centre: the upper envelope of circles about the corners, grown by the
 * ball, and of the straight faces lifted by it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sb_internal.h"

#define PI 3.14159265358979323846
#define ANGLE_STEP 2e-3   /* chord of a circle [rad] */
#define MOST_KNOTS 20000  /* of all circles together */
#define STEEPEST 1e9      /* slope that stands for a vertical wall */
#define KINK 1e-3         /* change of slope that is a notch */
#define SAME 1e-15        /* knots closer than this are one [m] */

typedef struct {
    size_t discs, lines;
    double *cx, *cz, *r;          /* of the circles */
    double *x0, *x1, *z0, *slope; /* of the lifted lines */
} shapes;

static double height_of(const shapes *s, size_t shape, double x)
{
    if (shape < s->discs) {
        const double dx = x - s->cx[shape], across = s->r[shape] * s->r[shape] - dx * dx;
        return across >= 0.0 ? s->cz[shape] + sqrt(across) : -INFINITY;
    }
    shape -= s->discs;
    if (x < s->x0[shape] - SAME || x > s->x1[shape] + SAME) return -INFINITY;
    return s->z0[shape] + s->slope[shape] * (x - s->x0[shape]);
}

static size_t top_at(const shapes *s, double x, double *height)
{
    size_t best = 0;
    double top = -INFINITY;
    for (size_t i = 0; i < s->discs + s->lines; ++i) {
        const double here = height_of(s, i, x);
        if (here > top) {
            top = here;
            best = i;
        }
    }
    *height = top;
    return best;
}

static double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

static double slope_of(const shapes *s, size_t shape, double x)
{
    double run, across;
    if (shape >= s->discs) return s->slope[shape - s->discs];
    run = s->cx[shape] - x;
    across = s->r[shape] * s->r[shape] - run * run;
    if (across > 0.0) return clamp(run / sqrt(across), -STEEPEST, STEEPEST);
    return run > 0.0 ? STEEPEST : run < 0.0 ? -STEEPEST : 0.0;
}

/* Which of two shapes is higher at x, by the sign; where one is missing the other counts. */
static double difference(const shapes *s, size_t a, size_t b, double x)
{
    const double one = height_of(s, a, x), two = height_of(s, b, x);
    if (isinf(one) || isinf(two)) return copysign(1.0, one);
    return one - two;
}

static double crossing(const shapes *s, size_t a, size_t b, double low, double high)
{
    const double at_low = difference(s, a, b, low);
    if (at_low * difference(s, a, b, high) >= 0.0) return low;
    for (int step = 0; step < 200; ++step) {
        const double middle = 0.5 * (low + high);
        if (middle <= low || middle >= high) break;
        if (at_low * difference(s, a, b, middle) > 0.0) low = middle;
        else high = middle;
    }
    return 0.5 * (low + high);
}

static int ascending(const void *a, const void *b)
{
    const double one = *(const double *)a, two = *(const double *)b;
    return (one > two) - (one < two);
}

/* Sort, drop equal values and those closer than a distance to the one before; returns how many
 * stay. */
static size_t sort_unique(double *values, size_t count, double apart)
{
    size_t kept = 0;
    double before = 0.0;
    qsort(values, count, sizeof *values, ascending);
    for (size_t i = 0; i < count; ++i) {
        const double value = values[i];
        if (kept == 0 || value - before > apart) values[kept++] = value;
        before = value;
    }
    return kept;
}

static int gather(shapes *s, const double *discs, const double *lines, double ball)
{
    double *room = malloc((3 * s->discs + 4 * s->lines + 1) * sizeof *room);
    if (!room) return SB_ERROR_MEMORY;
    s->cx = room;
    s->cz = s->cx + s->discs;
    s->r = s->cz + s->discs;
    s->x0 = s->r + s->discs;
    s->x1 = s->x0 + s->lines;
    s->z0 = s->x1 + s->lines;
    s->slope = s->z0 + s->lines;
    for (size_t i = 0; i < s->discs; ++i) {
        s->cx[i] = discs[3 * i];
        s->cz[i] = discs[3 * i + 1];
        s->r[i] = discs[3 * i + 2] + ball;
    }
    for (size_t i = 0; i < s->lines; ++i) {
        const double *line = lines + 4 * i;
        const double slope = (line[3] - line[1]) / (line[2] - line[0]);
        const double length = hypot(1.0, slope), shift = -ball * slope / length;
        s->x0[i] = line[0] + shift;
        s->x1[i] = line[2] + shift;
        s->z0[i] = line[1] + ball / length;
        s->slope[i] = slope;
    }
    return SB_OK;
}

/* First knots: points of every circle, ends of every line, ends of the profile. */
static size_t first_knots(const shapes *s, double start, double end, size_t around, double *knots)
{
    size_t count = 0;
    knots[count++] = start;
    knots[count++] = end;
    for (size_t i = 0; i < s->discs; ++i) {
        for (size_t k = 0; k < around; ++k) {
            const double share = (double)k / (double)(around - 1);
            knots[count++] = clamp(s->cx[i] + s->r[i] * sin(-0.5 * PI + PI * share), start, end);
        }
    }
    for (size_t i = 0; i < s->lines; ++i) {
        knots[count++] = clamp(s->x0[i], start, end);
        knots[count++] = clamp(s->x1[i], start, end);
    }
    return sort_unique(knots, count, 0.0);
}

/* Add the crossings of neighbouring pieces, three times at most, as each may reveal others. */
static size_t add_crossings(const shapes *s, double *knots, size_t count)
{
    for (int pass = 0; pass < 3; ++pass) {
        const size_t before = count;
        double unused, middle = 0.5 * (knots[0] + knots[1]);
        size_t top = top_at(s, middle, &unused), found = 0;
        for (size_t i = 1; i + 1 < before; ++i) {
            const double next = 0.5 * (knots[i] + knots[i + 1]);
            const size_t after = top_at(s, next, &unused);
            if (after != top) knots[before + found++] = crossing(s, top, after, middle, next);
            middle = next;
            top = after;
        }
        count = sort_unique(knots, before + found, SAME);
        if (count == before) break;
    }
    return count;
}

static int fill_path(sb_path *path, const shapes *s, const double *knots, size_t count,
                     double scale)
{
    double *room = malloc(4 * count * sizeof *room);
    unsigned char *flags = calloc(2 * count, 1);
    if (!room || !flags) {
        free(room);
        free(flags);
        return SB_ERROR_MEMORY;
    }
    path->count = count;
    path->x = room;
    path->z = room + count;
    path->first = room + 2 * count;
    path->last = room + 3 * count;
    path->up = flags;
    path->down = flags + count;
    for (size_t i = 0; i < count; ++i) {
        double top;
        top_at(s, knots[i], &top);
        path->x[i] = knots[i] * scale;
        path->z[i] = top * scale;
    }
    for (size_t i = 0; i + 1 < count; ++i) {
        double unused;
        const size_t top = top_at(s, 0.5 * (knots[i] + knots[i + 1]), &unused);
        path->first[i] = slope_of(s, top, knots[i]);
        path->last[i] = slope_of(s, top, knots[i + 1]);
    }
    path->first[count - 1] = path->last[count - 2];
    path->last[count - 1] = 0.0;
    for (size_t i = 0; i < count; ++i) {
        const double before = i ? path->last[i - 1] : path->first[0], after = path->first[i];
        const int notch = after - before > KINK;
        path->up[i] = (unsigned char)(notch && after > KINK);
        path->down[i] = (unsigned char)(notch && before < -KINK);
    }
    return SB_OK;
}

int sb_path_build(sb_path *path, const double *discs, size_t disc_count, const double *lines,
                  size_t line_count, double ball_radius, double scale)
{
    shapes s;
    size_t around, count;
    double *knots;
    int result;
    s.discs = disc_count;
    s.lines = line_count;
    if (line_count == 0) return SB_ERROR_ARGUMENT;
    around = disc_count ? MOST_KNOTS / disc_count : 0;
    if (around > (size_t)ceil(PI / ANGLE_STEP)) around = (size_t)ceil(PI / ANGLE_STEP);
    if (around < 16) around = 16;
    result = gather(&s, discs, lines, ball_radius);
    if (result != SB_OK) return result;
    /* room for the crossings of three passes, each at most one between two knots */
    count = 2 + disc_count * around + 2 * line_count;
    knots = malloc(8 * count * sizeof *knots);
    if (!knots) {
        free(s.cx);
        return SB_ERROR_MEMORY;
    }
    count = first_knots(&s, lines[0], lines[4 * line_count - 2], around, knots);
    if (count < 2) {
        result = SB_ERROR_ARGUMENT;
    } else {
        sb_path made;
        memset(&made, 0, sizeof made);
        count = add_crossings(&s, knots, count);
        result = fill_path(&made, &s, knots, count, scale);
        if (result == SB_OK) {
            sb_path_free(path);
            *path = made;
        }
    }
    free(knots);
    free(s.cx);
    return result;
}

void sb_path_free(sb_path *path)
{
    free(path->x);
    free(path->up);
    memset(path, 0, sizeof *path);
}
