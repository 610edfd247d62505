/* What the sources of libstepblocks share. Not part of the interface. */
#ifndef SB_INTERNAL_H
#define SB_INTERNAL_H

#include "stepblocks.h"

#define SB_NAME_LENGTH 80
#define SB_MESSAGE_LENGTH 240

/* Path of the ball's centre: one knot per place, slopes at both ends of every piece. What
 * belongs to a piece stands at the knot where it begins. */
typedef struct {
    size_t count;
    double *x, *z, *first, *last;
    unsigned char *up, *down; /* whether a knot holds a drag towards +x, -x */
} sb_path;

typedef struct {
    char name[SB_NAME_LENGTH];
    double parameter[SB_BLOCK_PARAMETERS];
    double *discs, *lines;
    size_t disc_count, line_count;
    sb_path path;
    int placed, line; /* whether it lies on a margin line, and with which load it came */
    double place[3], across[3], outward[3]; /* in the axes of the scan, unmagnified */
} sb_block;

struct sb_world {
    sb_block *blocks;
    int count, room, active;
    double setting[SB_SETTINGS];
    /* the tip: place, height of a free one, spring force of the last tick */
    double x, y, height, pull, ring_time, ring_force, release;
    double hand_x, hand_z; /* of the hand at the last tick, in the section [m] */
    int known;             /* whether there was one since the tip was put free */
    size_t piece;
    int touching, fresh; /* fresh: the next tick puts the tip where the hand is */
    uint32_t events, faults, limited, late;
    double seen[3]; /* the hand at the last good tick, as it was given [m] */
    int was_seen;
    double away; /* how long no tick has been good [s] */
    int held;
    double gain; /* 0 to 1, of the force after a start or a fault */
    double ramp; /* how long it grows [s] */
    double good[3]; /* last force of a good tick [N] */
    sb_output last; /* of the last good tick */
    int loads, riding; /* files so far; whether the tip goes along a margin line */
    double way; /* along the line at the last tick [m] */
    double origin[3], axes[3][3]; /* of the section there, in the axes of the scan */
    char message[SB_MESSAGE_LENGTH];
};

int sb_path_build(sb_path *path, const double *discs, size_t disc_count, const double *lines,
                  size_t line_count, double ball_radius, double scale);
void sb_path_free(sb_path *path);
void sb_block_free(sb_block *block);
int sb_fail(sb_world *world, int code, const char *format, ...);
int sb_check_parameter(sb_world *world, int parameter, double value);
int sb_parameter_named(const char *name, size_t length);
void sb_start_block(sb_block *block);
int sb_put_block(sb_world *world, const sb_block *block);
void sb_turn_to(sb_world *world, int block); /* to the section beside, the tip in contact */
void sb_hold(sb_world *world); /* take the force off until the hand has let go */
/* sb_tick with the hand as it was given beside the hand in the section, under a load [N] or, where
 * that is negative, by its height */
int sb_tick_seen(sb_world *world, const double seen[3], const double hand[3],
                 const double velocity[3], double load, double dt, sb_output *output);
double sb_read_number(const char *text, const char **end);

#endif
