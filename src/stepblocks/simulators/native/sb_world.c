/* Worlds, blocks and their parameters. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sb_internal.h"

static const struct {
    const char *name;
    double initial;
    int positive; /* 1: above zero; 0: zero is allowed */
    double most;
} PARAMETERS[SB_BLOCK_PARAMETERS] = {
    {"tip_radius_m", 125e-6, 1, 1e300},     {"normal_load_n", 1.0, 1, 1e300},
    {"friction", 0.15, 0, 1e300},           {"stiffness_n_per_m", 9.81e3, 1, 1e300},
    {"wall_n_per_m", 9.81e3, 1, 1e300},     {"conversion", 0.2, 0, 1.0},
    {"frequency_hz", 300.0, 1, 1e300},      {"decay_s", 0.01424, 1, 1e300},
    {"damping_n_s_per_m", 0.0, 0, 1e300},   {"scale", 1.0, 1, 1e300},
    {"pull_limit_n", 1e300, 1, 1e300},
};

int sb_abi_version(void)
{
    return SB_ABI_VERSION;
}

int sb_fail(sb_world *world, int code, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(world->message, sizeof world->message, format, arguments);
    va_end(arguments);
    return code;
}

const char *sb_message(const sb_world *world)
{
    return world ? world->message : "there is no world: sb_create returned NULL";
}

sb_world *sb_create(void)
{
    sb_world *world = calloc(1, sizeof *world);
    if (!world) return NULL;
    world->ring_time = -1.0;
    world->gain = 1.0;
    world->setting[SB_FORCE_LIMIT] = 3.0;
    world->setting[SB_RAMP] = 0.01;
    world->setting[SB_RISE] = 0.1;
    world->setting[SB_JUMP] = 10.0;
    world->setting[SB_WATCHDOG] = 0.05;
    world->setting[SB_VIBRATION] = 1.0;
    return world;
}

void sb_block_free(sb_block *block)
{
    free(block->discs);
    free(block->lines);
    sb_path_free(&block->path);
}

void sb_destroy(sb_world *world)
{
    if (!world) return;
    for (int i = 0; i < world->count; ++i) sb_block_free(&world->blocks[i]);
    free(world->blocks);
    free(world);
}

int sb_count(const sb_world *world)
{
    return world ? world->count : 0;
}

const char *sb_name(const sb_world *world, int block)
{
    return world && block >= 0 && block < world->count ? world->blocks[block].name : NULL;
}

int sb_find(const sb_world *world, const char *name)
{
    for (int i = 0; world && name && i < world->count; ++i)
        if (strcmp(world->blocks[i].name, name) == 0) return i;
    return SB_ERROR_INDEX;
}

int sb_path_knots(const sb_world *world, int block)
{
    if (!world || block < 0 || block >= world->count) return SB_ERROR_INDEX;
    return (int)world->blocks[block].path.count;
}

int sb_check_parameter(sb_world *world, int parameter, double value)
{
    if (parameter < 0 || parameter >= SB_BLOCK_PARAMETERS)
        return sb_fail(world, SB_ERROR_INDEX, "there is no parameter %d", parameter);
    if (!isfinite(value) || value < 0.0 || (PARAMETERS[parameter].positive && value == 0.0))
        return sb_fail(world, SB_ERROR_ARGUMENT, "%s must be %s and finite, got %g",
                       PARAMETERS[parameter].name,
                       PARAMETERS[parameter].positive ? "positive" : "not negative", value);
    if (value > PARAMETERS[parameter].most)
        return sb_fail(world, SB_ERROR_ARGUMENT, "%s must be at most %g, got %g",
                       PARAMETERS[parameter].name, PARAMETERS[parameter].most, value);
    return SB_OK;
}

int sb_parameter_named(const char *name, size_t length)
{
    for (int i = 0; i < SB_BLOCK_PARAMETERS; ++i)
        if (strlen(PARAMETERS[i].name) == length && strncmp(PARAMETERS[i].name, name, length) == 0)
            return i;
    return SB_ERROR_INDEX;
}

static int rebuild(sb_world *world, sb_block *block)
{
    const int result =
        sb_path_build(&block->path, block->discs, block->disc_count, block->lines,
                      block->line_count, block->parameter[SB_TIP_RADIUS],
                      block->parameter[SB_SCALE]);
    if (result == SB_ERROR_MEMORY) return sb_fail(world, result, "memory is short");
    if (result != SB_OK)
        return sb_fail(world, result, "%s: the outline must have a width", block->name);
    return SB_OK;
}

int sb_set(sb_world *world, int block, int parameter, double value)
{
    sb_block *one;
    double before;
    int result;
    if (!world) return SB_ERROR_ARGUMENT;
    if (block < 0 || block >= world->count)
        return sb_fail(world, SB_ERROR_INDEX, "there is no block %d", block);
    result = sb_check_parameter(world, parameter, value);
    if (result != SB_OK) return result;
    one = &world->blocks[block];
    before = one->parameter[parameter];
    one->parameter[parameter] = value;
    if ((parameter != SB_TIP_RADIUS && parameter != SB_SCALE) || value == before) return SB_OK;
    result = rebuild(world, one);
    if (result != SB_OK) one->parameter[parameter] = before;
    else if (block == world->active) sb_choose(world, block); /* the tip has lost its path */
    return result;
}

double sb_get(const sb_world *world, int block, int parameter)
{
    if (!world || block < 0 || block >= world->count || parameter < 0 ||
        parameter >= SB_BLOCK_PARAMETERS)
        return NAN;
    return world->blocks[block].parameter[parameter];
}

int sb_configure(sb_world *world, int setting, double value)
{
    if (!world) return SB_ERROR_ARGUMENT;
    if (setting < 0 || setting >= SB_SETTINGS)
        return sb_fail(world, SB_ERROR_INDEX, "there is no setting %d", setting);
    if (!isfinite(value) || value < 0.0)
        return sb_fail(world, SB_ERROR_ARGUMENT,
                       "a setting must be finite and not negative, got %g", value);
    world->setting[setting] = value;
    if (setting == SB_RISE && world->fresh) { /* nothing was felt of the block yet */
        world->ramp = value;
        world->gain = value > 0.0 ? 0.0 : 1.0;
    }
    return SB_OK;
}

double sb_setting_of(const sb_world *world, int setting)
{
    return world && setting >= 0 && setting < SB_SETTINGS ? world->setting[setting] : NAN;
}

void sb_start_block(sb_block *block)
{
    memset(block, 0, sizeof *block);
    for (int i = 0; i < SB_BLOCK_PARAMETERS; ++i) block->parameter[i] = PARAMETERS[i].initial;
}

/* Take over a block whose outline is complete; on failure the caller keeps it. */
int sb_put_block(sb_world *world, const sb_block *block)
{
    sb_block made = *block;
    int result;
    if (sb_find(world, made.name) >= 0)
        return sb_fail(world, SB_ERROR_ARGUMENT, "names must differ, got %s twice", made.name);
    if (world->count == world->room) {
        const int room = world->room ? 2 * world->room : 16;
        sb_block *more = realloc(world->blocks, (size_t)room * sizeof *more);
        if (!more) return sb_fail(world, SB_ERROR_MEMORY, "memory is short");
        world->blocks = more;
        world->room = room;
    }
    result = rebuild(world, &made);
    if (result != SB_OK) return result;
    world->blocks[world->count++] = made;
    if (world->count == 1) sb_choose(world, 0);
    return world->count - 1;
}

static double *copy(const double *values, size_t count)
{
    double *made = malloc((count ? count : 1) * sizeof *made);
    if (made && count) memcpy(made, values, count * sizeof *made);
    return made;
}

int sb_add_block(sb_world *world, const char *name, const double *discs, size_t disc_count,
                 const double *lines, size_t line_count)
{
    sb_block block;
    int result;
    if (!world || !name || !*name || !lines || line_count == 0 || (disc_count && !discs))
        return world ? sb_fail(world, SB_ERROR_ARGUMENT, "a block must have a name and lines")
                     : SB_ERROR_ARGUMENT;
    if (strlen(name) >= SB_NAME_LENGTH)
        return sb_fail(world, SB_ERROR_ARGUMENT, "a name must be shorter than %d", SB_NAME_LENGTH);
    for (size_t i = 0; i < 3 * disc_count; ++i)
        if (!isfinite(discs[i]) || (i % 3 == 2 && discs[i] < 0.0))
            return sb_fail(world, SB_ERROR_ARGUMENT, "%.60s: a disc must be finite", name);
    for (size_t i = 0; i < 4 * line_count; ++i)
        if (!isfinite(lines[i]) || (i % 4 == 2 && !(lines[i] > lines[i - 2])))
            return sb_fail(world, SB_ERROR_ARGUMENT, "%.60s: a line must lead to a larger x", name);
    sb_start_block(&block);
    strcpy(block.name, name);
    block.discs = copy(discs, 3 * disc_count);
    block.lines = copy(lines, 4 * line_count);
    block.disc_count = disc_count;
    block.line_count = line_count;
    result = block.discs && block.lines ? sb_put_block(world, &block)
                                        : sb_fail(world, SB_ERROR_MEMORY, "memory is short");
    if (result < 0) {
        free(block.discs);
        free(block.lines);
    }
    return result;
}

/* A decimal number whatever the locale says of the decimal point. Writes where it ended. */
double sb_read_number(const char *text, const char **end)
{
    const char *at = text;
    double value = 0.0, sign = 1.0;
    int exponent = 0, digits = 0;
    *end = text;
    if (*at == '+' || *at == '-') sign = *at++ == '-' ? -1.0 : 1.0;
    for (int point = 0; (*at >= '0' && *at <= '9') || (*at == '.' && !point); ++at) {
        if (*at == '.') {
            point = 1;
            continue;
        }
        value = 10.0 * value + (*at - '0');
        exponent -= point;
        ++digits;
    }
    if (!digits || digits > 40) return NAN;
    if (*at == 'e' || *at == 'E') {
        int more = 0, negative = 0;
        ++at;
        if (*at == '+' || *at == '-') negative = *at++ == '-';
        if (*at < '0' || *at > '9') return NAN;
        while (*at >= '0' && *at <= '9' && more < 1000) more = 10 * more + (*at++ - '0');
        exponent += negative ? -more : more;
    }
    *end = at;
    if (exponent < -300) return sign * (value * pow(10.0, exponent + 300)) * 1e-300;
    return exponent < 0 ? sign * value / pow(10.0, -exponent) : sign * value * pow(10.0, exponent);
}
