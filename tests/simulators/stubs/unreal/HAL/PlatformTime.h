#pragma once

struct FPlatformTime
{
    static double Seconds() { return 0.0; }
};
