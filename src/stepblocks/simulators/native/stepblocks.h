/* libstepblocks: the force and the ring of step blocks and margins, one call per servo tick.
 *
 * C99 and C++, plain C ABI. SI units everywhere: m, N, s, Hz, N/m. The frame is that of the
 * blocks: x across the edge (positive up the step), y along the edge, z up; the edge is at x =
 * 0, the lower face at z = 0. A block shown with magnification S has lengths times S, spring
 * divided by S, and the forces of the real size.
 *
 * The law: a proxy (the centre of the tip's ball) slides on the path that the ball's centre
 * takes over the surface. The hand pulls it through the spring of the tool, friction holds it.
 * It slides where F_x (1 - mu t) > F_z (t + mu), t the slope of the path; this is equation (1)
 * of the paper without its division, so a locked tip never moves. Leaving a notch uphill is a
 * release: it starts a decaying ring whose amplitude is sqrt(C_v) times the force in the spring
 * at that moment. The hand goes straight from tick to tick, and the moment is found on its way: a
 * release is the same at any rate and speed.
 *
 * Functions that return int return a negative sb_error when they fail; sb_message says why. Only
 * sb_create, sb_load, sb_add_block and sb_set(SB_TIP_RADIUS or SB_SCALE) allocate memory:
 * sb_tick never does. A world is used by one thread at a time; use one world per hand. */
#ifndef STEPBLOCKS_H
#define STEPBLOCKS_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32) && defined(SB_BUILD)
#define SB_API __declspec(dllexport)
#elif defined(_WIN32)
#define SB_API __declspec(dllimport)
#else
#define SB_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define SB_ABI_VERSION 1

typedef struct sb_world sb_world;

enum sb_error {
    SB_OK = 0,
    SB_ERROR_ARGUMENT = -1, /* a value outside its range, or a null pointer */
    SB_ERROR_MEMORY = -2,
    SB_ERROR_FILE = -3,   /* cannot be opened or read */
    SB_ERROR_FORMAT = -4, /* is not a file of blocks, or a line of it is wrong */
    SB_ERROR_INDEX = -5   /* no such block or parameter */
};

/* Parameters of one block. */
enum sb_parameter {
    SB_TIP_RADIUS = 0, /* R of the ball, unmagnified [m] */
    SB_LOAD = 1,       /* normal load of sb_tick_loaded and sb_predict [N] */
    SB_FRICTION = 2,   /* coefficient mu [1] */
    SB_STIFFNESS = 3,  /* spring of the tool along the drag, unmagnified k [N/m] */
    SB_WALL = 4,       /* spring along the load, unmagnified [N/m] */
    SB_CONVERSION = 5, /* share C_v of the stored energy that rings, at most 1 [1] */
    SB_FREQUENCY = 6,  /* of the ring [Hz] */
    SB_DECAY = 7,      /* time constant of the ring's amplitude [s] */
    SB_DAMPING = 8,    /* of the hand's velocity in contact [N s/m] */
    SB_SCALE = 9,      /* magnification S [1] */
    SB_PULL_LIMIT = 10, /* force at which tool or hand give up: the tip does not slip beyond [N] */
    SB_BLOCK_PARAMETERS = 11
};

/* Settings of a world: the safety of hand and device. Zero switches one off. */
enum sb_setting {
    SB_FORCE_LIMIT = 0, /* largest force on the hand; its direction is kept [N], 3 at first */
    SB_RAMP = 1,        /* in which a force vanishes after a fault, and comes back [s], 0.01 */
    SB_RISE = 2,        /* in which the force grows after sb_reset or sb_choose [s], 0.1 */
    SB_WATCHDOG = 3,    /* a later tick switches the force off until the hand lets go [s], 0.05 */
    SB_VIBRATION = 4,   /* 1: a release rings; 0: the paper's condition without vibration */
    SB_JUMP = 5,        /* a hand that is faster between two ticks jumped [m/s], 10 */
    SB_SETTINGS = 6
};

/* What a tick is, by what it was given:
 *
 *                                  running           fault              held
 * position or velocity that is     fault             fault              held, no force
 *   no number, or beyond 1 km
 * dt that is negative or no number fault             fault              held, no force
 * dt of 0: no time has passed      running           running, weakened  held, no force
 * a jump (SB_JUMP)                 held, no force    held, no force     held, no force
 * no good tick for SB_WATCHDOG     held, no force    held, no force     held, no force
 * a hand inside the block          running           running, growing   held, no force
 * a hand that has left the surface running           running, growing   running, growing
 *
 * In a fault the last good force vanishes within SB_RAMP; growing takes SB_RAMP, and SB_RISE after
 * sb_reset or sb_choose. sb_tick_loaded has no surface to leave: its force grows at once again. */
enum sb_state {
    SB_RUNNING = 0,
    SB_FAULT = 1, /* an input is not a number: the last good force, ramped to zero */
    SB_HELD = 2   /* a late tick or a jump: no force until the hand has left the surface */
};

typedef struct sb_output {
    double force[3];       /* on the hand: all that the device should render [N] */
    double ring;           /* the share of force[0] that is the ring [N] */
    double pull;           /* in the spring along x, positive where the hand pulls to +x [N] */
    double load;           /* normal force [N] */
    double tip[3];         /* centre of the ball [m] */
    double release_force;  /* spring force at the last release, signed [N]; 0 before the first */
    double release_energy; /* of that ring, E_v [J] */
    uint32_t events;       /* releases since the last reset */
    uint32_t faults;       /* ticks with an input that is not a number, or a negative dt */
    uint32_t limited;      /* ticks at which the force limit acted */
    uint32_t late;         /* times that a late tick or a jump took the force off */
    int32_t block;         /* that is active */
    int32_t touching;      /* 1 in contact */
    int32_t state;         /* sb_state */
    int32_t reserved;
} sb_output;

/* What equations (1) and (2) say of one drag. */
typedef struct sb_prediction {
    double position; /* of the ball's centre at the release, magnified [m] */
    double height;
    double angle;  /* critical angle [rad] */
    double force;  /* pulling force at the release [N]; NaN where there is none */
    double energy; /* of the ring [J]; NaN where there is none */
    int32_t status; /* sb_status */
    int32_t reserved;
} sb_prediction;

enum sb_status {
    SB_RELEASES = 0,
    SB_LOCKED = 1,   /* no pull lifts the tip over this edge */
    SB_TOO_HIGH = 2, /* the ball meets the riser */
    SB_NO_CATCH = 3, /* nothing catches in this direction */
    SB_BEYOND = 4    /* it takes more than SB_PULL_LIMIT */
};

SB_API int sb_abi_version(void);
SB_API sb_world *sb_create(void); /* NULL without memory */
SB_API void sb_destroy(sb_world *world);
SB_API const char *sb_message(const sb_world *world); /* of the last failure; never NULL */

/* Add the blocks of a file that `stepblocks export --for native` wrote; its path is in UTF-8 on
 * every system. Returns how many were added; a file with a mistake adds none. A file that was
 * written for a device also sets SB_FORCE_LIMIT. */
SB_API int sb_load(sb_world *world, const char *path);

/* Add a block by its outline: discs (x, z, radius; radius 0 is a sharp corner) and lines (x0,
 * z0, x1, z1), whose upper envelope grown by the ball is the path. Returns its index. */
SB_API int sb_add_block(sb_world *world, const char *name, const double *discs, size_t disc_count,
                        const double *lines, size_t line_count);

SB_API int sb_count(const sb_world *world);
SB_API const char *sb_name(const sb_world *world, int block); /* NULL where there is none */
SB_API int sb_find(const sb_world *world, const char *name);

/* Change one parameter of a block, between ticks. Tip radius and scale rebuild the path. */
SB_API int sb_set(sb_world *world, int block, int parameter, double value);
SB_API double sb_get(const sb_world *world, int block, int parameter); /* NaN where there is none */
SB_API int sb_configure(sb_world *world, int setting, double value);
SB_API double sb_setting_of(const sb_world *world, int setting);

/* Make a block active; the next tick begins under the hand. */
SB_API int sb_choose(sb_world *world, int block);

/* Put the tip where the hand is, free. */
SB_API int sb_reset(sb_world *world, const double hand[3]);

/* One servo tick: the force on a hand at a position with a velocity, dt after the last tick; 0
 * where the clock has not moved on. The output is always written and always finite. Returns an
 * sb_state, or SB_ERROR_ARGUMENT for a null pointer or a world without blocks. */
SB_API int sb_tick(sb_world *world, const double hand[3], const double velocity[3], double dt,
                   sb_output *output);

/* The same for a whole tooth: the blocks are the stations of a margin line (`frame` in the file,
 * or sb_place), loaded together and in order. Hand, velocity, force and tip are in the axes of
 * the scan, magnified as the blocks are. The section is that of the place of the tip along the
 * line, and answers within 1 mm on either side of the margin; farther away, and deeper, there is
 * no force. output->block is the station; pull and ring are across the margin, load is outwards. */
SB_API int sb_tick_tooth(sb_world *world, const double hand[3], const double velocity[3], double dt,
                         sb_output *output);

/* Put a block on a margin line: its place, unmagnified [m], and the axes across the margin
 * towards the crown and outwards, of any length, at right angles. */
SB_API int sb_place(sb_world *world, int block, const double place[3], const double across[3],
                    const double outward[3]);

/* The same for an input without a height (mouse, gamepad, linear stage): the load is SB_LOAD. */
SB_API int sb_tick_loaded(sb_world *world, double hand_x, double velocity_x, double dt,
                          sb_output *output);

/* Predict the drag of a block towards +x (direction 1) or -x (-1), by equations (1) and (2). */
SB_API int sb_predict(const sb_world *world, int block, int direction, sb_prediction *prediction);

/* Height of the path of the ball's centre of a block [m]. */
SB_API double sb_path_height(const sb_world *world, int block, double x);
SB_API int sb_path_knots(const sb_world *world, int block);

#ifdef __cplusplus
}
#endif
#endif
