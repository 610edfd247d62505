/* The file of blocks that `stepblocks export --for native` writes: lines of text, SI units.
 *
 *   stepblocks-blocks 1
 *   force_limit_n 7             SB_FORCE_LIMIT [N]; only where it was written for a device
 *   block step-050              then any of the parameters, one a line, such as
 *   tip_radius_m 0.000125
 *   frame 0 0 0 1 0 0 0 0 1     place [m], axis across, axis outwards; of the stations of a tooth
 *   discs 1                     x z radius [m], one disc a line
 *   0 5e-05 0
 *   lines 2                     x0 z0 x1 z1 [m], one line a line
 *   -0.005 0 0 0
 *   0 5e-05 0.005 5e-05
 *   end
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#endif

#include "sb_internal.h"

#define MOST_BYTES (64L * 1024L * 1024L)
#define MOST_SHAPES 20000

typedef struct {
    sb_world *world;
    const char *name, *at; /* of the file; of the next line */
    int number;            /* of the line at hand */
    const char *line;
    size_t length;
    double force_limit; /* that the file sets [N]; negative for none */
} reader;

static int wrong(const reader *r, const char *what)
{
    return sb_fail(r->world, SB_ERROR_FORMAT, "%.120s, line %d: %s", r->name, r->number, what);
}

/* The next line that is not empty; 0 at the end. */
static int next_line(reader *r)
{
    do {
        if (!*r->at) return 0;
        r->line = r->at;
        r->length = strcspn(r->line, "\r\n");
        r->at = r->line + r->length;
        if (*r->at == '\r') ++r->at;
        if (*r->at == '\n') ++r->at;
        ++r->number;
    } while (r->length == 0);
    return 1;
}

/* The rest of a line that begins with a word, or NULL. */
static const char *after(const reader *r, const char *word)
{
    const size_t length = strlen(word);
    if (r->length <= length || strncmp(r->line, word, length) != 0 || r->line[length] != ' ')
        return NULL;
    return r->line + length + 1;
}

static int read_numbers(reader *r, double *values, size_t count)
{
    const char *at = r->line, *stop = r->line + r->length;
    for (size_t i = 0; i < count; ++i) {
        const char *end;
        while (at < stop && *at == ' ') ++at;
        values[i] = sb_read_number(at, &end);
        if (end == at || end > stop || !isfinite(values[i]))
            return wrong(r, "a number is expected");
        at = end;
    }
    return at == stop ? SB_OK : wrong(r, "there is more on this line than is expected");
}

/* A table of as many rows as its heading says. */
static int read_table(reader *r, const char *rest, size_t columns, double **values, size_t *count)
{
    const char *end;
    const double rows = sb_read_number(rest, &end);
    if (!(rows >= 0.0 && rows <= MOST_SHAPES) || rows != floor(rows) || end != r->line + r->length)
        return wrong(r, "how many rows follow must be a whole number up to 20000");
    if (*values) return wrong(r, "a block has one table of each kind");
    *count = (size_t)rows;
    *values = malloc((*count * columns + 1) * sizeof **values);
    if (!*values) return sb_fail(r->world, SB_ERROR_MEMORY, "memory is short");
    for (size_t i = 0; i < *count; ++i) {
        double *row = *values + i * columns;
        int result;
        if (!next_line(r)) return wrong(r, "the file ends within a table");
        result = read_numbers(r, row, columns);
        if (result != SB_OK) return result;
        if (columns == 3 && row[2] < 0.0) return wrong(r, "a radius must not be negative");
        if (columns == 4 && !(row[2] > row[0])) return wrong(r, "a line must lead to a larger x");
    }
    return SB_OK;
}

static int read_parameter(reader *r, sb_block *block)
{
    const char *space = memchr(r->line, ' ', r->length), *end;
    const int which = space ? sb_parameter_named(r->line, (size_t)(space - r->line)) : -1;
    double value;
    if (which < 0) return wrong(r, "a parameter, discs, lines or end is expected");
    value = sb_read_number(space + 1, &end);
    if (end != r->line + r->length) return wrong(r, "a number is expected");
    if (sb_check_parameter(r->world, which, value) != SB_OK) {
        char why[SB_MESSAGE_LENGTH];
        snprintf(why, sizeof why, "%.100s", r->world->message);
        return wrong(r, why);
    }
    block->parameter[which] = value;
    return SB_OK;
}

static int read_frame(reader *r, const char *rest, sb_block *block)
{
    double values[9];
    int result;
    r->length -= (size_t)(rest - r->line);
    r->line = rest;
    result = read_numbers(r, values, 9);
    if (result != SB_OK) return result;
    for (int i = 0; i < 3; ++i) {
        block->place[i] = values[i];
        block->across[i] = values[3 + i];
        block->outward[i] = values[6 + i];
    }
    block->placed = 1;
    block->line = r->world->loads;
    return SB_OK;
}

static int read_block(reader *r, const char *name)
{
    const size_t length = (size_t)(r->line + r->length - name);
    sb_block block;
    int result = SB_OK;
    sb_start_block(&block);
    if (length >= SB_NAME_LENGTH) return wrong(r, "the name of a block is too long");
    memcpy(block.name, name, length);
    for (;;) {
        const char *rest;
        if (!next_line(r)) {
            result = wrong(r, "the file ends within a block");
        } else if (r->length == 3 && strncmp(r->line, "end", 3) == 0) {
            if (block.lines) result = sb_put_block(r->world, &block);
            else result = wrong(r, "a block must have lines");
            if (result == SB_ERROR_ARGUMENT) result = SB_ERROR_FORMAT;
            if (result >= 0 && block.placed &&
                sb_place(r->world, result, block.place, block.across, block.outward) != SB_OK)
                return SB_ERROR_FORMAT;
            if (result >= 0) return SB_OK;
        } else if ((rest = after(r, "frame")) != NULL) {
            result = read_frame(r, rest, &block);
        } else if ((rest = after(r, "discs")) != NULL) {
            result = read_table(r, rest, 3, &block.discs, &block.disc_count);
        } else if ((rest = after(r, "lines")) != NULL) {
            result = read_table(r, rest, 4, &block.lines, &block.line_count);
        } else {
            result = read_parameter(r, &block);
        }
        if (result < 0) break;
    }
    sb_block_free(&block);
    return result;
}

static int read_force_limit(reader *r, const char *rest)
{
    const char *end;
    r->force_limit = sb_read_number(rest, &end);
    if (end != r->line + r->length || !(r->force_limit > 0.0) || !isfinite(r->force_limit))
        return wrong(r, "force_limit_n must be a positive number");
    return SB_OK;
}

static int read_blocks(reader *r)
{
    if (!next_line(r) || r->length != 19 || strncmp(r->line, "stepblocks-blocks 1", 19) != 0)
        return wrong(r, "stepblocks-blocks 1 is expected");
    while (next_line(r)) {
        const char *name = after(r, "block"), *limit = after(r, "force_limit_n");
        int result;
        if (limit) {
            result = read_force_limit(r, limit);
            if (result != SB_OK) return result;
            continue;
        }
        if (!name) return wrong(r, "block and its name are expected");
        result = read_block(r, name);
        if (result != SB_OK) return result;
    }
    return SB_OK;
}

/* Open a file whose path is in UTF-8: on Windows `fopen` would take the code page of the system. */
static FILE *open_file(const char *path)
{
#ifdef _WIN32
    FILE *file = NULL;
    const int length = MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, NULL, 0);
    wchar_t *wide = length > 0 ? malloc((size_t)length * sizeof *wide) : NULL;
    if (wide && MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, wide, length) > 0)
        file = _wfopen(wide, L"rb");
    free(wide);
    return file;
#else
    return fopen(path, "rb");
#endif
}

static char *read_all(sb_world *world, const char *path)
{
    FILE *file = open_file(path);
    char *text = NULL;
    long size = -1;
    if (file && fseek(file, 0, SEEK_END) == 0) size = ftell(file);
    if (size >= 0 && size <= MOST_BYTES && fseek(file, 0, SEEK_SET) == 0)
        text = malloc((size_t)size + 1);
    if (text && fread(text, 1, (size_t)size, file) != (size_t)size) {
        free(text);
        text = NULL;
    }
    if (file) fclose(file);
    if (text) text[size] = '\0';
    else sb_fail(world, SB_ERROR_FILE, "%.160s cannot be read, or has more than 64 MiB", path);
    return text;
}

int sb_load(sb_world *world, const char *path)
{
    reader r;
    char *text;
    int before, result;
    if (!world || !path) return SB_ERROR_ARGUMENT;
    before = world->count;
    ++world->loads;
    text = read_all(world, path);
    if (!text) return SB_ERROR_FILE;
    memset(&r, 0, sizeof r);
    r.world = world;
    r.name = path;
    r.at = text;
    r.force_limit = -1.0;
    result = read_blocks(&r);
    free(text);
    if (result != SB_OK) {
        while (world->count > before) sb_block_free(&world->blocks[--world->count]);
        return result;
    }
    if (r.force_limit > 0.0) world->setting[SB_FORCE_LIMIT] = r.force_limit;
    return world->count - before;
}
