/* A whole tooth: the sections of its margin, each at its station of the margin line. The hand
 * moves in the axes of the scan; each tick finds where it is along the line and turns it into
 * the section there. */
#include <math.h>
#include <string.h>

#include "sb_internal.h"

#define REACH 1e-3 /* of a section on either side of the margin, unmagnified [m] */
#define FADE 0.25e-3 /* over which the force vanishes there [m] */
#define APART 3.0 /* a gap this many times the usual one between stations is not bridged */

/* The stations of one margin line: blocks that follow each other and were loaded together. */
typedef struct {
    const sb_block *blocks;
    int first, count;
    double scale;
    int closed;
} margin;

/* Where a point lies on the line. */
typedef struct {
    int station;  /* of the segment's start, counted from the first */
    double share; /* of the segment [1] */
    double way;   /* along the line [m] */
    double whole; /* length of the line [m] */
} spot;

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static int unit(double a[3])
{
    const double size = sqrt(dot(a, a));
    if (!(size > 1e-12) || !isfinite(size)) return 0;
    for (int i = 0; i < 3; ++i) a[i] /= size;
    return 1;
}

int sb_place(sb_world *world, int block, const double place[3], const double across[3],
             const double outward[3])
{
    sb_block *one;
    double side[3], up[3];
    if (!world || !place || !across || !outward) return SB_ERROR_ARGUMENT;
    if (block < 0 || block >= world->count)
        return sb_fail(world, SB_ERROR_INDEX, "there is no block %d", block);
    memcpy(side, across, sizeof side);
    memcpy(up, outward, sizeof up);
    if (!isfinite(dot(place, place)) || !unit(side) || !unit(up) || fabs(dot(side, up)) > 1e-3)
        return sb_fail(world, SB_ERROR_ARGUMENT,
                       "a place must be finite, and the axes across and outward at right angles");
    one = &world->blocks[block];
    memcpy(one->place, place, sizeof one->place);
    memcpy(one->across, side, sizeof side);
    memcpy(one->outward, up, sizeof up);
    one->placed = 1;
    return SB_OK;
}

/* Places are read unmagnified. */
static void place_of(const margin *m, int station, double place[3])
{
    const sb_block *one;
    if (m->closed) station = (station + m->count) % m->count;
    else if (station < 0) station = 0;
    else if (station >= m->count) station = m->count - 1;
    one = &m->blocks[m->first + station];
    for (int i = 0; i < 3; ++i) place[i] = m->scale * one->place[i];
}

static double distance(const margin *m, int from, int to)
{
    double a[3], b[3], d = 0.0;
    place_of(m, from, a);
    place_of(m, to, b);
    for (int i = 0; i < 3; ++i) d += (b[i] - a[i]) * (b[i] - a[i]);
    return sqrt(d);
}

/* The margin line that the active block belongs to; 0 where it has none. */
static int find_margin(const sb_world *w, margin *m)
{
    int last = w->active;
    double longest = 0.0;
    m->blocks = w->blocks;
    m->first = w->active;
    if (!w->blocks[w->active].placed) return 0;
    while (m->first > 0 && w->blocks[m->first - 1].placed &&
           w->blocks[m->first - 1].line == w->blocks[w->active].line)
        --m->first;
    while (last + 1 < w->count && w->blocks[last + 1].placed &&
           w->blocks[last + 1].line == w->blocks[w->active].line)
        ++last;
    m->count = last - m->first + 1;
    m->scale = w->blocks[m->first].parameter[SB_SCALE];
    m->closed = 0;
    for (int i = 0; i + 1 < m->count; ++i) longest = fmax(longest, distance(m, i, i + 1));
    m->closed = m->count > 2 && distance(m, m->count - 1, 0) < APART * longest;
    return m->count > 1;
}

static spot find_spot(const margin *m, const double hand[3])
{
    spot found = {0, 0.0, 0.0, 0.0};
    double nearest = INFINITY;
    for (int i = 0; i < m->count - 1 + m->closed; ++i) {
        double a[3], b[3], along[3], away[3], size, share, square = 0.0;
        place_of(m, i, a);
        place_of(m, i + 1, b);
        for (int j = 0; j < 3; ++j) {
            along[j] = b[j] - a[j];
            away[j] = hand[j] - a[j];
        }
        size = sqrt(dot(along, along));
        share = size > 0.0 ? dot(away, along) / (size * size) : 0.0;
        share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
        for (int j = 0; j < 3; ++j) {
            away[j] -= share * along[j];
            square += away[j] * away[j];
        }
        if (square < nearest) {
            nearest = square;
            found.station = i;
            found.share = share;
            found.way = found.whole + share * size;
        }
        found.whole += size;
    }
    return found;
}

/* The station nearest to a way along the line. */
static int station_at(const margin *m, const spot *s, double way)
{
    double passed = 0.0;
    if (m->closed) way -= s->whole * floor(way / s->whole);
    for (int i = 0; i < m->count - 1 + m->closed; ++i) {
        const double next = distance(m, i, i + 1);
        if (way <= passed + next) return (way > passed + 0.5 * next ? i + 1 : i) % m->count;
        passed += next;
    }
    return m->closed ? 0 : m->count - 1;
}

/* Origin and axes between two stations: a smooth line through the places, axes turned in
 * between. */
static void frame_at(const margin *m, const spot *s, double origin[3], double axes[3][3])
{
    const double t = s->share;
    const sb_block *a = &m->blocks[m->first + s->station];
    const sb_block *b = &m->blocks[m->first + (s->station + 1) % m->count];
    double p[4][3], lean;
    for (int i = 0; i < 4; ++i) place_of(m, s->station - 1 + i, p[i]);
    for (int j = 0; j < 3; ++j) {
        const double from = 0.5 * (p[2][j] - p[0][j]), to = 0.5 * (p[3][j] - p[1][j]);
        origin[j] = (1.0 + t * t * (2.0 * t - 3.0)) * p[1][j] + t * t * (3.0 - 2.0 * t) * p[2][j] +
                    t * (1.0 - t) * ((1.0 - t) * from - t * to);
        axes[0][j] = (1.0 - t) * a->across[j] + t * b->across[j];
        axes[2][j] = (1.0 - t) * a->outward[j] + t * b->outward[j];
    }
    unit(axes[0]);
    lean = dot(axes[0], axes[2]);
    for (int j = 0; j < 3; ++j) axes[2][j] -= lean * axes[0][j];
    unit(axes[2]);
    for (int j = 0; j < 3; ++j) {
        const int k = (j + 1) % 3, l = (j + 2) % 3;
        axes[1][j] = axes[2][k] * axes[0][l] - axes[2][l] * axes[0][k];
    }
}

static void turn_back(const sb_world *w, const double local[3], double turned[3])
{
    for (int j = 0; j < 3; ++j)
        turned[j] = local[0] * w->axes[0][j] + local[1] * w->axes[1][j] + local[2] * w->axes[2][j];
}

int sb_tick_tooth(sb_world *world, const double hand[3], const double velocity[3], double dt,
                  sb_output *output)
{
    double local[3] = {NAN, NAN, NAN}, turning[3] = {NAN, NAN, NAN}, away[3], force[3], share = 1.0;
    margin m;
    int state;
    if (output) memset(output, 0, sizeof *output);
    if (!world || !hand || !velocity || !output || world->count == 0) return SB_ERROR_ARGUMENT;
    if (!find_margin(world, &m))
        return sb_fail(world, SB_ERROR_ARGUMENT, "%s: a tooth has two or more blocks with a frame",
                       world->blocks[world->active].name);
    if (isfinite(dot(hand, hand)) && isfinite(dot(velocity, velocity))) {
        const spot s = find_spot(&m, hand);
        double way = s.way;
        int station;
        /* the way goes on past the start of a closed line, so that the tip is never torn round */
        if (world->riding && m.closed) way += s.whole * floor((world->way - way) / s.whole + 0.5);
        world->way = way;
        frame_at(&m, &s, world->origin, world->axes);
        for (int j = 0; j < 3; ++j) away[j] = hand[j] - world->origin[j];
        for (int j = 0; j < 3; ++j) {
            local[j] = dot(away, world->axes[j]);
            turning[j] = dot(velocity, world->axes[j]);
        }
        local[1] += way;
        /* the section is that of the tip, which friction may hold behind the hand */
        station = m.first + station_at(&m, &s, world->touching ? world->y : way);
        if (!world->riding && !world->held) sb_choose(world, station);
        else if (station != world->active) sb_turn_to(world, station);
        world->riding = 1;
        share = (m.scale * REACH - fabs(local[0])) / (m.scale * FADE);
        if (share <= 0.0 || local[2] < -m.scale * REACH) { /* not at the margin: nothing is there */
            local[2] = m.scale * 10.0 * REACH;
            share = 1.0;
        }
    }
    state = sb_tick_seen(world, hand, local, turning, -1.0, dt, output);
    if (share < 1.0)
        for (int j = 0; j < 3; ++j) output->force[j] *= share;
    memcpy(force, output->force, sizeof force);
    turn_back(world, force, output->force);
    if (output->touching) {
        const double tip[3] = {output->tip[0], output->tip[1] - world->way, output->tip[2]};
        turn_back(world, tip, output->tip);
        for (int j = 0; j < 3; ++j) output->tip[j] += world->origin[j];
    } else if (state == SB_RUNNING) {
        memcpy(output->tip, hand, sizeof output->tip);
    }
    return state;
}
