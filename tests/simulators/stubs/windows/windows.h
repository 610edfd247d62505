/* What the loader of stimuli asks of Windows: wide names of files. `fopen` of a name that is not
   ASCII fails, as with the code page of a system that lacks its letters. */
#ifndef STUB_WINDOWS_H
#define STUB_WINDOWS_H

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <wchar.h>

#define CP_UTF8 65001u
#define MB_ERR_INVALID_CHARS 8u

static int MultiByteToWideChar(unsigned page, unsigned flags, const char *text, int length,
                               wchar_t *wide, int room)
{
    (void)length;
    if (page != CP_UTF8 || flags != MB_ERR_INVALID_CHARS || !setlocale(LC_ALL, "C.UTF-8")) return 0;
    const size_t count = mbstowcs(wide, text, wide ? (size_t)room : 0);
    return count == (size_t)-1 ? 0 : (int)count + 1;
}

static FILE *_wfopen(const wchar_t *path, const wchar_t *mode)
{
    char name[4096], how[8];
    if (wcstombs(name, path, sizeof name) == (size_t)-1) return NULL;
    if (wcstombs(how, mode, sizeof how) == (size_t)-1) return NULL;
    return fopen(name, how);
}

static FILE *refuse_narrow_name(const char *path, const char *mode)
{
    for (const char *letter = path; *letter; letter++)
        if ((unsigned char)*letter > 127) return NULL;
    return fopen(path, mode);
}
#define fopen(path, mode) refuse_narrow_name(path, mode)

#endif
