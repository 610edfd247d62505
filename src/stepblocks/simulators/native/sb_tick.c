/* One servo tick: the proxy on its path, the force on the hand, the ring, and what keeps both
 * safe. */
#include <math.h>
#include <string.h>

#include "sb_internal.h"

#define TAU 6.28318530717958647692
#define BISECTIONS 40
#define STEEPEST 1e9
#define CATCH 1e-6 /* angle that counts as a catch [rad] */
#define FARTHEST 1e3 /* a place [m] or velocity [m/s] beyond is no number of a hand */
#define SHORTEST 1e-3 /* time in which a hand may move where its clock says less [s] */

/* What a tick needs of its block and of the hand. */
typedef struct {
    const sb_path *path;
    double stiffness, wall, friction, limit; /* magnified springs [N/m], mu, pull limit [N] */
    double load; /* imposed [N]; negative where the hand's height gives it */
    double x, z;                             /* of the hand [m] */
    double from_x, from_z;                   /* of the hand at the tick before [m] */
    int landed;                              /* the tip was free, or just fell on the path */
} pull;

static double height_at(const sb_path *p, double x, size_t i)
{
    return p->z[i] + (p->z[i + 1] - p->z[i]) * (x - p->x[i]) / (p->x[i + 1] - p->x[i]);
}

static double slope_at(const sb_path *p, double x, size_t i)
{
    const double share = (x - p->x[i]) / (p->x[i + 1] - p->x[i]);
    return p->first[i] + share * (p->last[i] - p->first[i]);
}

static size_t piece_at(const sb_path *p, double x)
{
    size_t low = 0, high = p->count - 1;
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (x < p->x[middle]) high = middle;
        else low = middle;
    }
    return low;
}

static double load_at(const pull *h, double height)
{
    return h->load >= 0.0 ? h->load : h->wall * (height - h->z);
}

static double clip(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

/* What moves the proxy in a direction, times the cosine of the slope, by a pull and a load. */
static double excess(const pull *h, double rise, double along, double down)
{
    return along * (1.0 - h->friction * rise) - down * (rise + h->friction);
}

/* Force left to move the proxy in a direction, times the cosine of the slope. */
static double drive(const pull *h, double direction, double x, double height, double slope)
{
    double along = direction * h->stiffness * (h->x - x);
    if (along > h->limit) along = h->limit;
    return excess(h, direction * slope, along, load_at(h, height));
}

static int slides(const pull *h, double direction, double x, size_t i)
{
    const sb_path *p = h->path;
    return drive(h, direction, x, height_at(p, x, i), slope_at(p, x, i)) > 0.0;
}

/* The tip leaves a knot of the path: a release where the knot is a notch that held it. The hand
 * went straight from where it was a tick ago, and the force left to move the tip is linear along
 * that way: where it crosses zero the notch gave way, whatever the rate and the speed. */
static void leave(sb_world *w, const sb_block *block, const pull *h, double direction, size_t knot,
                  double slope, double dt)
{
    const sb_path *p = h->path;
    const double rise = direction * slope, x = p->x[knot], z = p->z[knot];
    const double from = direction * h->stiffness * (h->from_x - x);
    const double to = direction * h->stiffness * (h->x - x);
    const double from_down = h->load >= 0.0 ? h->load : h->wall * (z - h->from_z);
    const double before = excess(h, rise, from, from_down);
    const double after = excess(h, rise, to, load_at(h, z));
    double share = 0.0;
    if (h->landed || !(direction > 0.0 ? p->up[knot] : p->down[knot])) return;
    if (before > 0.0 && x != w->x) return; /* passed without being held */
    if (before < 0.0 && after > before) share = before / (before - after);
    if (share > 1.0) share = 1.0;
    w->release = direction * clip(from + share * (to - from), h->limit);
    ++w->events;
    if (w->setting[SB_VIBRATION] > 0.0) {
        w->ring_time = (1.0 - share) * dt;
        w->ring_force = sqrt(block->parameter[SB_CONVERSION]) * w->release;
    }
}

/* Move along the path until friction holds; leaving a notch uphill is a release. */
static double slide(sb_world *w, const sb_block *block, const pull *h, double direction,
                    size_t *piece, double dt)
{
    const sb_path *p = h->path;
    const int ahead = direction > 0.0;
    double x = w->x;
    while (slides(h, direction, x, *piece)) {
        const size_t i = *piece, knot = ahead ? i + 1 : i, start = ahead ? i : i + 1;
        double far = p->x[knot];
        if (x == p->x[start])
            leave(w, block, h, direction, start, ahead ? p->first[i] : p->last[i], dt);
        if (drive(h, direction, far, p->z[knot], ahead ? p->last[i] : p->first[i]) > 0.0) {
            x = far;
            if (ahead ? i + 2 >= p->count : i == 0) break;
            *piece = ahead ? i + 1 : i - 1;
            continue;
        }
        for (int step = 0; step < BISECTIONS; ++step) {
            const double middle = 0.5 * (x + far);
            if (slides(h, direction, middle, i)) x = middle;
            else far = middle;
        }
        break;
    }
    return x;
}

/* Walk from a free proxy at (x, z) straight to the hand; stop where the path is met. */
static int land(const pull *h, double *at, double z, size_t *piece)
{
    const sb_path *p = h->path;
    const double x = *at, span = h->x - x;
    for (;;) {
        const size_t i = *piece;
        double end, line;
        if (span >= 0.0) end = p->x[i + 1] < h->x ? p->x[i + 1] : h->x;
        else end = p->x[i] > h->x ? p->x[i] : h->x;
        line = end == h->x ? h->z : z + (h->z - z) * (end - x) / span;
        if (line < height_at(p, end, i)) {
            double near;
            if (span >= 0.0) near = x > p->x[i] ? x : p->x[i];
            else near = x < p->x[i + 1] ? x : p->x[i + 1];
            for (int step = 0; step < BISECTIONS; ++step) {
                const double middle = 0.5 * (near + end);
                line = span == 0.0 ? h->z : z + (h->z - z) * (middle - x) / span;
                if (line < height_at(p, middle, i)) end = middle;
                else near = middle;
            }
            *at = near;
            return 1;
        }
        if (end == h->x || (span >= 0.0 ? i + 2 >= p->count : i == 0)) {
            *at = end;
            return 0;
        }
        *piece = span >= 0.0 ? i + 1 : i - 1;
    }
}

/* Whether the hand presses the proxy on either side of where it is. */
static int is_pressed(const pull *h, double x, size_t i)
{
    const sb_path *p = h->path;
    double ahead = slope_at(p, x, i), behind = ahead, along, down;
    if (x == p->x[i]) {
        if (i > 0) behind = p->last[i - 1];
    } else if (x == p->x[i + 1]) {
        behind = p->last[i];
        if (i + 2 < p->count) ahead = p->first[i + 1];
    }
    along = h->stiffness * (h->x - x);
    down = load_at(h, height_at(p, x, i));
    return !(along * ahead + down < 0.0 && along * behind + down < 0.0);
}

/* Slide in either direction. */
static void move(sb_world *w, const sb_block *block, const pull *h, double dt)
{
    const sb_path *p = h->path;
    const double x = w->x;
    const size_t i = w->piece;
    const int at_start = x == p->x[i], at_end = x == p->x[i + 1];
    size_t piece = at_end && i + 2 < p->count ? i + 1 : i;
    double to = slide(w, block, h, 1.0, &piece, dt);
    if (to == x) {
        piece = at_start && i > 0 ? i - 1 : i;
        to = slide(w, block, h, -1.0, &piece, dt);
    }
    if (to == x) return;
    w->x = to;
    w->piece = piece;
}

static double onto(const sb_path *p, double x)
{
    return x < p->x[0] ? p->x[0] : x > p->x[p->count - 1] ? p->x[p->count - 1] : x;
}

static pull prepare(const sb_block *block, double x, double z, double load)
{
    const sb_path *p = &block->path;
    const double *v = block->parameter;
    pull h;
    h.path = p;
    h.stiffness = v[SB_STIFFNESS] / v[SB_SCALE];
    h.wall = v[SB_WALL] / v[SB_SCALE];
    h.friction = v[SB_FRICTION];
    h.limit = v[SB_PULL_LIMIT];
    h.load = load;
    h.x = h.from_x = onto(p, x);
    h.z = h.from_z = z;
    h.landed = 1;
    return h;
}

static void push(sb_world *w, const sb_block *block, const double hand[3], const double velocity[3],
                 double load, double dt, double force[3])
{
    const double damping = block->parameter[SB_DAMPING];
    pull h = prepare(block, hand[0], hand[2], load);
    const sb_path *p = h.path;
    const int landed = !w->touching || !is_pressed(&h, w->x, w->piece);
    double down = 0.0, ring = 0.0;
    h.landed = landed;
    if (w->known) {
        h.from_x = onto(p, w->hand_x);
        h.from_z = w->hand_z;
    }
    force[0] = force[1] = force[2] = 0.0;
    if (w->fresh || (load >= 0.0 && !w->touching)) { /* the tip begins under the hand */
        w->x = h.x;
        w->piece = piece_at(p, h.x);
        w->fresh = 0;
    }
    if (landed && load >= 0.0) {
        w->touching = 1;
    } else if (landed) {
        double z = height_at(p, w->x, w->piece);
        if (!w->touching && w->height > z) z = w->height;
        w->touching = land(&h, &w->x, z, &w->piece);
        w->y = hand[1];
        w->height = hand[2];
    }
    if (w->touching) {
        double slack, most;
        move(w, block, &h, dt);
        w->pull = clip(h.stiffness * (h.x - w->x), h.limit);
        down = load_at(&h, height_at(p, w->x, w->piece));
        most = h.friction * (down > 0.0 ? down : 0.0);
        slack = clip(h.stiffness * (hand[1] - w->y), most);
        w->y = hand[1] - slack / h.stiffness;
        force[0] = -w->pull - damping * velocity[0];
        force[1] = -slack - damping * velocity[1];
        force[2] = down - damping * velocity[2];
    } else {
        w->pull = 0.0;
    }
    if (w->ring_time >= 0.0) {
        const double *v = block->parameter;
        ring = w->ring_force * exp(-w->ring_time / v[SB_DECAY]) *
               sin(TAU * v[SB_FREQUENCY] * w->ring_time);
        force[0] += ring;
        w->ring_time += dt;
    }
    w->hand_x = hand[0];
    w->hand_z = hand[2];
    w->known = 1;
    w->last.ring = ring;
    w->last.pull = w->pull;
    w->last.load = down;
    w->last.tip[0] = w->touching ? w->x : hand[0];
    w->last.tip[1] = w->touching ? w->y : hand[1];
    w->last.tip[2] = w->touching ? height_at(p, w->x, w->piece) : hand[2];
    w->last.release_force = w->release;
    w->last.release_energy = 0.5 * block->parameter[SB_CONVERSION] * w->release * w->release /
                             block->parameter[SB_STIFFNESS];
}

static void limit_force(sb_world *w, double force[3])
{
    const double most = w->setting[SB_FORCE_LIMIT];
    const double size = sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
    if (most > 0.0 && size > most) {
        for (int i = 0; i < 3; ++i) force[i] *= most / size;
        ++w->limited;
    }
}

static double step_of(double dt, double ramp)
{
    return ramp > 0.0 ? dt / ramp : 1.0;
}

static int finish(sb_world *w, sb_output *output, const double force[3], int state)
{
    *output = w->last;
    for (int i = 0; i < 3; ++i) output->force[i] = force[i];
    output->events = w->events;
    output->faults = w->faults;
    output->limited = w->limited;
    output->late = w->late;
    output->block = w->active;
    output->touching = w->touching;
    output->state = state;
    output->reserved = 0;
    return state;
}

/* Whether a vector is one of a hand: numbers, and not beyond all measure. */
static int is_sane(const double vector[3])
{
    for (int i = 0; i < 3; ++i)
        if (!(fabs(vector[i]) <= FARTHEST)) return 0;
    return 1;
}

/* Position, velocity or time is not a number: the last good force, ramped to zero. A force that is
 * off stays off, and what lasts as long as the watchdog waits is a hand that was lost. */
static int bear_fault(sb_world *w, double dt, sb_output *output)
{
    double force[3];
    const double time = isfinite(dt) && dt > 0.0 ? dt : SHORTEST;
    ++w->faults;
    w->away += time;
    if (w->setting[SB_WATCHDOG] > 0.0 && w->away > w->setting[SB_WATCHDOG]) sb_hold(w);
    if (w->held) {
        memset(force, 0, sizeof force);
        memset(&w->last, 0, sizeof w->last);
        return finish(w, output, force, SB_HELD);
    }
    w->ramp = w->setting[SB_RAMP];
    for (int i = 0; i < 3; ++i) force[i] = w->gain * w->good[i];
    w->gain -= step_of(time, w->ramp);
    if (w->gain < 0.0) w->gain = 0.0;
    return finish(w, output, force, SB_FAULT);
}

static int is_free(const sb_block *block, const double hand[3])
{
    const pull h = prepare(block, hand[0], hand[2], -1.0);
    return hand[2] > height_at(h.path, h.x, piece_at(h.path, h.x));
}

void sb_hold(sb_world *w)
{
    if (!w->held) ++w->late;
    w->held = 1;
    w->gain = 0.0;
    w->known = 0;
    memset(w->good, 0, sizeof w->good);
}

/* Put the tip where the hand is, free; the force grows from zero in a time. */
static void put_free(sb_world *w, const double hand[3], double ramp)
{
    const sb_path *p = &w->blocks[w->active].path;
    w->x = onto(p, hand[0]);
    w->y = hand[1];
    w->height = hand[2];
    w->piece = piece_at(p, w->x);
    w->pull = w->ring_force = 0.0;
    w->ring_time = -1.0;
    w->touching = w->held = w->fresh = w->known = 0;
    w->ramp = ramp;
    w->gain = ramp > 0.0 ? 0.0 : 1.0;
    memset(w->good, 0, sizeof w->good);
    memset(&w->last, 0, sizeof w->last);
}

/* Whether the hand came from where it was seen last faster than a hand moves. */
static int has_jumped(const sb_world *w, const double seen[3], double dt)
{
    const double time = w->away + dt > SHORTEST ? w->away + dt : SHORTEST;
    double square = 0.0;
    if (!(w->setting[SB_JUMP] > 0.0) || !w->was_seen) return 0;
    for (int i = 0; i < 3; ++i) square += (seen[i] - w->seen[i]) * (seen[i] - w->seen[i]);
    return sqrt(square) > w->setting[SB_JUMP] * time;
}

/* Hold where the time since the last good tick, or the way since then, is too long. */
static void watch(sb_world *w, const double seen[3], double dt)
{
    const double waits = w->setting[SB_WATCHDOG];
    if ((waits > 0.0 && w->away + dt > waits) || has_jumped(w, seen, dt)) sb_hold(w);
    memcpy(w->seen, seen, sizeof w->seen);
    w->was_seen = 1;
    w->away = 0.0;
}

int sb_tick_seen(sb_world *w, const double seen[3], const double hand[3], const double velocity[3],
                 double load, double dt, sb_output *output)
{
    const double zero[3] = {0.0, 0.0, 0.0};
    double force[3], gain;
    const sb_block *block;
    if (!w || !seen || !hand || !velocity || !output || w->count == 0) {
        if (output) memset(output, 0, sizeof *output);
        return SB_ERROR_ARGUMENT;
    }
    block = &w->blocks[w->active];
    if (!(isfinite(dt) && dt >= 0.0) || !is_sane(seen) || !is_sane(hand) || !is_sane(velocity))
        return bear_fault(w, dt, output);
    watch(w, seen, dt);
    if (w->held) {
        if (load >= 0.0 || is_free(block, hand)) {
            put_free(w, hand, w->setting[SB_RAMP]);
        } else {
            memset(&w->last, 0, sizeof w->last);
            return finish(w, output, zero, SB_HELD);
        }
    }
    push(w, block, hand, velocity, load, dt, force);
    limit_force(w, force);
    gain = w->gain;
    for (int i = 0; i < 3; ++i) {
        if (!isfinite(force[i])) force[i] = 0.0;
        w->good[i] = force[i];
        force[i] *= gain;
    }
    if (gain < 1.0) {
        w->gain = gain + step_of(dt, w->ramp);
        if (w->gain > 1.0) w->gain = 1.0;
    }
    return finish(w, output, force, SB_RUNNING);
}

int sb_tick(sb_world *world, const double hand[3], const double velocity[3], double dt,
            sb_output *output)
{
    return sb_tick_seen(world, hand, hand, velocity, -1.0, dt, output);
}

int sb_tick_loaded(sb_world *world, double hand_x, double velocity_x, double dt, sb_output *output)
{
    const double hand[3] = {hand_x, 0.0, 0.0}, velocity[3] = {velocity_x, 0.0, 0.0};
    double load = -1.0;
    if (world && world->count > 0) load = world->blocks[world->active].parameter[SB_LOAD];
    return sb_tick_seen(world, hand, hand, velocity, load, dt, output);
}

/* Whether a path holds the tip at a knot. */
static int is_caught(const sb_path *p, size_t knot)
{
    return p->up[knot] || p->down[knot];
}

void sb_turn_to(sb_world *world, int block)
{
    const sb_path *from = &world->blocks[world->active].path, *to = &world->blocks[block].path;
    const size_t i = world->piece;
    const double x = world->x;
    const double near = 0.2 * world->blocks[block].parameter[SB_TIP_RADIUS] *
                        world->blocks[block].parameter[SB_SCALE];
    const int caught = (x == from->x[i] && is_caught(from, i)) ||
                       (x == from->x[i + 1] && is_caught(from, i + 1));
    world->active = block;
    world->x = x < to->x[0] ? to->x[0] : x > to->x[to->count - 1] ? to->x[to->count - 1] : x;
    world->piece = piece_at(to, world->x);
    if (!world->touching || !caught) return;
    /* a tip that rests in the notch rests in that of the section beside, a little to one side */
    for (size_t k = 0; k + 1 < to->count; ++k)
        if (is_caught(to, k) && fabs(to->x[k] - x) < near &&
            (world->x == x || fabs(to->x[k] - x) < fabs(world->x - x))) {
            world->x = to->x[k];
            world->piece = k;
        }
}

int sb_reset(sb_world *world, const double hand[3])
{
    if (!world || !hand || world->count == 0) return SB_ERROR_ARGUMENT;
    if (!isfinite(hand[0]) || !isfinite(hand[1]) || !isfinite(hand[2]))
        return sb_fail(world, SB_ERROR_ARGUMENT, "the hand must be at a finite position");
    put_free(world, hand, world->setting[SB_RISE]);
    world->was_seen = 0;
    world->away = 0.0;
    world->events = world->faults = world->limited = world->late = 0;
    world->release = 0.0;
    return SB_OK;
}

int sb_choose(sb_world *world, int block)
{
    double hand[3] = {0.0, 0.0, 0.0};
    int result;
    if (!world || block < 0 || block >= world->count)
        return world ? sb_fail(world, SB_ERROR_INDEX, "there is no block %d", block)
                     : SB_ERROR_ARGUMENT;
    world->active = block;
    hand[2] = world->blocks[block].path.z[0];
    result = sb_reset(world, hand);
    world->fresh = 1;
    return result;
}

int sb_predict(const sb_world *world, int block, int direction, sb_prediction *prediction)
{
    const sb_path *p;
    const double *v;
    size_t best = 0;
    double steepest = -STEEPEST;
    if (!world || !prediction || block < 0 || block >= world->count ||
        (direction != 1 && direction != -1))
        return SB_ERROR_ARGUMENT;
    p = &world->blocks[block].path;
    v = world->blocks[block].parameter;
    for (size_t i = 0; i + 1 < p->count; ++i) {
        const double rise = direction > 0 ? p->first[i] : -p->last[i];
        if (rise > steepest) {
            steepest = rise;
            best = direction > 0 ? i : i + 1;
        }
    }
    memset(prediction, 0, sizeof *prediction);
    prediction->position = p->x[best];
    prediction->height = p->z[best];
    prediction->force = prediction->energy = NAN;
    prediction->angle = steepest >= STEEPEST ? 0.25 * TAU : atan(steepest > 0.0 ? steepest : 0.0);
    if (prediction->angle <= CATCH) {
        prediction->angle = 0.0;
        prediction->status = SB_NO_CATCH;
    } else if (steepest >= STEEPEST) {
        prediction->status = SB_TOO_HIGH;
    } else if (prediction->angle + atan(v[SB_FRICTION]) >= 0.25 * TAU) {
        prediction->status = SB_LOCKED;
    } else {
        prediction->force = v[SB_LOAD] * tan(prediction->angle + atan(v[SB_FRICTION]));
        prediction->status = prediction->force > v[SB_PULL_LIMIT] ? SB_BEYOND : SB_RELEASES;
        if (prediction->status == SB_RELEASES)
            prediction->energy = 0.5 * v[SB_CONVERSION] * prediction->force * prediction->force /
                                 v[SB_STIFFNESS];
    }
    return SB_OK;
}

double sb_path_height(const sb_world *world, int block, double x)
{
    const sb_path *p;
    if (!world || block < 0 || block >= world->count || !isfinite(x)) return NAN;
    p = &world->blocks[block].path;
    if (x < p->x[0]) x = p->x[0];
    if (x > p->x[p->count - 1]) x = p->x[p->count - 1];
    return height_at(p, x, piece_at(p, x));
}
